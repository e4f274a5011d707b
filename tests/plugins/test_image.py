"""How samples become a picture: rays, grid, film (section 4 of the model).

Most of these tests look at a screen that shows where each ray went: a white wall z = 4 under a red, a green and a
blue lamp of constant strength, so that the colour at a point is the cosine towards each lamp.
"""

from __future__ import annotations

import functools
import math
import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

ORIGIN = np.zeros(3)
LAMPS = np.array([[-3, 1, 0], [2, 3, 1], [1, -4, 0.5]])
TEXTBOOK = '<string name="falloff" value="none"/>'
WHITE = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="1"/></bsdf>'
SCREEN = f"""<shape type="rectangle" id="wall"><transform name="to_world"><scale value="-512, 512, -512"/>
  <translate z="4"/></transform>{WHITE}</shape>""" + "".join(
    f"""<emitter type="point" id="lamp{i}"><point name="position" value="{x}, {y}, {z}"/>
    <rgb name="intensity" value="{", ".join("1" if i == j else "0" for j in range(3))}"/></emitter>"""
    for i, (x, y, z) in enumerate(LAMPS)
)
NEAR_WALL = """<shape type="rectangle" id="wall"><transform name="to_world"><scale value="-512, 512, -512"/>
  <translate z="{z}"/></transform><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/>
  <float name="mirror_reflectance" value="{k_m}"/></bsdf></shape>"""
SUN = '<emitter type="directional" id="sun"><vector name="direction" value="0, 0, 1"/></emitter>'
SKY = '<emitter type="constant" id="sky"><float name="radiance" value="0.25"/></emitter>'


def sensor(parameters="", kind="perspective"):
    return f'<sensor type="{kind}" id="camera">{parameters}{{film}}</sensor>'


def fov(degrees, axis="x"):
    return f'<float name="fov" value="{degrees}"/><string name="fov_axis" value="{axis}"/>'


def on_screen(e, d):
    """Offset of the lamps from the point of the screen that the ray e + t d meets, and t."""
    t = (4 - e[..., 2]) / d[..., 2]
    return LAMPS - (e + t[..., None] * d)[..., None, :], t


def screen(d, e=ORIGIN):
    """n.l for each lamp, n = (0, 0, -1)."""
    return (4 - LAMPS[:, 2]) / np.linalg.norm(on_screen(e, d)[0], axis=-1)


def condition(d, e=ORIGIN):
    """1 / (n.l) + 3 t / r."""
    offset, t = on_screen(e, d)
    r = np.linalg.norm(offset, axis=-1)
    return r / (4 - LAMPS[:, 2]) + 3 * t[..., None] / r


def condition_of_samples(d):
    """Add how fast n.l changes when a ray turns, relative to n.l: at most t / (r cos(angle to the axis))."""
    offset, t = on_screen(ORIGIN, d)
    return condition(d) + (t / d[..., 2])[..., None] / np.linalg.norm(offset, axis=-1)


def film_positions(width, height, n=1):
    """Positions fx, fy in [0, 1] of the samples: (height, width, n, n)."""
    s = (np.arange(n) + 0.5) / n
    x = np.arange(width)[None, :, None, None] + s[None, None, None, :]
    y = np.arange(height)[:, None, None, None] + s[None, None, :, None]
    return np.broadcast_arrays(x / width, y / height)


