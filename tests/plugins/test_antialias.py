"""Pictures to a target error: the error is kept, nothing random or needless is done, mirrors end where they may."""

from __future__ import annotations

import dataclasses
import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

# Ball, mirror ball, cylinder and polygon over a mirroring floor under two lights: edges of bodies, shadows,
# reflections and highlights, more than two of them in many pixels.
BODY = """
  <bsdf type="blinnphong" id="chrome"><float name="diffuse_reflectance" value="0.2"/>
    <float name="specular_reflectance" value="0.7"/><float name="mirror_reflectance" value="0.6"/></bsdf>
  <bsdf type="twosided" id="board"><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.7"/>
    <float name="mirror_reflectance" value="0.2"/></bsdf></bsdf>
  <shape type="rectangle"><transform name="to_world"><scale value="8"/><rotate x="1" angle="-90"/>
    <translate y="-1" z="5"/></transform><ref id="board"/></shape>
  <shape type="sphere"><point name="center" value="-1, 0, 5"/><ref id="chrome"/></shape>
  <shape type="sphere"><point name="center" value="1, 0.3, 6"/><bsdf type="diffuse"/></shape>
  <shape type="cylinder"><point name="p0" value="0, -1, 7"/><point name="p1" value="0, 1, 7"/>
    <float name="radius" value="0.3"/><ref id="board"/></shape>
  <shape type="polygon"><string name="vertices" value="-3,0,7 -2,0,7 -2,2,7 -2.5,1,7 -3,2,7"/><ref id="board"/></shape>
  <emitter type="point"><point name="position" value="-3, 5, 1"/><float name="intensity" value="20"/></emitter>
  <emitter type="directional"><vector name="direction" value="1, -2, 1"/><float name="irradiance" value="0.4"/>
    </emitter>
  <emitter type="constant"><rgb name="radiance" value="0.2, 0.3, 0.5"/></emitter>
"""

SKY = '<emitter type="constant"><rgb name="radiance" value="0.25, 0.5, 0.75"/></emitter>'

# A glowing half plane whose edge crosses the picture at a slope of 0.3: its coverage of a pixel is known.
HALF_PLANE = """<shape type="rectangle"><transform name="to_world"><translate x="1"/><scale value="40"/>
  <rotate y="1" angle="180"/><rotate z="1" angle="{angle}"/><translate z="10"/></transform>
  <emitter type="area"><float name="radiance" value="1"/></emitter></shape>"""

FILM = '<rfilter type="box"/>'


def aim(scene, target):
    """Give the scene's integrator a target error."""
    integrator = scene.integrator()
    integrator.settings = dataclasses.replace(integrator.settings, target_error=target)
    return integrator


def draw(scene, target):
    aim(scene, target)
    return np.array(mi.render(scene), dtype=np.float64)


def grid(scene, n):
    aim(scene, 0.0)
    return np.array(mi.render(scene, spp=n * n), dtype=np.float64)


def centres(scene, size):
    """Trace the centres of all pixels of a square picture: what `trace` returns."""
    from mitsuba_whitted.trace import trace  # its names need a variant

    stage, camera, plan = scene.integrator()._prepare(scene, scene.sensors()[0])
    x, y = (dr.ravel(part) + 0.5 for part in dr.meshgrid(*[dr.arange(mi.Float, size)] * 2))
    return trace(stage, plan, camera.rays(x, y))


def at_corners(scene, size):
    """Trace the corners of all pixels of a square picture: what `trace` returns."""
    from mitsuba_whitted.trace import trace  # its names need a variant

    stage, camera, plan = scene.integrator()._prepare(scene, scene.sensors()[0])
    x, y = (dr.ravel(part) for part in dr.meshgrid(*[dr.arange(mi.Float, size + 1)] * 2))
    return trace(stage, plan, camera.rays(x, y))


def rms(difference):
    return math.sqrt(np.mean(difference**2))


@pytest.fixture
def converged(llvm_ad_rgb, scene_of):
    """Return the scene, and its picture by a grid of 32 x 32: its own error is a small part of every target here."""
    scene = scene_of(BODY, size=(96, 80))
    return scene, grid(scene, 32)


@pytest.mark.parametrize("target", [1e-2, 3e-3, 1e-3])
def test_the_error_is_below_the_target(converged, target):
    scene, truth = converged
    assert rms(draw(scene, target) - truth) <= target


def test_the_same_error_takes_less_than_half_of_the_rays_of_a_grid(converged):
    scene, truth = converged
    error = rms(draw(scene, 2e-3) - truth)
    rays = sum(scene.integrator().count_rays(scene).values())
    n = next(n for n in range(1, 33) if rms(grid(scene, n) - truth) <= error)
    assert 2 * rays < sum(scene.integrator().count_rays(scene, spp=n * n).values())


