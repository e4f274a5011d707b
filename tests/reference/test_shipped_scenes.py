"""The tracer proves itself on every shipped scene: three arithmetics, and with and without hierarchy."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from whitted_reference import Tracer, load
from whitted_reference.image import resized
from whitted_reference.proof import TARGET, Prover

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.xml"))
PIXELS = 40


def test_there_are_scenes():
    assert len(SCENES) >= 20


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_certain_pixels_agree_with_forty_digits(path):
    scene = load(path)
    film = scene.sensors[0].film
    prover, rng = Prover(scene), random.Random(9)
    places = [(rng.randrange(film.crop_width), rng.randrange(film.crop_height)) for _ in range(PIXELS)]
    certificates = [prover.pixel(x, y) for x, y in places]
    for place, certificate in zip(places, certificates, strict=True):
        assert certificate.flag is not None or certificate.apart <= TARGET, place
    # Inside a mirror ball every bounce spreads the rays; elsewhere most pixels must be certain.
    least = 0.25 if path.stem == "inside_mirror_ball" else 0.6
    assert sum(certificate.flag is None for certificate in certificates) >= least * PIXELS


def test_rays_that_spread_from_bounce_to_bounce_are_flagged(tmp_path):
    # Two mirror balls side by side: what is seen in one of the other of the one ... is ever less certain.
    path = tmp_path / "scene.xml"
    path.write_text("""<scene version="3.0.0"><integrator type="whitted"/><sensor type="perspective"/>
      <shape type="sphere"><point name="center" value="-1.01,0,6"/><bsdf type="conductor"/></shape>
      <shape type="sphere"><point name="center" value="1.01,0,6"/><bsdf type="conductor"/></shape>
      <shape type="rectangle"><transform name="to_world"><scale x="50" y="50" z="-1"/><translate z="9"/></transform>
        <bsdf type="blinnphong"/></shape><emitter type="constant"/>
      <emitter type="point"><point name="position" value="1,2,3"/></emitter></scene>""")
    scene = resized(load(path), 64, 64)
    prover = Prover(scene)
    flags = [prover.pixel(x, 31).flag for x in range(64)]
    assert any(flag is not None and flag.startswith("ill-conditioned") for flag in flags)
    assert any(flag is None for flag in flags)


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_hierarchy_changes_no_bit(path):
    scene = resized(load(path), 20, 15)
    with_boxes, without = Tracer(scene), Tracer(scene, hierarchy=False)
    step = 1 if len(without.primitives) < 1000 else 5
    for y in range(0, 15, step):
        for x in range(0, 20, step):
            assert with_boxes.pixel(x, y) == without.pixel(x, y)