def rays(fx, fy, tan, aspect):
    """Give normalize((1-2fx) T, (1-2fy) T H/W, 1), aspect = H/W."""
    d = np.stack([(1 - 2 * fx) * tan, (1 - 2 * fy) * tan * aspect, np.ones_like(fx)], axis=-1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def pixel_rays(width, height, tan):
    fx, fy = film_positions(width, height)
    return rays(fx, fy, tan, height / width)[:, :, 0, 0]


# ---------------------------------------------------------------------------------------------- perspective
def test_a_pixel_shows_what_lies_behind_its_centre(any_rgb, see, agree, directions):
    d = directions(5, 3)
    agree(see(SCREEN, TEXTBOOK, (5, 3)), screen, d, condition(d))


@pytest.mark.parametrize("size", [(6, 4), (4, 6), (5, 5)])
@pytest.mark.parametrize("axis", ["x", "y", "diagonal", "smaller", "larger"])
def test_fov_spans_the_axis_that_is_named(llvm_ad_rgb, see, agree, axis, size):
    width, height = size
    tan = math.tan(math.radians(60) / 2)
    if axis == "y" or (axis == "smaller" and width > height) or (axis == "larger" and width <= height):
        tan *= width / height
    elif axis == "diagonal":
        tan /= math.sqrt(1 + (height / width) ** 2)
    d = pixel_rays(width, height, tan)
    agree(see(SCREEN, TEXTBOOK, size, sensor(fov(60, axis))), screen, d, condition(d))


def test_without_a_fov_the_lens_has_50_mm_on_a_frame_of_36_by_24(llvm_ad_rgb, see, agree):
    d = pixel_rays(6, 4, math.hypot(36, 24) / 2 / 50 / math.sqrt(1 + (4 / 6) ** 2))
    agree(see(SCREEN, TEXTBOOK, (6, 4), sensor()), screen, d, condition(d))


@pytest.mark.parametrize("degrees", [0.01, 1, 120])
def test_narrow_and_wide_views_keep_the_accuracy_of_a_direction(llvm_ad_rgb, see, agree, degrees):
    d = pixel_rays(4, 4, math.tan(math.radians(degrees) / 2))
    agree(see(SCREEN, TEXTBOOK, (4, 4), sensor(fov(degrees))), screen, d, condition(d))


def test_principal_point_shifts_the_film_by_a_share_of_its_size(llvm_ad_rgb, see, agree):
    shift = """<float name="principal_point_offset_x" value="0.25"/>
      <float name="principal_point_offset_y" value="-0.125"/>"""
    fx, fy = film_positions(6, 4)
    d = rays(fx + 0.25, fy - 0.125, 1.0, 4 / 6)[:, :, 0, 0]
    agree(see(SCREEN, TEXTBOOK, (6, 4), sensor(fov(90) + shift)), screen, d, condition(d))


def test_camera_looks_along_its_z_from_where_it_stands(llvm_ad_rgb, see, agree):
    # Rows of the rotation: x = up x z, y, z, with z the direction to the target.
    e, target, up = np.array([1.0, -2.0, -3.0]), np.array([0.5, 1.0, 4.0]), np.array([0.0, 1.0, 0.0])
    z = (target - e) / np.linalg.norm(target - e)
    x = np.cross(up, z) / np.linalg.norm(np.cross(up, z))
    to_world = """<transform name="to_world"><lookat origin="1, -2, -3" target="0.5, 1, 4" up="0, 1, 0"/>
      </transform>"""
    d = pixel_rays(6, 4, 1.0) @ np.stack([x, np.cross(z, x), z])
    picture = see(SCREEN, TEXTBOOK, (6, 4), sensor(fov(90) + to_world))
    agree(picture, functools.partial(screen, e=e), d, condition(d, e))


def test_crop_window_is_cut_from_the_full_film(any_rgb, see, agree):
    crop = """<integer name="crop_offset_x" value="2"/><integer name="crop_offset_y" value="1"/>
      <integer name="crop_width" value="3"/><integer name="crop_height" value="2"/><rfilter type="box"/>"""
    picture = see(SCREEN, TEXTBOOK, (7, 5), film=crop)
    d = pixel_rays(7, 5, 1.0)[1:3, 2:5]
    assert picture.shape == (2, 3, 3)
    agree(picture, screen, d, condition(d))


def test_crop_and_principal_point_add_up(llvm_ad_rgb, see, agree):
    crop = """<integer name="crop_offset_x" value="1"/><integer name="crop_offset_y" value="2"/>
      <integer name="crop_width" value="4"/><integer name="crop_height" value="3"/><rfilter type="box"/>"""
    shift = '<float name="principal_point_offset_x" value="-0.25"/>'
    fx, fy = film_positions(8, 6)
    d = rays(fx - 0.25, fy, 1.0, 6 / 8)[2:5, 1:5, 0, 0]
    picture = see(SCREEN, TEXTBOOK, (8, 6), sensor(fov(90) + shift), crop, spp=1)
    agree(picture, screen, d, condition(d))


def test_each_sensor_draws_its_own_picture(any_rgb, scene_of, agree):
    second = sensor(fov(40)).format(film='<film type="hdrfilm"><rfilter type="box"/></film>')
    second = second.replace('id="camera"', 'id="second"').replace(
        '<rfilter type="box"/>',
        '<integer name="width" value="3"/><integer name="height" value="3"/><rfilter type="box"/>',
    )
    scene = scene_of(SCREEN + second, TEXTBOOK, (5, 5), sensor(fov(90)))
    for width, degrees, chosen in ((5, 90, 0), (3, 40, 1), (3, 40, scene.sensors()[1]), (5, 90, 0)):
        d = pixel_rays(width, width, math.tan(math.radians(degrees) / 2))
        agree(np.array(mi.render(scene, sensor=chosen, spp=1), float), screen, d, condition(d))


def test_a_sensor_that_is_neither_perspective_nor_orthographic_sends_mitsubas_rays(any_rgb, see, agree):
    # Mitsuba's own ray starts a rounding away: the accuracy is that of the screen, which faces it.
    meter = sensor('<point name="origin" value="1, 2, 0"/><vector name="direction" value="0, 0, 1"/>', "radiancemeter")
    e, d = np.array([1.0, 2.0, 0.0]), np.array([[[0.0, 0.0, 1.0]]])
    agree(see(SCREEN, TEXTBOOK, sensor=meter), functools.partial(screen, e=e), d, condition(d, e))


# --------------------------------------------------------------------------------------------- orthographic
def test_orthographic_rays_are_parallel_and_start_on_the_film(any_rgb, see, agree):
    # Distances to the screen (2.5 and more) exceed the film's half sides 1 and 2/3: a ray turned by 64 u moves by
    # more than any rounding of its origin.
    fx, fy = film_positions(6, 4)
    e = np.stack([1 - 2 * fx, (1 - 2 * fy) * 4 / 6, np.full_like(fx, 0.01)], axis=-1)[:, :, 0, 0]
    d = np.broadcast_to([0.0, 0.0, 1.0], e.shape)
    picture = see(SCREEN, TEXTBOOK, (6, 4), sensor(kind="orthographic"))
    agree(picture, functools.partial(screen, e=e), d, condition(d, e))


def test_orthographic_scale_widens_the_view(llvm_ad_rgb, see, agree):
    to_world = '<transform name="to_world"><scale value="2, 2, 1"/><translate value="0.5, 0, -4"/></transform>'
    fx, fy = film_positions(5, 5)
    e = np.stack([2 * (1 - 2 * fx) + 0.5, 2 * (1 - 2 * fy), np.full_like(fx, -4)], axis=-1)[:, :, 0, 0]
    d = np.broadcast_to([0.0, 0.0, 1.0], e.shape)
    picture = see(SCREEN, TEXTBOOK, (5, 5), sensor(to_world, "orthographic"))
    agree(picture, functools.partial(screen, e=e), d, condition(d, e))


# -------------------------------------------------------------------------------------------------- clipping
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    ("near", "far", "seen"),
    [
        (4, 8, True),
        (1, 4, True),
        (4.001, 8, False),
        (1, 3.999, False),
    ],
)
def test_clip_planes_are_closed_and_bound_the_depth_along_the_axis(any_variant, see, kind, near, far, seen):
    view = f'<float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/>'
    view = view + fov(90) if kind == "perspective" else view
    picture = see(NEAR_WALL.format(z=4, k_m=0) + SUN + SKY, sensor=sensor(view, kind))
    assert np.all(picture == (0.5 if seen else 0.25))