@pytest.mark.parametrize("angle", [73.3, 31.7, -20])
def test_the_share_of_a_pixel_that_a_straight_edge_covers_is_known(llvm_ad_rgb, scene_of, angle):
    # In pixels from the middle, x right and y down, the plane is where x cos(angle) + y sin(angle) > 0; its other
    # sides are far away. A pixel's share: the integral of a step over a square, by differences of (d+)^2 / 2ab.
    size, target = 24, 1e-3
    picture = draw(scene_of(HALF_PLANE.format(angle=angle), size=(size, size)), target)
    a, b = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    x, y = np.meshgrid(*[np.arange(size + 1) - size / 2] * 2)
    ramp = np.maximum(0, a * x + b * y) ** 2 / (2 * a * b)
    assert rms(picture[..., 0] - np.diff(np.diff(ramp, axis=0), axis=1)) <= target


def test_the_squares_of_a_checkerboard_are_told_apart(llvm_ad_rgb, scene_of):
    board = """<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><scale value="9"/>
      <rotate z="1" angle="20"/><translate z="6"/></transform><emitter type="area">
      <texture type="checkerboard" name="radiance"/></emitter></shape>"""
    scene = scene_of(board, size=(64, 64))
    assert rms(draw(scene, 3e-3) - grid(scene, 32)) <= 3e-3


def test_texels_smaller_than_a_pixel_keep_the_target(llvm_ad_rgb, scene_of, tmp_path):
    picture = np.random.default_rng(1).integers(0, 256, (48, 48, 3)).astype(np.uint8)
    mi.Bitmap(picture).write(str(tmp_path / "noise.png"))
    board = """<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><scale value="9"/>
      <rotate z="1" angle="20"/><translate z="6"/></transform><emitter type="area">
      <texture type="bitmap" name="radiance"><string name="filename" value="{file}"/>
      <string name="filter_type" value="{filter}"/><transform name="to_uv"><scale value="3"/></transform></texture>
      </emitter></shape>"""
    for name in ("nearest", "bilinear"):
        scene = scene_of(board.format(filter=name, file=tmp_path / "noise.png"), size=(32, 32))
        assert rms(draw(scene, 3e-3) - grid(scene, 64)) <= 3e-3


def test_a_strip_that_no_corner_meets_is_found(llvm_ad_rgb, scene_of):
    # 16 pixels long and a quarter of a pixel wide, within one row.
    strip = """<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/>
      <scale x="0.5" y="0.008"/><translate x="0.01" y="0.0312" z="2"/></transform><emitter type="area">
      <float name="radiance" value="2"/></emitter></shape>"""
    ball = '<shape type="sphere"><point name="center" value="0.6, 0.6, 3"/><float name="radius" value="0.3"/></shape>'
    scene = scene_of(strip + ball + SKY, size=(64, 64))
    corners = np.array(at_corners(scene, 64).colour).T
    assert np.all(corners[:, 0] <= 0.25)  # no sample on the lattice is on the strip
    strip = grid(scene, 32)[..., 0] > 0.5  # a quarter of each of these pixels
    assert strip.sum() == 16
    assert np.all(draw(scene, 3e-4)[strip, 0] > 0.5)


@pytest.mark.parametrize("launches", [None, 0])
def test_little_that_is_left_is_averaged_over_and_not_split(llvm_ad_rgb, scene_of, monkeypatch, launches):
    from mitsuba_whitted import antialias

    quarters, splits = antialias.cells.quarters, []
    monkeypatch.setattr(antialias.cells, "quarters", lambda *some: splits.append(1) or quarters(*some))
    if launches is not None:
        monkeypatch.setattr("mitsuba_whitted.averages.OF_LAUNCHES", launches)
    scene = scene_of(BODY, size=(24, 20))
    assert rms(draw(scene, 3e-3) - grid(scene, 32)) <= 1.5 * 3e-3  # few pixels, as above
    assert bool(splits) == (launches == 0)


def test_estimates_are_written_over_and_not_copied(llvm_ad_rgb, scene_of):
    # They would be, as long as anything that is not computed yet depends on what they were.
    scene = scene_of(BODY, size=(96, 80))
    draw(scene, 1e-3)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        draw(scene, 1e-3)
        history = dr.kernel_history()
    copies = [each["size"] for each in history if str(each["type"]).endswith("Memcpy")]
    assert copies  # counts and sums are fetched
    assert max(copies) < 4 * 4 * 96 * 96  # bytes of all values, in whole squares of 32 x 32 pixels


