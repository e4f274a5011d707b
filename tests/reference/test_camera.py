"""From pixel to ray: orientation, crop, principal point, clipping, grid."""

from __future__ import annotations

from fractions import Fraction

import pytest

from whitted_reference import Tracer, load, render
from whitted_reference.arithmetic import FLOAT, INTERVAL
from whitted_reference.camera import Camera


def sensor(parameters: str = "", film: str = "", kind: str = "perspective", size: tuple[int, int] = (8, 4)) -> str:
    fov = '<float name="fov" value="90"/>' if kind == "perspective" else ""
    return f"""<sensor type="{kind}">{fov}{parameters}<film type="hdrfilm">{film}
      <integer name="width" value="{size[0]}"/><integer name="height" value="{size[1]}"/>
      <rfilter type="box"/></film></sensor>"""


@pytest.fixture
def slopes(load_scene):
    """Return (x / z, y / z) of the direction through a sample, in exact enclosures checked against floats."""

    def make(text: str, x: int, y: int, i: int = 0, j: int = 0, grid: int = 1):
        scene = load_scene("", sensor=text)
        _, exact, _, _ = Camera(scene.sensors[0], INTERVAL).ray(x, y, i, j, grid)
        _, plain, _, _ = Camera(scene.sensors[0], FLOAT).ray(x, y, i, j, grid)
        for interval, value in zip(exact, plain, strict=True):
            assert interval.low <= value <= interval.high
        return exact[0] / exact[2], exact[1] / exact[2]

    return make


def matches(intervals, *expected: Fraction | float) -> bool:
    # tan 45 degrees is computed in double precision and is 1 - 2^-53: relative 2^-53 on every slope.
    return all(
        i.low - abs(x) * 2.0**-53 <= x <= i.high + abs(x) * 2.0**-53 for i, x in zip(intervals, expected, strict=True)
    )


def test_x_is_to_the_left_and_y_is_up(slopes):
    # fov 90: T = 1. First pixel of 8 x 4: fx = 1/16, fy = 1/8; slope y is scaled by H/W = 1/2.
    assert matches(slopes(sensor(), 0, 0), Fraction(7, 8), Fraction(3, 8))
    assert matches(slopes(sensor(), 7, 3), Fraction(-7, 8), Fraction(-3, 8))


def test_grid_samples_lie_at_the_centres_of_its_cells(slopes):
    # Sample (1, 0) of 2 x 2 in pixel (0, 0): fx = 3/4 / 8, fy = 1/4 / 4.
    assert matches(slopes(sensor(), 0, 0, 1, 0, 2), 1 - Fraction(3, 16), Fraction(7, 16))


def test_crop_moves_the_window_over_the_full_film(slopes):
    film = "".join(
        f'<integer name="{name}" value="{value}"/>'
        for name, value in [("crop_width", 3), ("crop_height", 2), ("crop_offset_x", 4), ("crop_offset_y", 1)]
    )
    assert matches(slopes(sensor(film=film), 0, 0), Fraction(-1, 8), Fraction(1, 8))
    assert matches(slopes(sensor(film=film), 2, 1), Fraction(-5, 8), Fraction(-1, 8))


def test_principal_point_is_a_share_of_the_full_film(slopes):
    shift = """<float name="principal_point_offset_x" value="0.25"/>
      <float name="principal_point_offset_y" value="-0.125"/>"""
    assert matches(slopes(sensor(shift), 0, 0), Fraction(7, 8) - Fraction(1, 2), Fraction(3, 8) + Fraction(1, 8))


CLIP = '<float name="near_clip" value="{}"/><float name="far_clip" value="{}"/>'
WALL = """<shape type="rectangle"><transform name="to_world"><scale x="64" y="64" z="-1"/><translate z="{}"/>
  </transform><emitter type="area"/></shape>"""


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize(("z", "seen"), [(1.875, 0), (2, 1), (3, 1), (4, 1), (4.125, 0)])
def test_near_and_far_planes_clip_by_camera_z_and_are_closed(load_scene, kind, z, seen):
    # One pixel: the ray runs along z itself, and z = 2 and z = 4 are met exactly.
    scene = load_scene(WALL.format(z), sensor=sensor(CLIP.format(2, 4), kind=kind, size=(1, 1)))
    assert Tracer(scene).pixel(0, 0) == (seen, seen, seen)


def test_slanted_rays_are_clipped_by_z_and_not_by_distance(load_scene):
    for z, seen in [(3.875, 1), (4.125, 0)]:
        scene = load_scene(WALL.format(z), sensor=sensor(CLIP.format(2, 4)))
        assert Tracer(scene).pixel(0, 0) == (seen, seen, seen)


def test_mirror_and_shadow_rays_know_no_clip(load_scene):
    mirror = """<shape type="rectangle"><transform name="to_world"><scale x="8" y="8" z="-1"/>
      <translate z="3"/></transform><bsdf type="conductor"/></shape>"""
    behind = """<shape type="rectangle"><transform name="to_world"><scale value="64"/><translate z="-50"/>
      </transform><emitter type="area"/></shape>"""
    scene = load_scene(mirror + behind, sensor=sensor(CLIP.format(2, 4), size=(1, 1)))
    assert Tracer(scene).pixel(0, 0) == (1, 1, 1)


def test_orthographic_rays_are_parallel_and_start_on_the_scaled_window(load_scene):
    move = '<transform name="to_world"><scale x="4" y="4" z="2"/><translate z="10"/></transform>'
    scene = load_scene("", sensor=sensor(move + CLIP.format(1, 3), kind="orthographic"))
    e, d, start, end = Camera(scene.sensors[0], FLOAT).ray(0, 0)
    assert e == (3.5, 1.5, 12.0)  # M (7/8, 3/8, near)
    assert d == (0, 0, 1)
    assert start < 0 < end == 2  # far - near, in world units


def test_pixel_is_the_mean_of_its_grid(load_scene):
    # Background on the left half of the middle pixel of three, black wall on the right.
    wall = """<shape type="rectangle"><transform name="to_world"><translate x="-1"/>
      <scale x="64" y="64" z="-1"/><translate z="3"/></transform>
      <bsdf type="blinnphong"/></shape><emitter type="constant"/>"""
    scene = load_scene(wall, sensor=sensor(size=(3, 1)))
    assert render(scene, grid=2).pixel(1, 0) == (0.5, 0.5, 0.5)
    assert render(scene, grid=2).pixel(0, 0) == (1, 1, 1)
    assert render(scene, grid=2).pixel(2, 0) == (0, 0, 0)


def test_sensors_are_chosen_by_number(scene_file):
    two = sensor() + sensor('<transform name="to_world"><rotate y="1" angle="180"/></transform>')
    scene = load(scene_file(WALL.format(3), sensor=two))
    assert render(scene, sensor=0).pixel(4, 2) == (1, 1, 1)
    assert render(scene, sensor=1).pixel(4, 2) == (0, 0, 0)
