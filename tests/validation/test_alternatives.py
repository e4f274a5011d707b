"""Each kind of decision: a picture with it turned is explained by its name, one with another fault is not."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import whitted_reference
from whitted_reference import Scene
from whitted_reference.image import DEEPEST
from whitted_reference.ray_tree import Recorder
from whitted_validation import bounds
from whitted_validation.alternatives import Alternative, Alternatives
from whitted_validation.rounding import chain
from whitted_validation.validation import Here
from whitted_validation.verdict import Status, judge

SENSOR = """<sensor type="orthographic"><transform name="to_world"><scale value="{scale}"/>
  <lookat origin="{origin}" target="{target}" up="{up}"/></transform><film type="hdrfilm">
  <integer name="width" value="8"/><integer name="height" value="8"/><rfilter type="box"/></film></sensor>"""


@pytest.fixture
def scene(tmp_path: Path) -> Callable[..., Scene]:
    """Load a scene around a body, seen by 8 x 8 parallel rays; the view is from +z unless told."""

    def make(
        body: str,
        integrator: str = "",
        origin: str = "0, 0, 5",
        target: str = "0, 0, 0",
        up: str = "0, 1, 0",
        scale: float = 1.0,
    ) -> Scene:
        sensor = SENSOR.format(origin=origin, target=target, up=up, scale=scale)
        (tmp_path / "leaf.ply").write_text(LEAF)
        file = tmp_path / "scene.xml"
        file.write_text(
            f'<scene version="3.0.0"><integrator type="whitted">{integrator}</integrator>{sensor}{body}</scene>'
        )
        return whitted_reference.load(file)

    return make


LEAF = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float nx
property float ny
property float nz
element face 1
property list uchar int vertex_indices
end_header
-1.875 -2 0 0.6 0 -0.8
2.1250002 -2 0 0.6 0 0.8
0.125 3 0 1 0 0
3 0 1 2
"""


