"""What each `max_depth` shows, and where -1 ends (section 1 of the model).

All numbers here are sums of few powers of two along rays on an axis: every expected value is exact.
"""

import mitsuba as mi
import numpy as np
import pytest

SKY = '<emitter type="constant" id="sky"><float name="radiance" value="0.25"/></emitter>'
SUN = """<emitter type="directional" id="sun"><vector name="direction" value="0, 0, {z}"/>
  <float name="irradiance" value="2"/></emitter>"""
NOTHING = ""


def depth(n):
    return f'<integer name="max_depth" value="{n}"/>'


AMBIENT = '<rgb name="ambient" value="1"/>'


def blinnphong(k_d=0.0, k_m=0.0, k_a=0.0):
    return f"""<bsdf type="blinnphong"><float name="diffuse_reflectance" value="{k_d}"/>
      <float name="mirror_reflectance" value="{k_m}"/><float name="ambient_reflectance" value="{k_a}"/></bsdf>"""


def wall(z, inside):
    """Make a wall in the plane z that faces the camera, which stands in the origin."""
    return f"""<shape type="rectangle" id="wall{z}"><transform name="to_world">
      <scale value="{-8 if z > 0 else 8}, 8, {-8 if z > 0 else 8}"/><translate z="{z}"/></transform>{inside}</shape>"""


def ray_between_mirrors(bounces, k_m, integrator):
    """Describe two mirrors in z = +-1, between which a ray at 45 degrees is reflected `bounces` times before the sky.

    It meets them in |x| = 1, 3, 5, ...; they end half-way between the last of these and the next.
    """
    size = 2 * bounces
    material = f"""<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
      <rgb name="mirror_reflectance" value="{k_m}"/></bsdf>"""
    sensor = """<sensor type="perspective"><float name="fov" value="1"/><transform name="to_world">
      <lookat origin="0, 0, 0" target="1, 0, 1" up="0, 1, 0"/></transform>{film}</sensor>"""
    mirrors = f"""
      <shape type="rectangle" id="front"><transform name="to_world"><scale value="-{size}, 8, -{size}"/>
        <translate z="1"/></transform>{material}</shape>
      <shape type="rectangle" id="behind"><transform name="to_world"><scale value="{size}, 8, {size}"/>
        <translate z="-1"/></transform>{material}</shape>"""
    sky = f'<emitter type="constant" id="sky"><float name="radiance" value="{2.0**30}"/></emitter>'
    return {"body": mirrors + sky, "integrator": integrator, "sensor": sensor}


LAMP = '<emitter type="area"><float name="radiance" value="4"/></emitter>'
MATTE = blinnphong(k_d=0.5)
MIRROR = blinnphong(k_m=0.5)


@pytest.mark.parametrize(
    ("body", "colours"),
    [
        pytest.param(SKY, [0, 0.25, 0.25, 0.25], id="sky"),
        pytest.param(wall(4, LAMP), [0, 4, 4, 4], id="lamp"),
        pytest.param(wall(4, MATTE) + SUN.format(z=1), [0, 0, 1, 1], id="lit wall"),
        pytest.param(wall(4, MATTE + LAMP) + SUN.format(z=1), [0, 4, 5, 5], id="lit lamp"),
        pytest.param(wall(4, MIRROR), [0, 0, 0, 0], id="mirror before nothing"),
        pytest.param(wall(4, MIRROR) + SKY, [0, 0, 0.125, 0.125], id="sky in a mirror"),
        pytest.param(wall(4, MIRROR) + wall(-4, LAMP), [0, 0, 2, 2], id="lamp in a mirror"),
        pytest.param(
            wall(4, MIRROR) + wall(-4, MATTE) + SUN.format(z=-1), [0, 0, 0, 0], id="shadow of the mirror itself"
        ),
    ],
)
def test_each_depth_shows_one_thing_more(any_variant, see, body, colours):
    for n, colour in enumerate(colours):
        assert np.all(see(body, depth(n)) == colour), n