def test_no_launch_over_all_pixels_is_done_twice(llvm_ad_rgb, scene_of):
    # Estimates and cells are named tuples, which dr.eval passes by: each launch would compute them anew.
    scene = scene_of(BODY, size=(96, 80))
    draw(scene, 3e-2)  # of no smaller error: there, what was hidden is followed by the same launches again
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        draw(scene, 3e-2)
        launches = dr.kernel_history([dr.KernelType.JIT])
    everything = [each for each in launches if each["size"] == 96 * 96]  # whole squares of 32 x 32 pixels
    largest = sorted(each["operation_count"] for each in everything)
    # The estimate itself; nothing else over all pixels comes near it.
    assert largest[-2] < largest[-1] / 2
    hashes = [each["hash"] for each in launches if each["size"] >= 96 * 80]  # also of corners, and in picking cells
    assert len(set(hashes)) == len(hashes) > len(everything)


def test_another_target_error_compiles_nothing(llvm_ad_rgb, scene_of):
    scene = scene_of(BODY, size=(96, 80))
    for target in (1e-2, 4e-3, 2e-3, 1e-3):  # every kernel that refinement has: it does more the smaller the error
        draw(scene, target)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for target in (8e-3, 3e-3, 1.5e-3):
            draw(scene, target)
        launches = dr.kernel_history([dr.KernelType.JIT])
    assert len(launches) > 60  # three pictures, each of the corners, a look and an average: some twenty at the least
    missed = [(each["operation_count"], each["size"]) for each in launches if not each["cache_hit"]]
    assert not missed


def test_one_colour_takes_one_ray_a_corner_and_stays_exact(llvm_ad_rgb, scene_of):
    scene = scene_of(SKY, size=(40, 33))
    assert np.array_equal(draw(scene, 1e-3), np.broadcast_to([0.25, 0.5, 0.75], (33, 40, 3)))
    assert scene.integrator().count_rays(scene) == {"camera": 41 * 34, "mirror": 0, "shadow": 0, "cut": 0}


def test_every_sample_is_counted(llvm_ad_rgb, scene_of):
    scene = scene_of(BODY, size=(32, 32))
    aim(scene, 2e-3)
    taken = dr.zeros(mi.UInt32, 2)

    def heard(x, y, rays, active):
        each = dr.select(x > -dr.inf, mi.UInt32(1), 0)  # one a sample: a constant is added once a launch
        dr.scatter_add(taken, each, mi.UInt32(0), active)
        dr.scatter_add(taken, each * rays, mi.UInt32(1), active)

    counted = scene.integrator().count_rays(scene, heard=heard)
    assert counted["camera"] == taken[0] > 33 * 33
    assert counted["camera"] + counted["mirror"] + counted["shadow"] == taken[1] > taken[0]


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 3), (3, 2), (65, 4)])
def test_pictures_of_any_size_are_drawn_whole(llvm_ad_rgb, scene_of, size):
    picture = draw(scene_of(BODY, '<float name="ambient" value="0.1"/>', size), 1e-3)
    assert picture.shape == (size[1], size[0], 3)
    assert np.all(picture > 0)  # as everything here; what was not written is 0


def test_the_same_bytes_come_again_on_any_number_of_threads(llvm_ad_rgb, scene_of):
    before = dr.thread_count()
    pictures = set()
    try:
        for threads in (1, 2, 3, 1):
            dr.set_thread_count(threads)
            for scene in (scene_of(BODY, size=(96, 80)), scene_of(BODY, size=(96, 80))):
                pictures |= {draw(scene, 1e-3).tobytes(), draw(scene, 1e-3).tobytes()}
    finally:
        dr.set_thread_count(before)
    assert len(pictures) == 1


def test_a_grid_is_drawn_as_if_there_were_no_targets(llvm_ad_rgb, scene_of):
    scene = scene_of(BODY, size=(33, 20))
    before = grid(scene, 2)
    draw(scene, 1e-2)
    assert np.array_equal(grid(scene, 2), before)


def test_bands_and_cells_split_in_turns_keep_the_target(converged, monkeypatch):
    scene, truth = converged
    at_once = draw(scene, 1e-3)
    monkeypatch.setattr("mitsuba_whitted.film.PIXELS_REFINED_AT_ONCE", 96 * 12)
    monkeypatch.setattr("mitsuba_whitted.antialias.SPLIT_AT_ONCE", 50)
    in_turns = draw(scene, 1e-3)
    assert not np.array_equal(in_turns, at_once)  # the patches have found their place
    assert rms(in_turns - truth) <= 1e-3