@pytest.fixture
def deep_recursion() -> Iterator[None]:
    """Allow a thousand mirrors."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(DEEPEST)
    yield
    sys.setrecursionlimit(before)


SKY = '<emitter type="constant"><rgb name="radiance" value="0.25, 0.5, 0.75"/></emitter>'
AMBIENT = '<rgb name="ambient" value="1"/>'


def paint(value: float) -> str:
    """Return a bsdf that shows this grey under ambient light 1."""
    return (
        f'<bsdf type="blinnphong"><float name="ambient_reflectance" value="{value}"/>'
        '<float name="diffuse_reflectance" value="0"/></bsdf>'
    )


def alternatives(described: Scene, word: str) -> dict[tuple[int, int], Alternative]:
    """Return, for each pixel that has one, the first other colour for a single reason with this word in it."""
    witness = Alternatives(described)
    found = {}
    for y in range(8):
        for x in range(8):
            own, *others = witness.of_pixel(x, y)[0]
            for other in others:
                if len(other.reasons) == 1 and word in other.reasons[0] and other.colour != own.colour:
                    found.setdefault((x, y), other)
    return found


def explains_it_and_nothing_else(described: Scene, word: str) -> int:
    """Judge pictures with a turned decision, and with half of the change; return how many pixels had one."""
    known = bounds.measure(described, Here())
    found = alternatives(described, word)
    for (x, y), other in found.items():
        picture = known.colour.copy()
        picture[y, x] = other.colour
        judgement = judge(described, known, picture, Here())
        (difference,) = judgement.differences
        assert (difference.status, difference.reasons) == (Status.EXPLAINED, other.reasons)
        picture[y, x] = 0.5 * (known.colour[y, x] + other.colour)
        assert judge(described, known, picture, Here()).count(Status.UNEXPLAINED) == 1
        picture[y, x] = other.colour
        picture[y, x, 1] += 0.01
        assert judge(described, known, picture, Here()).count(Status.UNEXPLAINED) == 1
    return len(found)


# ------------------------------------------------------------------------------------- sides, n.v = 0
def test_a_two_sided_ball_shows_its_outside_up_to_the_outline(scene: Callable[..., Scene]) -> None:
    """Six rays of two rows pass its outline within single precision, at 5/8 beside the centre or 3-4-5 away.

    Whether a search finds the ball there is in doubt; which of its sides is seen is not.
    """
    body = f"""{SKY}<shape type="sphere" id="ball"><point name="center" value="0, 0.125, 0"/>
      <float name="radius" value="{0.625 * (1 + 2.0**-23)!r}"/>
      <bsdf type="twosided">{paint(0.25)}{paint(0.75)}</bsdf></shape>"""
    described = scene(body, AMBIENT)
    assert not alternatives(described, "n.v = 0")
    assert len(alternatives(described, "silhouette of `ball`")) == 6


def test_a_shading_normal_square_to_the_ray_may_turn_a_two_sided_face_black(scene: Callable[..., Scene]) -> None:
    """The normals of the vertices lean so that n.v = 0 near x = 1/8; turned away, n_g is on its other side."""
    body = f"""{SKY}<shape type="ply" id="leaf"><string name="filename" value="leaf.ply"/>
      <bsdf type="twosided">{paint(0.25)}{paint(0.75)}</bsdf></shape>"""
    described = scene(body, AMBIENT)
    assert {other.colour for other in alternatives(described, "n.v = 0").values()} == {(0.0, 0.0, 0.0)}
    assert explains_it_and_nothing_else(described, "n.v = 0") >= 4


# ----------------------------------------------------------------------------------- walls of a cylinder
TUBE = """<shape type="cylinder" id="tube"><float name="radius" value="0.5"/>
  <point name="p0" value="0, -20, 0"/><point name="p1" value="0, {top!r}, 0"/>
  <bsdf type="twosided">{front}{back}</bsdf></shape>"""


@pytest.mark.parametrize("wall", [0, 1])
def test_past_the_rim_of_a_tube_the_other_wall_is_seen(scene: Callable[..., Scene], wall: int) -> None:
    """From above: past the rim of the near wall shows the inside of the far one, past that the sky."""

    def tube(top: float) -> Scene:
        body = SKY + TUBE.format(top=top, front=paint(0.25), back=paint(0.75))
        return scene(body, AMBIENT, origin="0, 3, 4")

    recorder = Recorder(tube(20.0))
    e, d, _, _ = recorder.camera.ray(5, 3)
    walls = recorder.primitives[0].roots(*e, *d)  # type: ignore[attr-defined]
    described = tube(e[1] + walls[wall] * d[1])
    ours = Alternatives(described).of_pixel(5, 3)[0]
    seen = {alternative.colour for alternative in ours}
    outside, inside, sky = (0.25,) * 3, (0.75,) * 3, (0.25, 0.5, 0.75)
    assert seen == ({outside, inside} if wall == 0 else {inside, sky})
    assert explains_it_and_nothing_else(described, "cylinder end") > 0


# ------------------------------------------------------------------------- the limits of unlimited depth
HALL = """<emitter type="constant"><float name="radiance" value="{sky}"/></emitter>
  <shape type="rectangle" id="left"><transform name="to_world"><rotate y="1" angle="90"/>
    <scale y="{reach}"/><translate y="{middle}"/></transform>
    <bsdf type="conductor"><float name="specular_reflectance" value="{k_m}"/></bsdf></shape>
  <shape type="rectangle" id="right"><transform name="to_world"><rotate y="1" angle="-90"/>
    <scale y="{reach}"/><translate x="1" y="{middle}"/></transform>
    <bsdf type="conductor"><float name="specular_reflectance" value="{k_m}"/></bsdf></shape>"""
ALONG = {"origin": "0.5, 4.5, 0", "target": "1.5, 3.5, 0", "up": "0, 0, 1", "scale": 0.125}


def test_eight_mirrors_of_an_eighth_pass_on_just_enough_to_be_followed(scene: Callable[..., Scene]) -> None:
    """(1/8)^8 = 2^-24 is not less than 2^-24; a float32 product of reflectances off by a rounding may be."""
    # Hits at y = 4, 3, ... -3, then out into a sky of 2^24.
    body = HALL.format(sky=2.0**24, k_m=0.125, reach=4.0, middle=0.5)
    described = scene(body, '<integer name="max_depth" value="-1"/>', **ALONG)
    known = bounds.measure(described, Here())
    assert (known.colour == 1.0).all()
    assert {other.colour for other in alternatives(described, "least share").values()} == {(0.0, 0.0, 0.0)}
    assert explains_it_and_nothing_else(described, "least share") == 64


def test_mirrors_that_pass_on_clearly_more_or_less_are_no_matter_of_rounding(scene: Callable[..., Scene]) -> None:
    for k_m in (0.1251, 0.1249):
        body = HALL.format(sky=2.0**24, k_m=k_m, reach=4.0, middle=0.5)
        described = scene(body, '<integer name="max_depth" value="-1"/>', **ALONG)
        assert alternatives(described, "least share") == {}
        black = not bounds.measure(described, Here()).colour.any()
        assert black == (k_m < 0.125)


def test_the_1024th_ray_is_counted_and_not_rounded(scene: Callable[..., Scene], deep_recursion: None) -> None:
    body = HALL.format(sky=1.0, k_m=1.0, reach=2000.0, middle=0.5)
    described = scene(body, '<integer name="max_depth" value="-1"/>', **ALONG)
    tree = Recorder(described).record(4, 4)
    assert [node.k for node in chain(tree.root)] == list(range(1025))
    assert tree.colour == (0.0, 0.0, 0.0)
    ends = [decision.margin for decision in tree.decisions if decision.key.what == "end"]
    assert ends == [2.0**24 - 1.0] * 1024  # none of them near


# ---------------------------------------------------------------------------------------------- a step
def test_a_cone_without_a_ramp_ends_in_a_step(scene: Callable[..., Scene]) -> None:
    """The beam is as wide as the cone, and its edge at 45 degrees passes through four pixels, 3/4 from its axis."""
    body = """<shape type="rectangle" id="floor"><transform name="to_world"><scale value="4"/></transform>
      <bsdf type="blinnphong"/></shape>
      <emitter type="spot" id="torch"><float name="intensity" value="8"/><float name="cutoff_angle" value="45"/>
      <float name="beam_width" value="45"/><transform name="to_world">
      <lookat origin="0.125, 0.125, 0.75" target="0.125, 0.125, 0" up="0, 1, 0"/></transform></emitter>"""
    described = scene(body)
    known = bounds.measure(described, Here())
    found = alternatives(described, "spot cone")
    assert len(found) == 4
    lit = 0.5 * 8 * math.sqrt(0.5) / (2 * 0.75**2)  # k_d I cos / r^2
    for (x, y), other in found.items():
        assert sorted((other.colour[0], known.colour[y, x, 0])) == [0.0, pytest.approx(lit, rel=2.0**-48)]
    assert explains_it_and_nothing_else(described, "spot cone") == 4
