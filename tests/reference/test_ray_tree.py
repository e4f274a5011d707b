"""The recorder is the tracer; its margins are distances; its flips change exactly one thing."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from fractions import Fraction

import pytest

from whitted_reference import Tracer
from whitted_reference.margins import margin
from whitted_reference.ray_tree import Key, Recorder
from whitted_reference.vectors import add, cross, scaled

SHAPES = {
    "sphere": '<shape type="sphere"><float name="radius" value="1.25"/></shape>',
    "rectangle": """<shape type="rectangle"><transform name="to_world"><matrix value="1.5 0.5 0  0 1 0  0 0.3 1"/>
      </transform></shape>""",
    "disk": """<shape type="disk"><transform name="to_world"><scale value="1.25"/><rotate x="1" angle="25"/>
      </transform></shape>""",
    "cylinder": """<shape type="cylinder"><transform name="to_world"><translate z="-0.5"/><scale x="0.8" y="0.8"
      z="2"/><rotate x="1" angle="40"/></transform></shape>""",
    "cube": '<shape type="cube"><transform name="to_world"><rotate y="1" angle="30"/></transform></shape>',
    "polygon": """<shape type="polygon"><string name="vertices" value="-2,-1,0 2,-1,0 1,1,0 0,0,0 -1,1,0;
      -0.5,-0.75,0 0.5,-0.75,0 0,-0.25,0"/></shape>""",
    "instance": """<shape type="shapegroup" id="g"><shape type="sphere"/></shape><shape type="instance"><ref id="g"/>
      <transform name="to_world"><scale x="1.5" y="0.8" z="1"/></transform></shape>""",
}


def ray(rng: random.Random) -> tuple[tuple[float, ...], tuple[float, ...]]:
    target = [rng.uniform(-1.5, 1.5) for _ in range(3)]
    e = (rng.uniform(-2, 2), rng.uniform(-2, 2), 6.0)
    d = [t - o for t, o in zip(target, e, strict=True)]
    length = math.hypot(*d)
    return e, tuple(x / length for x in d)


def around(d, count: int = 24):
    """Return unit vectors across d."""
    a = (0.0, 1.0, 0.0) if abs(d[0]) > 0.5 else (1.0, 0.0, 0.0)
    u = cross(d, a)
    u = scaled(u, 1 / math.hypot(*u))
    v = cross(d, u)
    angles = [2 * math.pi * i / count for i in range(count)]
    return [add(scaled(u, math.cos(angle)), scaled(v, math.sin(angle))) for angle in angles]