def test_a_window_of_the_film_keeps_the_target(llvm_ad_rgb, scene_of):
    window = (
        '<integer name="crop_offset_x" value="30"/><integer name="crop_offset_y" value="20"/>'
        '<integer name="crop_width" value="41"/><integer name="crop_height" value="37"/>' + FILM
    )
    scene = scene_of(BODY, size=(96, 80), film=window)
    picture = draw(scene, 1e-3)
    assert picture.shape == (37, 41, 3)
    assert rms(picture - grid(scene, 32)) <= 1.5e-3  # a few pixels: below E in most windows, never above 1.5 E


def test_the_alpha_is_the_share_of_a_pixel_that_bodies_cover(llvm_ad_rgb, scene_of):
    rgba = (
        '<integer name="width" value="32"/><integer name="height" value="32"/>'
        '<string name="pixel_format" value="rgba"/><string name="component_format" value="float32"/>' + FILM
    )
    ball = '<shape type="sphere"><point name="center" value="0, 0, 3"/><bsdf type="diffuse"/></shape>'
    sensor = f'<sensor type="perspective"><float name="fov" value="90"/><film type="hdrfilm">{rgba}</film></sensor>'
    scene = scene_of(ball + SKY, sensor=sensor.replace("{", "{{").replace("}", "}}"))
    picture, truth = draw(scene, 1e-3), grid(scene, 32)
    assert picture.shape == (32, 32, 4)
    # Black ball before the sky: what is covered is not blue, whose radiance is 0.75.
    assert np.allclose(picture[..., 3], 1 - picture[..., 2] / 0.75, atol=8 * 2.0**-24)
    assert 0 < truth[..., 3].mean() < 1


def test_another_variant_draws_the_luminance(llvm_ad_mono, scene_of):
    scene = scene_of(BODY, size=(48, 40))
    picture = draw(scene, 2e-3)
    assert picture.shape == (40, 48, 1)
    assert rms(picture - grid(scene, 32)) <= 1.5 * 2e-3  # see above


HALL = """
  <bsdf type="blinnphong" id="wall"><float name="diffuse_reflectance" value="0.1"/>
    <float name="mirror_reflectance" value="0.9"/></bsdf>
  <shape type="rectangle"><transform name="to_world"><scale value="5000"/><rotate y="1" angle="180"/><translate z="4"/>
    </transform><ref id="wall"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="5000"/><translate z="-4"/></transform>
    <ref id="wall"/></shape>
"""


def test_mirrors_end_where_all_that_they_could_add_is_the_share_of_the_target(llvm_ad_rgb, scene_of):
    # Two endless walls with nothing but ambient light: what a cut ray would have brought is the bound itself.
    target = 1e-2
    scene = scene_of(HALL, '<integer name="max_depth" value="-1"/><float name="ambient" value="1"/>', (16, 16))

    def traced():
        found = centres(scene, 16)
        return np.array(found.colour, dtype=float), np.array(found.mirror_rays), np.array(found.cut_rays)

    everything, all_rays, _ = traced()
    aim(scene, target)
    less, rays, cut = traced()
    rounding = 2 * 160 * 2.0**-24  # of sums of up to 158 terms, 1 in all
    assert np.all(everything - less <= target / 8 + rounding)
    assert np.all(everything - less >= 0.9 * target / 8 - rounding)  # k_m less would have been too much
    assert np.all(cut == 1)
    assert rays.sum() < all_rays.sum() / 2
    assert scene.integrator().count_rays(scene)["cut"] > 0


def test_a_light_inside_the_box_of_a_body_ends_no_mirror(llvm_ad_rgb, scene_of):
    lamp = '<emitter type="point"><point name="position" value="0, 0, 4"/><float name="intensity" value="1"/></emitter>'
    scene = scene_of(HALL + lamp, '<integer name="max_depth" value="-1"/>', (8, 8))
    aim(scene, 1e-2)
    stage, *_ = scene.integrator()._prepare(scene, scene.sensors()[0])
    assert np.array(stage.least_throughput)[0] == np.float32(2.0**-24)


@pytest.mark.parametrize("depth", [0, 3, 200])
def test_a_given_depth_is_never_cut(llvm_ad_rgb, scene_of, depth):
    scene = scene_of(HALL, f'<integer name="max_depth" value="{depth}"/><float name="ambient" value="0.1"/>', (8, 8))
    aim(scene, 0.1)
    assert scene.integrator().count_rays(scene)["cut"] == 0


