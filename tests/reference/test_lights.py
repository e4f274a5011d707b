# ruff: noqa: E501  # one light a line
"""What arrives from each light, at hand-computed points of a floor z = 0 with k_d = 1/2."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from whitted_reference import NotDefined
from whitted_reference.arithmetic import DECIMAL, FLOAT
from whitted_reference.lights import prepare

FLOOR = """<shape type="rectangle"><transform name="to_world"><scale value="64"/></transform>
  <bsdf type="blinnphong"/></shape>"""
DOWN = (0, 0, -1)


def test_directional_light_is_irradiance_times_cosine(eye):
    light = '<emitter type="directional"><vector name="direction" value="0,0,-1"/><rgb name="irradiance" value="1 2 3"/></emitter>'
    assert eye(FLOOR + light).sees((0, 0, 1), DOWN, 0.5, 1, 1.5)
    # Along M z: (0, 3/5, -4/5) by a matrix; single precision rounds 3/5 and 4/5, the length is normalised.
    turned = '<emitter type="directional"><transform name="to_world"><matrix value="1 0 0 0 -4 3 0 -3 -4"/></transform></emitter>'
    assert eye(FLOOR + turned).sees((0, 0, 1), DOWN, Fraction(1, 2) * Fraction(4, 5))


def test_directional_light_is_not_scaled_by_its_transform(eye):
    big = '<emitter type="directional"><transform name="to_world"><scale x="1" y="1" z="-64"/></transform></emitter>'
    assert eye(FLOOR + big).sees((0, 0, 1), DOWN, 0.5)


def test_point_light_falls_off_with_the_square_of_the_distance(eye):
    light = '<emitter type="point"><point name="position" value="3,0,4"/><float name="intensity" value="50"/></emitter>'
    assert eye(FLOOR + light).sees((0, 0, 1), DOWN, Fraction(1, 2) * 2 * Fraction(4, 5))
    same = '<emitter type="point"><transform name="to_world"><translate x="3" z="4"/></transform><float name="intensity" value="50"/></emitter>'
    assert eye(FLOOR + same).sees((0, 0, 1), DOWN, Fraction(4, 5))


def test_without_falloff_the_intensity_arrives_as_it_is(eye):
    light = '<emitter type="point"><point name="position" value="3,0,4"/><float name="intensity" value="2"/></emitter>'
    none = '<string name="falloff" value="none"/>'
    assert eye(FLOOR + light, none).sees((0, 0, 1), DOWN, Fraction(4, 5))


def spot(cutoff: float, beam: str = "", z: float = 4, move: str = "") -> str:
    # Looking straight down from (0, 0, z): local +z is world -z.
    return f"""<emitter type="spot" id="lamp"><float name="cutoff_angle" value="{cutoff}"/>{beam}
      <float name="intensity" value="50"/><transform name="to_world">{move}<scale y="-1" z="-1"/>
      <translate z="{z}"/></transform></emitter>"""


def test_spot_is_a_point_light_within_its_beam_and_dark_beyond_its_cutoff(eye):
    # At (3, 0, 0): theta = atan(3/4) = 36.87 degrees, distance 5, n.l = 4/5.
    inside = '<float name="beam_width" value="37"/>'
    assert eye(FLOOR + spot(40, inside)).sees((3, 0, 1), DOWN, Fraction(4, 5))
    assert eye(FLOOR + spot(36)).sees((3, 0, 1), DOWN, 0)
    none = '<string name="falloff" value="none"/>'
    assert eye(FLOOR + spot(40, inside), none).sees((3, 0, 1), DOWN, 20)


@pytest.mark.parametrize(("cutoff", "beam", "width"), [(40, 20, '<float name="beam_width" value="20"/>'), (40, 30, "")])
def test_spot_is_linear_in_the_angle_between_beam_and_cutoff(load_scene, cutoff, beam, width):
    scene = load_scene(FLOOR + spot(cutoff, width))
    for arithmetic in (FLOAT, DECIMAL):
        light = prepare(scene.lights[0], scene.settings, arithmetic)
        with arithmetic.scope():
            *_, (red, _, _) = light.arrive(*arithmetic.vec((3, 0, 0)))
        f = (math.radians(cutoff) - math.atan2(3, 4)) / (math.radians(cutoff) - math.radians(beam))
        # Angles of about 0.6 are off by 2^-54 each; their difference of 0.05 turns that into 2^-48.
        assert float(red) == pytest.approx(2 * f, rel=2.0**-46)


def test_narrow_spot_keeps_its_digits(load_scene):
    # Cutoff 0.001 degrees: an arc cosine would see cos theta = 1 - 1e-10 and lose ten digits of theta.
    scene = load_scene(FLOOR + spot(0.001, '<float name="beam_width" value="0"/>'))
    light = prepare(scene.lights[0], scene.settings, FLOAT)
    x = 4 * math.radians(0.0005)
    *_, (red, _, _) = light.arrive(x, 0.0, 0.0)
    cutoff = scene.lights[0].cutoff_angle
    theta = math.atan2(x, 4)
    # theta and cutoff are relatively exact to 2^-52; their difference is half of either: four times that.
    assert red == pytest.approx(50 / (16 + x * x) * (cutoff - theta) / cutoff, rel=2.0**-49)


def test_spot_angle_is_measured_in_the_local_frame(eye):
    # Squeezed by M, the local direction to (3, 0, 0) is (3/4, 0, 4)... within 20 degrees where the world's is not.
    squeezed = spot(20, '<float name="beam_width" value="20"/>', move='<scale x="4" y="4"/>')
    assert eye(FLOOR + squeezed).sees((3, 0, 1), DOWN, Fraction(4, 5))


def test_lights_without_definition_are_refused(load_scene):
    with pytest.raises(NotDefined, match="emitter projector"):
        load_scene('<emitter type="projector"/>')