def test_depth_is_not_distance(llvm_ad_rgb, see):
    # Corner rays of a view of 120 degrees travel 2.4 times as far as the depth of the wall.
    view = fov(120) + '<float name="near_clip" value="3.99"/><float name="far_clip" value="4.01"/>'
    picture = see(NEAR_WALL.format(z=4, k_m=0) + SUN + SKY, size=(8, 8), sensor=sensor(view))
    assert np.all(picture > 0.25)


@pytest.mark.parametrize(("z", "seen"), [(0.0101, True), (0.0099, False), (9990, True), (10010, False)])
def test_default_clip_planes_are_those_of_mitsuba(any_variant, see, z, seen):
    picture = see(NEAR_WALL.format(z=z, k_m=0) + SUN + SKY)
    assert np.all((picture > 0.25) == seen)


def test_mirror_and_shadow_rays_know_no_clip_plane(any_variant, see):
    # The mirror at z = 4 shows a wall at z = -8, farther than far_clip; a plate at z = 1, before near_clip,
    # shades the wall from the sun and is not seen itself.
    view = fov(90) + '<float name="near_clip" value="2"/><float name="far_clip" value="5"/>'
    behind = """<shape type="rectangle" id="behind"><transform name="to_world"><scale value="64"/>
      <translate z="-8"/></transform><emitter type="area"><float name="radiance" value="3"/></emitter></shape>"""
    mirror = NEAR_WALL.format(z=4, k_m=1).replace("0.5", "0")
    assert np.all(see(mirror + behind, sensor=sensor(view)) == 3)
    plate = """<shape type="disk" id="plate"><transform name="to_world"><translate z="1"/></transform></shape>"""
    wall = NEAR_WALL.format(z=4, k_m=0) + SUN
    assert np.all(see(wall, sensor=sensor(view)) == 0.5)
    assert np.all(see(wall + plate, sensor=sensor(view)) == 0)