@pytest.mark.parametrize("kind", sorted(SHAPES))
def test_margin_is_the_distance_by_which_a_ray_may_move_before_it_meets_or_misses(load_scene, kind):
    """Move rays aside: by less than the margin nothing changes, by a little more something does."""
    primitives = Tracer(load_scene(SHAPES[kind])).primitives
    rng = random.Random(7)
    changed = tried = 0
    for primitive in primitives * (60 // len(primitives)):
        e, d = ray(rng)

        def meets(e, d=d, primitive=primitive) -> bool:
            return primitive.hit(*e, *d, -100.0, 100.0) is not None

        found = margin(primitive, e, d).distance
        before = meets(e)
        assert (found > 0) == before
        by = abs(found)
        for aside in around(d):
            # Less by a part in a million, for the rounding of both.
            assert meets(add(e, scaled(aside, by * (1 - 1e-6)))) == before
        if not before and kind != "sphere":
            continue  # the nearest part may be a corner, which only the one right direction meets
        tried += 1
        # More by 2 %: one of 24 directions is within 7.5 degrees of the nearest, 1 / cos 7.5 = 1.009.
        changed += any(meets(add(e, scaled(aside, by * 1.02))) != before for aside in around(d))
    # A lower bound for disks, tubes and instances, the distance itself for the others.
    if kind in ("sphere", "rectangle", "cube"):
        assert changed == tried


STILL = """
  <shape type="sphere" id="ball"><point name="center" value="0,0,0"/><bsdf type="blinnphong">
    <float name="specular_reflectance" value="0.5"/><float name="mirror_reflectance" value="0.25"/></bsdf></shape>
  <shape type="rectangle" id="floor"><transform name="to_world"><scale value="9"/><translate z="-1"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <emitter type="point" id="lamp"><point name="position" value="3,0,4"/><float name="intensity" value="9"/></emitter>
  <emitter type="directional" id="sun"><vector name="direction" value="-1,0.5,-1"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.25 0.5 1"/></emitter>"""
SENSOR = """<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
  <lookat origin="1,-5,3" target="0,0,0" up="0,0,1"/></transform><film type="hdrfilm">
  <integer name="width" value="16"/><integer name="height" value="12"/><rfilter type="box"/></film></sensor>"""


def test_recorder_draws_the_tracers_picture_bit_for_bit(load_scene):
    scene = load_scene(STILL, sensor=SENSOR)
    tracer, recorder = Tracer(scene), Recorder(scene)
    for y in range(12):
        for x in range(16):
            assert recorder.record(x, y).colour == tracer.raycolor(*tracer.camera.ray(x, y))


def test_tree_tells_what_every_ray_meets(load_scene):
    recorder = Recorder(load_scene(STILL))
    tree = recorder.record_ray((0.0, 0.0, 5.0), (0.0, 0.0, -1.0), 0.0, math.inf)
    root = tree.root
    assert (root.shape, root.t, root.p, root.n) == ("ball", 4.0, (0, 0, 1), (0, 0, 1))
    assert [light.id for light in root.lights] == ["lamp", "sun"]
    lamp = root.lights[0]
    assert lamp.blocked_by is None
    assert lamp.n_l == pytest.approx(3 / math.sqrt(18), rel=2.0**-50)  # from (0, 0, 1) to (3, 0, 4)
    total = [sum(light.colour[c] for light in root.lights) for c in range(3)]
    assert root.mirror.shape is None
    for c in range(3):
        assert root.colour[c] == total[c] + 0.25 * root.mirror.colour[c]


def test_flipping_a_silhouette_shows_what_lies_behind(load_scene):
    # The line passes the ball at x = 1 + 2^-20, or 1 - 2^-20 inside; beside it is the floor.
    scene = load_scene(STILL)
    recorder = Recorder(scene, reach=1e-3)
    for side in (1 + 2.0**-20, 1 - 2.0**-20):
        e, d = (side, 0.0, 5.0), (0.0, 0.0, -1.0)
        tree = recorder.record_ray(e, d, 0.0, math.inf)
        key = Key(0, "seen", "", 0)
        (decision,) = [decision for decision in tree.decisions if decision.key == key]
        assert (decision.kind, decision.shape, decision.answer) == ("silhouette", "ball", side < 1)
        assert decision.margin == pytest.approx(1 - side, abs=2.0**-50)
        other = recorder.record_ray(e, d, 0.0, math.inf, frozenset([key]))
        assert {tree.root.shape, other.root.shape} == {"ball", "floor"}
        # The picture in which the decision falls the other way is the picture of the neighbouring ray.
        beside = recorder.record_ray((2 - side, 0.0, 5.0), d, 0.0, math.inf)
        assert other.root.shape == beside.root.shape
        # Moving by 2^-19 moves a point of the ball's rim by the square root of twice that, 2^-9.
        for a, b in zip(other.colour, beside.colour, strict=True):
            assert abs(a - b) < 8 * 2.0**-9


def test_flipping_a_blocker_turns_a_shadow_off_and_on(load_scene):
    body = """<shape type="rectangle" id="floor"><bsdf type="blinnphong"/></shape>
      <shape type="rectangle" id="roof"><transform name="to_world"><translate x="{}" z="0.5"/></transform></shape>
      <emitter type="directional" id="sun"><vector name="direction" value="0,0,-1"/></emitter>"""
    key = Key(0, "blocks", "sun", 1)
    for x, lit in [(1 - 2.0**-20, 0.0), (1 + 2.0**-20, 0.5)]:
        recorder = Recorder(load_scene(body.format(x)), reach=1e-3)
        ray = ((0.0, 0.0, 0.25), (0.0, 0.0, -1.0), 0.0, math.inf)
        tree = recorder.record_ray(*ray)
        assert tree.colour == (lit, lit, lit)
        assert [(d.kind, d.answer) for d in tree.decisions if d.key == key] == [("rectangle edge", lit == 0.0)]
        assert recorder.record_ray(*ray, frozenset([key])).colour == (0.5 - lit, 0.5 - lit, 0.5 - lit)
        # Nothing else changes: running again without flips gives the first picture.
        assert recorder.record_ray(*ray) == tree


def test_flipping_horizon_facing_mirror_and_order(load_scene):
    body = """<shape type="rectangle" id="one"><bsdf type="blinnphong">
        <float name="mirror_reflectance" value="0.5"/></bsdf></shape>
      <shape type="rectangle" id="two"><transform name="to_world"><translate z="-0.0009765625"/></transform>
        <bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.25"/></bsdf></shape>
      <emitter type="directional" id="sun"><vector name="direction" value="0,0,-1"/></emitter>
      <emitter type="constant"><float name="radiance" value="1"/></emitter>"""
    recorder = Recorder(load_scene(body), reach=0.01)
    ray = ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.0, math.inf)

    def grey(*flips: Key) -> float:
        return recorder.record_ray(*ray, frozenset(flips)).colour[0]

    assert grey() == 1.0
    assert grey(Key(0, "horizon", "sun", 0)) == 0.5
    assert grey(Key(0, "mirror", "", 0)) == 0.5
    assert grey(Key(0, "facing", "", 0)) == 0.0
    # The second plane first: it is lit, for the first does not stand in its light in that picture... but
    # it does: order and shadow are two decisions.
    assert grey(Key(0, "nearer", "", 1)) == 0.0
    assert grey(Key(0, "nearer", "", 1), Key(0, "blocks", "sun", 0, wall=1)) == 0.25
    kinds = {decision.kind for decision in recorder.record_ray(*ray).decisions}
    assert {"tie", "horizon n.l = 0", "facing", "mirror"} <= kinds


