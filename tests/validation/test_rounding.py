"""The rounding model: what its forms say is compared with float32 arithmetic and with exact derivatives."""

from __future__ import annotations

import math
import random
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import whitted_reference
from whitted_reference import Scene
from whitted_reference.instances import Placed
from whitted_reference.scene import Instance
from whitted_reference.shapes import Sphere
from whitted_validation import noise, scene_files
from whitted_validation.forms import length, radius
from whitted_validation.patch import patch_of
from whitted_validation.rounding import Follower, Rounding, chain
from whitted_validation.roundoffs import V
from whitted_validation.textures import Slopes

SIZE = 16


def small(name: str) -> Scene:
    return whitted_reference.image.resized(whitted_reference.load(scene_files.find(name)), SIZE, SIZE)


def test_the_radius_of_a_form_is_its_largest_value() -> None:
    form = np.array([[1.0, -2.0], [0.5, 0.0], [0.0, 0.0]])
    values = [form @ (a, b) for a in (-1, 1) for b in (-1, 1)]
    assert (radius(form) == np.max(values, axis=0)).all()
    assert length(form) >= max(np.linalg.norm(value) for value in values)


@pytest.mark.parametrize("name", ["whitted_1980", "gold", "instances", "smooth_mesh"])
def test_following_gives_the_tracer_s_own_colours(name: str) -> None:
    scene = small(name)
    follower, tracer = Follower(scene), whitted_reference.Tracer(scene)
    for y in range(SIZE):
        for x in range(SIZE):
            assert follower.record(x, y).colour == tracer.pixel(x, y)


@pytest.mark.parametrize("name", ["blinn_phong", "primitives", "hall_of_mirrors", "spot", "textured"])
def test_noise_within_the_model_stays_within_the_bound(name: str) -> None:
    """Turn a camera ray by no more than its own roundings: the colour changes by no more than the bound."""
    scene = small(name)
    follower = Follower(scene)
    rounding, shaken = Rounding(follower, Slopes(scene)), noise.Shaken(scene)
    rng = random.Random(1)
    compared = 0
    for _ in range(60):
        x, y = rng.randrange(SIZE), rng.randrange(SIZE)
        e, d, start, end = follower.camera.ray(x, y)
        tree = follower.record_ray(e, d, start, end)
        bound = rounding.bound(tree).colour
        turned = [c + rng.uniform(-1, 1) * 4 * V for c in d]  # CAMERA_DIRECTION is 5 v, and |d| rounds too
        size = math.hypot(*turned)
        other = follower.record_ray(e, tuple(c / size for c in turned), start, end)
        if shaken.signature(other) == shaken.signature(tree):
            compared += 1
            assert (np.abs(np.subtract(other.colour, tree.colour)) <= bound).all()
    assert compared > 30


def test_a_bound_grows_where_float32_loses_more() -> None:
    """Beside the outline of a ball its normal, and so its shade, is known worse than in its middle."""
    scene = small("lambert")
    follower = Follower(scene)
    rounding = Rounding(follower, Slopes(scene))
    by_angle = []
    for y in range(SIZE):
        for x in range(SIZE):
            tree = follower.record(x, y)
            root = next(chain(tree.root))
            ball = root.primitive >= 0 and isinstance(follower.primitives[root.primitive], Sphere)
            if ball and any(light.n_h is not None for light in root.lights):
                by_angle.append((root.n_v, rounding.bound(tree).colour.max()))
    by_angle.sort()
    middle = len(by_angle) // 2
    assert np.median([b for _, b in by_angle[:middle]]) > np.median([b for _, b in by_angle[middle:]])


INSTANCE = """<scene version="3.0.0"><sensor type="perspective">
  <transform name="to_world"><translate z="-5"/></transform>
  <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
  <shape type="shapegroup" id="group"><shape type="sphere"><point name="center" x="1000" y="-300" z="70"/></shape>
  <shape type="cube"><transform name="to_world"><translate x="1001.5" y="-300" z="70"/></transform></shape></shape>
  <shape type="instance" id="far"><ref id="group"/><transform name="to_world"><translate x="-1000" y="300" z="-70"/>
  <rotate y="1" angle="25"/><scale x="1.25" y="0.75" z="1"/></transform></shape></scene>"""


def test_a_hit_brought_out_of_an_instance_is_off_by_no_more_than_its_roundings(tmp_path: Path) -> None:
    """What stands far from the origin inside is moved back to it outside: the digits are lost inside."""
    (tmp_path / "scene.xml").write_text(INSTANCE)
    scene = whitted_reference.load(tmp_path / "scene.xml")
    follower = Follower(scene)
    (instance,) = scene.shapes
    assert isinstance(instance, Instance)
    rows = [[Fraction(c) for c in row] for row in instance.to_world.matrix]
    met, greatest = set(), 0.0
    for y in range(SIZE):
        for x in range(SIZE):
            node = follower.record(x, y).root
            if node.primitive < 0:
                continue
            primitive = follower.primitives[node.primitive]
            assert isinstance(primitive, Placed)
            e, d, longer = primitive.inner_ray(node.e, node.d)
            p = np.array(e) + node.t * longer * np.array(d)
            inside = [*(Fraction(c) for c in p), Fraction(1)]
            out = np.array([float(sum(a * b for a, b in zip(row, inside, strict=True))) for row in rows[:3]])
            off = np.abs(out - np.array(node.p))
            allowed = patch_of(primitive, node).point_roundings
            assert (off <= allowed).all()
            met.add(node.shape)
            greatest = max(greatest, float(off.max()))
    assert len(met) == 2
    assert greatest > 100 * V  # of a body of size 1: such a bound is needed


def test_the_sampling_factor_follows_from_its_statement() -> None:
    """Hoeffding beyond 10^-6, and the 10^-6 quantile of chi^2 with 32 degrees of freedom, by its finite sum."""
    x = noise.DRAWS / (noise.FACTOR**2 / (6 * math.log(2e6)))
    terms = [(x / 2) ** i / math.factorial(i) for i in range(noise.DRAWS // 2)]
    below = 1 - math.exp(-x / 2) * math.fsum(terms)
    assert 0.9e-6 < below < 1.1e-6


def test_slopes_of_a_picture_bound_its_changes() -> None:
    scene = small("textured")
    follower, slopes = Follower(scene), Slopes(scene)
    rng = random.Random(3)
    surfaces = {primitive.surface.id: primitive.surface for primitive in follower.primitives}
    asked = 0
    for name, surface in surfaces.items():
        if surface.front.constant is not None or not slopes.varies(name, True):
            continue
        for _ in range(300):
            u, v = rng.random(), rng.random()
            off = (rng.uniform(0, 1e-4), rng.uniform(0, 1e-4))
            here, there = surface.front.at(u, v), surface.front.at(u + off[0], v - off[1])
            asked += 1
            change = max(abs(a - b) for a, b in zip(here.diffuse, there.diffuse, strict=True))
            assert change <= slopes.error(name, True, "diffuse", (u, v), off)
    assert asked