def test_paths_differ_by_the_objects_met_and_by_the_lights_seen(llvm_ad_rgb, scene_of):
    # Floor in light, floor in the shadow of the ball, ball, sky: four paths, and none of them twice.
    ball = '<shape type="sphere"><point name="center" value="0, 0, 5"/></shape>'
    floor = """<shape type="rectangle"><transform name="to_world"><scale value="9"/><rotate x="1" angle="-90"/>
      <translate y="-2" z="9"/></transform></shape>"""
    sun = '<emitter type="directional"><vector name="direction" value="0.3, -1, 0"/></emitter>'
    scene = scene_of(ball + floor + sun, "", (64, 64))
    found = centres(scene, 64)
    colour, path = np.array(found.colour), np.array(found.path)
    lit_floor, sky = path[63 * 64], path[0]
    assert len({*path}) == 5  # and the ball's far side from the sun
    assert np.all(colour[:, path == sky] == 0)
    assert np.ptp(colour[:, path == lit_floor]) <= 64 * 2.0**-24


def test_the_inside_of_a_one_sided_surface_is_a_path_of_its_own(llvm_ad_rgb, scene_of):
    # An open tube, into which the camera looks at a slant: sky, outside, and the inside, which shows nothing.
    tube = """<shape type="cylinder"><point name="p0" value="0.2, -0.3, 4"/><point name="p1" value="-0.2, 0.3, 6"/>
      <float name="radius" value="0.5"/><bsdf type="blinnphong" id="shell"/></shape>"""
    two_sided = tube.replace("<bsdf", '<bsdf type="twosided"><bsdf').replace("</shape>", "</bsdf></shape>")
    for body in (tube, two_sided):
        path = np.array(centres(scene_of(body, "", (64, 64)), 64).path)
        assert len({*path}) == 3


@pytest.mark.parametrize(
    "look",
    [
        '<emitter type="area"><texture type="checkerboard" name="radiance">{to_uv}</texture></emitter>',
        '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance">{to_uv}</texture></bsdf>',
        '<bsdf type="blinnphong"><texture type="checkerboard" name="mirror_reflectance">{to_uv}</texture></bsdf>',
    ],
)
def test_every_square_of_a_checkerboard_is_a_path_of_its_own(llvm_ad_rgb, scene_of, look):
    # The board fills the view: 3 x 2 periods are 6 x 4 squares, and what lies 1/4 further on has 7 columns.
    for shift, squares in ((0, 6 * 4), (0.25, 7 * 4)):
        to_uv = f'<transform name="to_uv"><scale x="3" y="2"/><translate x="{shift}"/></transform>'
        board = f"""<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><scale value="4"/>
          <translate z="4"/></transform>{look.format(to_uv=to_uv)}</shape>"""
        found = centres(scene_of(board, size=(36, 36)), 36)
        assert len({*np.array(found.path)}) == squares


@pytest.mark.parametrize("filter_type", ["nearest", "bilinear"])
def test_halves_of_texels_are_paths_of_their_own(llvm_ad_rgb, scene_of, tmp_path, filter_type):
    # The board fills the view, the bitmap the board once: 5 x 3 texels, each with four quarters.
    mi.Bitmap(np.zeros((3, 5, 3), np.uint8)).write(str(tmp_path / "black.png"))
    board = f"""<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><scale value="4"/>
      <translate z="4"/></transform><emitter type="area"><texture type="bitmap" name="radiance">
      <string name="filename" value="{tmp_path}/black.png"/>
      <string name="filter_type" value="{filter_type}"/></texture></emitter></shape>"""
    found = centres(scene_of(board, size=(60, 60)), 60)
    assert len({*np.array(found.path)}) == 10 * 6


@pytest.mark.parametrize("value", ["-0.001", "nan", "inf"])
def test_a_target_that_is_no_error_is_refused(llvm_ad_rgb, scene_of, value):
    with pytest.raises(RuntimeError, match=r"target_error .* is out of range; it must be finite and not negative"):
        scene_of(SKY, f'<float name="target_error" value="{value}"/>')


def test_another_filter_than_the_box_is_refused(llvm_ad_rgb, scene_of):
    scene = scene_of(SKY, '<float name="target_error" value="0.01"/>', film='<rfilter type="tent"/>')
    with pytest.raises(ValueError, match=r"target_error needs the filter `box` of radius 0\.5"):
        scene.integrator().render(scene)


def test_a_variant_without_vectors_is_refused(scalar_rgb, scene_of):
    scene = scene_of(SKY, '<float name="target_error" value="0.01"/>')
    with pytest.raises(ValueError, match="target_error needs a variant that begins with llvm or cuda"):
        scene.integrator().render(scene)