# ---------------------------------------------------------------------------------------------------- samples
@pytest.mark.parametrize("n", [2, 3])
def test_a_pixel_is_the_mean_of_a_grid(any_rgb, see, agree, n):
    # A mean of n^2 numbers adds n^2 roundings at most; one flat hit leaves 10 unused, those of the mirror direction.
    fx, fy = film_positions(4, 3, n)
    samples = rays(fx, fy, 1.0, 3 / 4)
    mean = screen(samples).mean(axis=(2, 3))
    error = (condition_of_samples(samples) * screen(samples)).mean(axis=(2, 3))
    agree(see(SCREEN, TEXTBOOK, (4, 3), spp=n * n), mean, condition=error / mean)


def test_a_number_that_is_no_square_becomes_the_next_square(llvm_ad_rgb, scene_of):
    scene = scene_of(SCREEN, TEXTBOOK, (4, 3))
    by_spp = {spp: np.array(mi.render(scene, spp=spp)).tobytes() for spp in (1, 2, 4, 5, 8, 9, 10, 16)}
    assert by_spp[2] == by_spp[4] != by_spp[1]
    assert by_spp[5] == by_spp[8] == by_spp[9] != by_spp[4]
    assert by_spp[10] == by_spp[16] != by_spp[9]


@pytest.mark.parametrize(("sampler", "spp"), [("", 4), ('<integer name="sample_count" value="9"/>', 9)])
def test_without_spp_the_samplers_count_is_taken(llvm_ad_rgb, see, sampler, spp):
    view = sensor(fov(90) + f'<sampler type="independent" id="sampler">{sampler}</sampler>')
    assert np.array_equal(see(SCREEN, TEXTBOOK, (4, 3), view, spp=0), see(SCREEN, TEXTBOOK, (4, 3), view, spp=spp))


def test_seed_changes_nothing(llvm_ad_rgb, scene_of):
    scene = scene_of(SCREEN, TEXTBOOK, (4, 3))
    assert np.array_equal(np.array(mi.render(scene, spp=4, seed=0)), np.array(mi.render(scene, spp=4, seed=7)))


# ----------------------------------------------------------------------------------------------------- filters
@pytest.mark.parametrize("rfilter", ["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"])
def test_no_filter_changes_an_even_picture(any_rgb, see, agree, rfilter):
    # Weights are normalised: only their roundings remain, at most 8 x 8 samples in a filter of radius 4 or less,
    # whose absolute weights sum up to less than twice their sum.
    picture = see(SKY, size=(6, 5), film=f'<rfilter type="{rfilter}"/>')
    agree(picture, 0.25, condition=2)