def test_decisions_of_later_bounces_carry_their_bounce(load_scene):
    hall = """<shape type="rectangle" id="lower"><bsdf type="conductor"/></shape>
      <shape type="rectangle" id="upper"><transform name="to_world"><scale z="-1"/>
      <translate x="{}" z="2"/></transform><bsdf type="conductor"/></shape>
      <emitter type="constant"><float name="radiance" value="1"/></emitter>"""
    recorder = Recorder(load_scene(hall.format(1 + 2.0**-20)), reach=1e-3)
    ray = ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.0, math.inf)
    tree = recorder.record_ray(*ray)
    assert tree.colour == (1, 1, 1)
    near = [decision.key for decision in tree.decisions if "edge" in decision.kind]
    assert near == [Key(1, "seen", "", 1)]
    # Met after all, the upper mirror sends the ray back and forth until depth ends: black.
    always = frozenset(Key(k, "seen", "", 1) for k in (1, 3, 5, 7, 9))
    assert recorder.record_ray(*ray, always).colour == (0, 0, 0)


def test_tree_is_plain_data(load_scene):
    tree = Recorder(load_scene(STILL)).record_ray((0.0, 0.0, 5.0), (0.0, 0.0, -1.0), 0.0, math.inf)
    assert replace(tree.root, k=7).k == 7
    assert Fraction(tree.root.t) == 4


@pytest.mark.parametrize(
    ("texture", "x", "edge"),
    [
        ('<texture type="checkerboard" name="reflectance"><float name="color0" value="1"/>'
         '<float name="color1" value="0"/></texture>', 2.0**-10, 2.0**-11),
        ('<texture type="checkerboard" name="reflectance"><float name="color0" value="1"/>'
         '<float name="color1" value="0"/></texture>', 0.0, 0.0),
        ('<texture type="checkerboard" name="reflectance"><float name="color0" value="1"/><float name="color1" '
         'value="0"/><transform name="to_uv"><scale x="4" y="1"/></transform></texture>', 0.25 - 2.0**-8, 2.0**-9),
    ],
)  # fmt: skip
def test_flipping_a_texture_edge_shows_the_colour_beyond(load_scene, texture, x, edge):
    body = f"""<shape type="rectangle" id="floor"><bsdf type="diffuse">{texture}</bsdf></shape>
      <emitter type="directional"><vector name="direction" value="0,0,-1"/></emitter>"""
    recorder = Recorder(load_scene(body))
    ray = ((x, -0.5, 1.0), (0.0, 0.0, -1.0), 0.0, math.inf)
    tree = recorder.record_ray(*ray)
    key = Key(0, "texture", "", 0)
    assert [decision.margin for decision in tree.decisions if decision.key == key] == [edge]
    other = recorder.record_ray(*ray, frozenset([key]))
    assert {tree.colour[0], other.colour[0]} == {0.0, 1 / math.pi}