def test_lit_surfaces_appear_in_mirrors_at_depth_three(any_variant, see):
    # The lamp stands between, in a corner: the point (0, 0, -4) sees it at distance 5 under n.l = 4/5, so that
    # k_d I n.l = 1/2 * 125/2 / 25 * 4/5 = 1, up to its few roundings; the mirror halves it.
    body = (
        wall(4, MIRROR)
        + wall(-4, MATTE)
        + """<emitter type="point" id="bulb">
      <point name="position" value="3, 0, 0"/><float name="intensity" value="62.5"/></emitter>"""
    )
    pictures = [see(body, depth(n)) for n in range(5)]
    assert all(np.all(picture == 0) for picture in pictures[:3])
    assert np.all(pictures[3] > 0)
    assert np.all(np.abs(pictures[3] - 0.5) <= 16 * 2.0**-24 * 0.5)  # l 6, n.l 3, 1/r^2 3, products 4
    assert np.array_equal(pictures[4], pictures[3])


@pytest.mark.parametrize("n", [*range(8), 10, 15, 24])
def test_parallel_mirrors_add_up_a_geometric_series(any_variant, see, n):
    # Hits k = 0 .. n - 2 add k_a I_a k_m^k = 2^-k each: 2 - 2^(2 - n) in all.
    both = blinnphong(k_a=1, k_m=0.5)
    picture = see(wall(4, both) + wall(-2, both), AMBIENT + depth(n))
    assert np.all(picture == (2 - 2.0 ** (2 - n) if n > 1 else 0))


def test_default_depth_is_ten(any_variant, see):
    both = blinnphong(k_a=1, k_m=0.5)
    assert np.all(see(wall(4, both) + wall(-2, both), AMBIENT) == 2 - 2.0**-8)


def test_sky_behind_the_last_mirror_belongs_to_the_picture(any_variant, see):
    # Two mirrors, then the sky: k = 2, seen from depth 3.
    for n, seen in ((2, False), (3, True), (4, True)):
        picture = see(**ray_between_mirrors(2, "0.5, 0.5, 0.5", depth(n)))
        assert np.all(picture == (2.0**28 if seen else 0))


def test_mirrors_multiply_channel_by_channel(llvm_ad_rgb, see):
    picture = see(**ray_between_mirrors(3, "0.5, 0.25, 1", depth(10)))
    assert np.array_equal(picture[0, 0], [2.0**27, 2.0**24, 2.0**30])


@pytest.mark.parametrize(
    ("bounces", "k_m", "colour"),
    [
        (3, [2.0**-8] * 3, [2.0**6] * 3),  # a product of exactly 2^-24 is not below it
        (3, [2.0**-8 * (1 - 2.0**-20)] * 3, [0, 0, 0]),
        (4, [2.0**-8] * 3, [0, 0, 0]),
        (2, [2.0**-13, 2.0**-12, 0], [2.0**4, 2.0**6, 0]),  # one channel keeps the ray, for all of them
        (2, [2.0**-13, 2.0**-13, 0], [0, 0, 0]),
    ],
)
def test_without_a_depth_a_ray_ends_when_the_product_of_k_m_is_below_2_to_the_minus_24(
    any_rgb, see, bounces, k_m, colour
):
    picture = see(**ray_between_mirrors(bounces, ", ".join(map(str, k_m)), depth(-1)))
    assert np.array_equal(picture[0, 0], colour)


def test_with_a_depth_a_faint_ray_is_followed(any_rgb, see):
    picture = see(**ray_between_mirrors(4, f"{2.0**-8}, {2.0**-8}, {2.0**-8}", depth(100)))
    assert np.all(picture == 2.0 ** (30 - 32))


def test_without_a_depth_a_ray_ends_after_1024_bounces(any_variant, see):
    # Perfect mirrors: hits k = 0 .. 1024 add 2^-12 each.
    both = blinnphong(k_a=2.0**-12, k_m=1)
    picture = see(wall(4, both) + wall(-2, both), AMBIENT + depth(-1))
    assert np.all(picture == 1025 * 2.0**-12)


def test_with_a_depth_there_is_no_limit_of_bounces(llvm_ad_rgb, see):
    both = blinnphong(k_a=2.0**-12, k_m=1)
    picture = see(wall(4, both) + wall(-2, both), AMBIENT + depth(2000))
    assert np.all(picture == 1999 * 2.0**-12)


def test_scenes_of_different_depth_do_not_share_a_kernel(llvm_ad_rgb, scene_of):
    # Drawn in turns: what was compiled for one depth must not be taken for another.
    both = blinnphong(k_a=1, k_m=0.5)
    scenes = [scene_of(wall(4, both) + wall(-2, both), AMBIENT + depth(n)) for n in (2, 5, 2)]
    assert [np.array(mi.render(scene, spp=1)).max() for scene in scenes] == [1, 1.875, 1]