@pytest.mark.parametrize(
    ("rfilter", "weight"),
    [
        ('<rfilter type="tent"/>', lambda x: np.maximum(0, 1 - np.abs(x))),
        (
            '<rfilter type="tent"><float name="radius" value="2"/></rfilter>',
            lambda x: np.maximum(0, 1 - np.abs(x) / 2),
        ),
    ],
)
def test_a_filter_weighs_the_samples_of_the_window_by_their_distance(any_rgb, see, agree, rfilter, weight):
    # A grid of 2 x 2, since a tent has only the weights 1 and 0 at whole pixels: samples +-1/4 and +-3/4 away.
    n, width, height = 2, 5, 4
    fx, fy = film_positions(width, height, n)
    d = rays(fx, fy, 1.0, height / width)
    samples = screen(d)
    x, y = fx * width, fy * height
    expected = np.empty((height, width, 3))
    for row, column in np.ndindex(height, width):
        dx, dy = x - column - 0.5, y - row - 0.5
        w = weight(dx) * weight(dy)
        expected[row, column] = (w[..., None] * samples).sum(axis=(0, 1, 2, 3)) / w.sum()
    picture = see(SCREEN, TEXTBOOK, (width, height), film=rfilter, spp=n * n)
    agree(picture, expected, condition=condition_of_samples(d).max())


# --------------------------------------------------------------------------------------------------- channels
BALL_ON_NOTHING = f"""<shape type="sphere" id="ball"><point name="center" value="0, 0, 4"/>{WHITE}</shape>
  <emitter type="directional" id="sun"><vector name="direction" value="0, 0, 1"/>
  <rgb name="irradiance" value="0.25, 0.5, 1"/></emitter>"""


def formatted(scene_of, body, pixel_format, size=(3, 3)):
    film = f"""<film type="hdrfilm"><integer name="width" value="{size[0]}"/>
      <integer name="height" value="{size[1]}"/><string name="component_format" value="float32"/>
      <string name="pixel_format" value="{pixel_format}"/><rfilter type="box"/></film>"""
    scene = scene_of(body, sensor=sensor(fov(90)).format(film=film))
    return scene, np.array(mi.render(scene, spp=1), dtype=np.float64)


def test_alpha_is_one_where_something_is_hit(any_rgb, scene_of):
    # Only the middle pixel of 3 x 3 meets the ball: the others look past it, by 1/3 of the film at least.
    _, picture = formatted(scene_of, BALL_ON_NOTHING, "rgba")
    assert picture.shape == (3, 3, 4)
    assert np.array_equal(picture[:, :, 3], np.pad([[1.0]], 1))


def test_alpha_counts_a_black_back_as_hit(any_rgb, scene_of):
    turned = BALL_ON_NOTHING.replace("<point", '<boolean name="flip_normals" value="true"/><point')
    _, picture = formatted(scene_of, turned, "rgba")
    assert np.array_equal(picture[1, 1], [0, 0, 0, 1])


def test_luminance_is_rec_709s(any_rgb, scene_of, agree):
    _, rgb = formatted(scene_of, BALL_ON_NOTHING, "rgb")
    agree(rgb[1, 1], [0.25, 0.5, 1])
    _, grey = formatted(scene_of, BALL_ON_NOTHING, "luminance")
    assert grey.shape == (3, 3, 1)
    # Mitsuba's coefficients for linear Rec. 709 with white D65
    agree(grey[1, 1], 0.212671 * 0.25 + 0.715160 * 0.5 + 0.072169 * 1)


def test_luminance_with_alpha_has_two_channels(llvm_ad_rgb, scene_of):
    _, picture = formatted(scene_of, BALL_ON_NOTHING, "luminance_alpha")
    assert picture.shape == (3, 3, 2)
    assert np.array_equal(picture[:, :, 1], np.pad([[1.0]], 1))


def test_mono_is_the_luminance_of_the_same(llvm_ad_mono, see, agree):
    agree(see(BALL_ON_NOTHING, size=(1, 1)), 0.212671 * 0.25 + 0.715160 * 0.5 + 0.072169 * 1)


# ------------------------------------------------------------------------------------------------ the film after
@pytest.mark.parametrize("pixel_format", ["rgb", "rgba", "luminance"])
@pytest.mark.parametrize("spp", [1, 4])
def test_the_film_holds_the_picture_afterwards(any_rgb, scene_of, pixel_format, spp):
    scene, _ = formatted(scene_of, BALL_ON_NOTHING, pixel_format, (5, 4))
    picture = np.array(mi.render(scene, spp=spp))
    film = scene.sensors()[0].film()
    bitmap = np.array(film.bitmap(), dtype=np.float32).reshape(picture.shape)
    # Storage divides by a weight of 1 and converts to luminance in another order: 4 roundings at most.
    assert np.all(np.abs(bitmap - picture) <= 4 * 2.0**-24 * np.abs(picture))
    developed = np.array(film.develop()).reshape(picture.shape)
    assert np.all(np.abs(developed - picture) <= 4 * 2.0**-24 * np.abs(picture))


def test_written_files_hold_the_picture(any_rgb, scene_of, tmp_path: Path):
    scene, picture = formatted(scene_of, BALL_ON_NOTHING, "rgb", (5, 4))
    mi.util.write_bitmap(str(tmp_path / "tensor.exr"), mi.TensorXf(picture.astype(np.float32)), write_async=False)
    scene.sensors()[0].film().write(str(tmp_path / "film.exr"))
    mi.util.write_bitmap(str(tmp_path / "tensor.png"), mi.render(scene, spp=1), write_async=False)
    for name in ("tensor.exr", "film.exr"):
        assert np.array_equal(np.array(mi.Bitmap(str(tmp_path / name)), dtype=np.float64), picture)
    assert tuple(mi.Bitmap(str(tmp_path / "tensor.png")).size()) == (5, 4)


def test_a_second_picture_replaces_the_first_on_the_film(any_rgb, scene_of):
    scene, picture = formatted(scene_of, BALL_ON_NOTHING, "rgb", (5, 4))
    mi.render(scene, spp=16)
    mi.render(scene, spp=1)
    assert np.array_equal(np.array(scene.sensors()[0].film().bitmap(), dtype=np.float64), picture)


def test_a_picture_can_be_drawn_for_the_film_alone(llvm_ad_rgb, scene_of):
    scene, picture = formatted(scene_of, BALL_ON_NOTHING, "rgb", (5, 4))
    integrator, camera = scene.integrator(), scene.sensors()[0]
    camera.film().clear()
    assert np.array(integrator.render(scene, camera, spp=1, develop=False)).size == 0
    assert np.array_equal(np.array(camera.film().bitmap(), dtype=np.float64), picture)


PICTURES_OF_SCENES_THAT_ARE_GONE = """
import mitsuba_whitted
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")

def scene(*shapes):
    return mi.load_dict({"type": "scene", "integrator": {"type": "whitted"}, "sky": {"type": "constant"},
                         "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "filter": {"type": "box"}}},
                         **{f"{shape}{i}": {"type": shape} for i, shape in enumerate(shapes)}})

pictures = []
for _ in range(20):
    pictures.append(mi.render(scene("sphere"), spp=1))
    others = [scene(*["rectangle"] * 3) for _ in range(5)]  # take over the memory of the scene that is gone
assert all(np.array_equal(np.array(picture), np.array(pictures[0])) for picture in pictures)
"""


def test_a_picture_outlives_its_scene(llvm_ad_rgb):
    # In a process of its own, since reading a freed scene ends the process.
    script = [sys.executable, "-c", PICTURES_OF_SCENES_THAT_ARE_GONE]
    ended = subprocess.run(script, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 0, ended.stderr


def test_a_picture_can_be_asked_for_later(llvm_ad_rgb, scene_of):
    scene, picture = formatted(scene_of, BALL_ON_NOTHING, "rgb", (5, 4))
    later = scene.integrator().render(scene, scene.sensors()[0], spp=1, evaluate=False)
    assert np.array_equal(np.array(later, dtype=np.float64), picture)
