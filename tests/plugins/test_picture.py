"""Pictures whose every pixel is known: spheres, highlights, shadows, mirror images, polygons, terms (section 1).

The camera stands in the origin and looks along +z, +x to the left. Where a yes or no decides (a silhouette, a
shadow's edge), the test first makes sure that no ray of its picture comes near the boundary: `decided`.
"""

import numpy as np
import pytest

HALF = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/></bsdf>'
MIRROR = """<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
  <float name="mirror_reflectance" value="0.5"/></bsdf>"""
GLOW = '<emitter type="area"><float name="radiance" value="2"/></emitter>'
TEXTBOOK = '<string name="falloff" value="none"/>'
NEAR = 2.0**-10
"""Distance to a boundary, relative to the sizes around it, below which a picture would be no good test. It is
256 times the 64 u by which the rounding model moves a ray."""


def wall(z, inside=HALF, name="wall"):
    return f"""<shape type="rectangle" id="{name}"><transform name="to_world"><scale value="-64, 64, -64"/>
      <translate z="{z}"/></transform>{inside}</shape>"""


def ball(centre, radius, inside=HALF, name="ball"):
    return f"""<shape type="sphere" id="{name}"><point name="center" value="{", ".join(map(str, centre))}"/>
      <float name="radius" value="{radius}"/>{inside}</shape>"""


def sun(light, irradiance=1):
    """Make a directional light from the direction l."""
    return f"""<emitter type="directional" id="sun"><vector name="direction"
      value="{", ".join(str(-x) for x in light)}"/><float name="irradiance" value="{irradiance}"/></emitter>"""


def bulb(position, intensity=1):
    return f"""<emitter type="point" id="bulb"><point name="position" value="{", ".join(map(str, position))}"/>
      <float name="intensity" value="{intensity}"/></emitter>"""


def fov(degrees):
    return f'<sensor type="perspective"><float name="fov" value="{degrees}"/>{{film}}</sensor>'


ORTHOGRAPHIC = '<sensor type="orthographic">{film}</sensor>'


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def dot(a, b):
    return np.sum(a * b, axis=-1, keepdims=True)


def miss_distance(e, d, centre):
    """Distance of a ray's line from a point."""
    return np.linalg.norm(np.cross(np.asarray(centre, float) - e, d), axis=-1)


def on_ball(d, centre, radius):
    """Distance t from the origin to the front of a ball, by the textbook's formula, and the normal there."""
    b = dot(d, centre)
    t = b - np.sqrt(b * b - dot(centre, centre) + radius * radius)
    return t, (t * d - centre) / radius


def decided(distance, boundary):
    """Tell for each ray whether it is inside a boundary, having made sure that none is near it."""
    assert np.all(np.abs(distance - boundary) > NEAR * boundary)
    inside = distance < boundary
    assert inside.any()
    assert not inside.all()
    return inside


# ------------------------------------------------------------------------------------------------------ lit balls
@pytest.mark.parametrize("distance", [4.0, 64.0, 1024.0])
def test_a_lit_ball_is_brightest_where_its_normal_points_to_the_light(any_rgb, see, agree, distance):
    # The film spans 3.332 radii, so that no ray is near the silhouette. k_d I n.l = 1/2 at most, where n = l.
    size = 12 if any_rgb == "scalar_rgb" else 48
    centre, light = np.array([0, 0, distance]), np.array([1.0, 2.0, -2.0]) / 3
    degrees = np.float32(2 * np.degrees(np.arctan(1.666 / distance))).astype(float)  # rounded once, as Mitsuba does
    s = (1 - 2 * (np.arange(size) + 0.5) / size) * np.tan(np.radians(degrees) / 2)
    x, y = np.meshgrid(s, s)
    d = unit(np.stack([x, y, np.ones_like(x)], axis=-1))
    picture = see(ball(centre, 1) + sun(light), size=(size, size), sensor=fov(degrees))

    # A ray that is 64 u off moves by 64 u t at the ball, of radius 1: so near to the silhouette it may miss or hit.
    moved = 64 * 2.0**-24 * (1 + distance)
    away = miss_distance(0, d, centre)
    assert (np.abs(away - 1) > moved).all()  # none does
    hit = away < 1
    assert np.all(picture[~hit] == 0)

    # t's error of 64 u t along the ray turns the normal by 64 u t / r; and n.l is known to 64 u absolutely.
    d, seen = d[hit], picture[hit]
    towards = dot(on_ball(d, centre, 1)[1], light)[:, 0]
    lit, dark = towards > 0, towards < 0

    def colour(turned):
        return np.repeat(0.5 * dot(on_ball(turned, centre, 1)[1], light), 3, axis=-1)

    agree(seen[lit], colour, d[lit], condition=(1 + distance) / towards[lit][:, None])
    faintest = moved * (1 + 1 / -dot(d, on_ball(d, centre, 1)[1]))  # of n.l < 0, where the ray is moved
    assert np.all(seen[dark] <= np.maximum(0, towards[dark][:, None] + faintest[dark]))
    assert np.argmax(seen[:, 0]) == np.argmax(towards)
    assert seen.max() <= 0.5 * (1 + moved)


@pytest.mark.parametrize("exponent", [0, 1, 10, 100, 1e4, 1e6])
def test_a_highlight_follows_the_power_of_n_h(any_rgb, see, agree, exponent):
    # A wall, its light at infinity behind the camera, l = (0.1, 0.2, -1) / |.|. View chosen so that all powers show.
    n, light = np.array([0.0, 0.0, -1.0]), unit(np.array([0.1, 0.2, -1.0]))
    material = f"""<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
      <float name="specular_reflectance" value="0.5"/><float name="exponent" value="{exponent}"/></bsdf>"""

    def colour(d):
        return np.repeat(0.5 * dot(n, unit(light - d)) ** exponent, 3, axis=-1)

    # h = n where d is the mirror image of l: (0.1, 0.2, 1). The camera looks there, at a width of 8 / sqrt(exponent).
    width = min(1.0, 8 / np.sqrt(exponent + 1))
    view = f"""<sensor type="perspective"><float name="fov" value="{2 * np.degrees(np.arctan(width / 2))}"/>
      <transform name="to_world"><lookat origin="0, 0, 0" target="0.1, 0.2, 1" up="0, 1, 0"/></transform>
      {{film}}</sensor>"""
    z = unit(np.array([0.1, 0.2, 1.0]))
    x = unit(np.cross([0.0, 1.0, 0.0], z))
    s = (1 - 2 * (np.arange(8) + 0.5) / 8) * width / 2
    across, up = np.meshgrid(s, s)
    d = unit(across[..., None] * x + up[..., None] * np.cross(z, x) + z)
    picture = see(wall(4, material) + sun(light), size=(8, 8), sensor=view)
    expected = colour(d)
    assert expected.max() > 0.4
    # Turning h by 64 u is the ray turned by 128 u: hits = 2. (n.h)^e knows no other error where n.h is near 1.
    agree(picture, colour, d, hits=2)


def test_a_light_in_the_eye_gives_the_full_highlight(any_variant, see):
    material = """<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.25"/>
      <float name="specular_reflectance" value="0.5"/><float name="exponent" value="10000000"/></bsdf>"""
    assert np.all(see(wall(4, material) + sun((0, 0, -1))) == 0.75)
    assert np.all(see(wall(4, material) + bulb((0, 0, 0), 16)) == 0.75)


def test_all_terms_add_up(any_rgb, see, agree, directions):
    # Point light at (1, 2, 1), I = 9 / r^2; k_a I_a = 1/32, k_d = 1/2, k_s = 1/4, exponent 20; k_m = 1/8,
    # and the sky is 2.
    material = """<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/>
      <float name="ambient_reflectance" value="0.25"/><float name="specular_reflectance" value="0.25"/>
      <float name="mirror_reflectance" value="0.125"/><float name="exponent" value="20"/></bsdf>"""
    sky = '<emitter type="constant"><float name="radiance" value="2"/></emitter>'
    n, lamp = np.array([0.0, 0.0, -1.0]), np.array([1.0, 2.0, 1.0])

    def colour(d):
        p = 4 / d[..., 2:] * d
        r = np.linalg.norm(lamp - p, axis=-1, keepdims=True)
        l = (lamp - p) / r  # noqa: E741 (the model's name)
        arriving = 9 / r**2
        c = 0.25 * 0.125 + 0.5 * arriving * dot(n, l) + 0.25 * arriving * dot(n, unit(l - d)) ** 20 + 0.125 * 2
        return np.repeat(c, 3, axis=-1)

    d = directions(9, 9)
    picture = see(wall(4, material) + bulb(lamp, 9) + sky, '<float name="ambient" value="0.125"/>', (9, 9))
    # t <= 4 sqrt(3) = 7, r >= 3, n.l >= 3/9: 1 / (n.l) + 3 t / r <= 10; the power multiplies it by 20 times tan <= 1.
    agree(picture, colour, d, condition=10 + 20, hits=2)


# --------------------------------------------------------------------------------------------------------- shadows
def test_a_disk_casts_a_disk_of_shadow_from_a_point_light(any_rgb, see, directions):
    # Light in (0.5, 0, 0), disk of radius 1/2 around (0.5, 0.25, 2), wall z = 4: all is doubled from the light on, a
    # shadow of radius 1 around (0.5, 0.5, 4). The camera in the origin sees the disk's black back before
    # (1, 0.5, 4), as large.
    size = 16 if any_rgb == "scalar_rgb" else 64
    disk = """<shape type="disk" id="disk"><transform name="to_world"><scale value="0.5"/>
      <translate x="0.5" y="0.25" z="2"/></transform></shape>"""
    d = directions(size, size)
    p = 4 / d[..., 2:] * d
    shaded = decided(np.hypot(p[..., 0] - 0.5, p[..., 1] - 0.5), 1.0)
    covered = decided(np.hypot(p[..., 0] - 1, p[..., 1] - 0.5), 1.0)
    picture = see(wall(4) + disk + bulb((0.5, 0, 0)), size=(size, size))
    assert np.array_equal((picture > 0).all(axis=-1), ~(shaded | covered))


def test_a_ball_casts_an_ellipse_of_shadow_from_a_directional_light(any_rgb, see, directions):
    # l = (3, 0, -4) / 5: p is in shadow where the line p + s l passes the centre within the radius; in the picture
    # the ball itself covers some of it.
    size = 16 if any_rgb == "scalar_rgb" else 64
    centre, light = np.array([0.5, 0.0, 3.0]), np.array([3.0, 0.0, -4.0]) / 5
    d = directions(size, size)
    p = 4 / d[..., 2:] * d
    shaded = decided(miss_distance(p, light, centre), 0.5)
    covered = decided(miss_distance(0, d, centre), 0.5)
    picture = see(wall(4) + ball(centre, 0.5, '<bsdf type="conductor"/>') + sun(light), size=(size, size))
    assert np.array_equal((picture > 0).all(axis=-1)[~covered], ~shaded[~covered])


def test_a_ball_on_the_floor_is_dark_up_to_the_point_of_contact(any_rgb, see):
    # The ball of radius 1 touches the wall in (0, 0, 4): rho away from there the gap is rho^2 / 2. A ray along the
    # wall's normal is shaded from rho = 1 down. The near plane of the camera lies inside the ball.
    view = '<sensor type="orthographic"><float name="near_clip" value="3.99"/>{film}</sensor>'
    picture = see(wall(4) + ball((0, 0, 3), 1) + sun((0, 0, -1)), size=(31, 31), sensor=view)
    # The ball's inside is seen at first (black), or the wall in the ball's shadow: black within, lit without.
    s = 1 - 2 * (np.arange(31) + 0.5) / 31
    inside = decided(np.hypot(*np.meshgrid(s, s)), 1.0)
    assert np.array_equal((picture > 0).all(axis=-1), ~inside)


# --------------------------------------------------------------------------------------------------- mirror images
def test_a_flat_mirror_shows_things_as_far_behind_it_as_they_are_in_front(any_rgb, see, directions):
    # Mirror z = 4; a glowing ball of radius 2 around (1, -2, -3), behind the camera, appears around (1, -2, 11).
    size = 16 if any_rgb == "scalar_rgb" else 64
    picture = see(wall(4, MIRROR) + ball((1, -2, -3), 2, GLOW), size=(size, size))
    seen = decided(miss_distance(0, directions(size, size), [1, -2, 11]), 2.0)
    assert np.array_equal(picture, np.where(seen[..., None], np.full(3, 1.0), 0))


def test_a_flat_mirror_shows_each_point_where_the_law_of_reflection_puts_it(any_rgb, see, agree, directions):
    # The wall z = -4 behind the camera, n = (0, 0, 1), is lit from (1, 2, 0) at constant strength; it appears in
    # z = 12, lit from (1, 2, 8): n.l = 4 / r there.
    behind = f"""<shape type="rectangle" id="behind"><transform name="to_world"><scale value="64"/>
      <translate z="-4"/></transform>{HALF}</shape>"""
    image_of_lamp = np.array([1.0, 2.0, 8.0])

    def colour(d):
        r = np.linalg.norm(12 / d[..., 2:] * d - image_of_lamp, axis=-1, keepdims=True)
        return np.repeat(0.5 * 0.5 * 4 / r, 3, axis=-1)

    d = directions(9, 9) * [0.25, 0.25, 1]
    narrow = fov(2 * np.degrees(np.arctan(0.25)))
    d = unit(d)
    picture = see(wall(4, MIRROR) + behind + bulb((1, 2, 0)), TEXTBOOK, (9, 9), narrow)
    # t <= 12.8, r >= 4 and at most 7.2: 1 / (n.l) + 3 t / r <= 1.8 + 9.6
    agree(picture, colour, d, condition=12, hits=2)


def test_a_mirror_ball_shows_each_point_where_the_law_of_reflection_puts_it(any_rgb, see, agree, directions):
    # The same wall in the ball of radius 1 around (0, 0, 4), near its middle.
    behind = f"""<shape type="rectangle" id="behind"><transform name="to_world"><scale value="64"/>
      <translate z="-4"/></transform>{HALF}</shape>"""
    centre, lamp = np.array([0.0, 0.0, 4.0]), np.array([1.0, 2.0, 0.0])

    def colour(d):
        t, n = on_ball(d, centre, 1)
        reflected = d - 2 * dot(d, n) * n
        p = t * d + (-4 - t * d[..., 2:]) / reflected[..., 2:] * reflected
        return np.repeat(0.5 * 0.5 * 4 / np.linalg.norm(p - lamp, axis=-1, keepdims=True), 3, axis=-1)

    tan = 1 / 16
    d = unit(directions(8, 8) * [tan, tan, 1])
    picture = see(ball(centre, 1, MIRROR) + behind + bulb(lamp), TEXTBOOK, (8, 8), fov(2 * np.degrees(np.arctan(tan))))
    # A normal that is 64 u off equals a ray that is 64 u r / t < 64 u off: hits = 3. From 3.2 to 7.8 units of path
    # to the wall, t <= 12 in all, 4 <= r <= 8: 1 / (n.l) + 3 t / r <= 2 + 9.
    agree(picture, colour, d, condition=11, hits=3)


def test_two_mirrors_in_a_corner_show_the_image_through_the_edge(any_rgb, see, directions):
    # Mirrors z = 4 and x = 1: a glowing ball around (-1, 1, -2) appears, once through each mirror, around
    # (-1, 1, 10) and (3, 1, -2), and through both in turn around (3, 1, 10).
    size = 16 if any_rgb == "scalar_rgb" else 64
    side = f"""<shape type="rectangle" id="side"><transform name="to_world"><scale value="64"/>
      <rotate y="1" angle="-90"/><translate x="1"/></transform>{MIRROR}</shape>"""
    d = directions(size, size)
    picture = see(wall(4, MIRROR) + side + ball((-1, 1, -2), 0.73, GLOW), size=(size, size))
    once = decided(miss_distance(0, d, [-1, 1, 10]), 0.73)
    twice = decided(miss_distance(0, d, [3, 1, 10]), 0.73)
    assert not (once & twice).any()
    assert np.array_equal(picture[..., 0], np.where(once, 1, np.where(twice, 0.5, 0)))


def test_a_mirror_ball_shows_a_small_upright_image(any_rgb, see, directions):
    # The reflected ray from p meets the glowing ball where its line comes nearer to the centre than the radius.
    size = 16 if any_rgb == "scalar_rgb" else 64
    centre, lamp = np.array([0.0, 0.0, 4.0]), np.array([1.0, 3.0, -4.0])
    d = directions(size, size) * [0.25, 0.25, 1]
    d = unit(d)
    hit = miss_distance(0, d, centre) < 1
    t, n = on_ball(d[hit], centre, 1)
    r = d[hit] - 2 * dot(d[hit], n) * n
    ahead = dot(lamp - t * d[hit], r)[..., 0] > 0
    away = np.where(ahead, miss_distance(t * d[hit], r, lamp), 1e9)
    glows = decided(away, 2.0)
    # A convex mirror widens the ray's error by 2 t / (r cos): its boundary must be as much farther off.
    cosine = -dot(d[hit], n)[..., 0]
    grazing = cosine < 0.1
    assert not glows[grazing].any()
    narrow = fov(2 * np.degrees(np.arctan(0.25)))
    picture = see(ball(centre, 1, MIRROR) + ball(lamp, 2, GLOW, "lamp"), size=(size, size), sensor=narrow)
    expected = np.zeros((size, size))
    expected[hit] = glows
    assert np.array_equal(picture[..., 0], expected)
    assert glows.any()
    assert np.argwhere(expected)[:, 0].mean() < size / 2 - 1  # above is above: the image is upright


# -------------------------------------------------------------------------------------------------- surfaces as sets
STAR = [(np.sin(4 * np.pi * i / 5 + 0.1), np.cos(4 * np.pi * i / 5 + 0.1)) for i in range(5)]
POLYGONS = {
    "concave": [[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (0.1, -0.3), (-0.9, 0.9)]],
    "hole": [[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)], [(-0.5, -0.3), (0.5, -0.4), (0.1, 0.6)]],
    "star": [STAR],
}


def is_inside(rings, x, y):
    """Count the crossings of a ray to +x: odd is inside (the textbook's test, half-open in y)."""
    odd = np.zeros(x.shape, bool)
    for ring in rings:
        for (xi, yi), (xj, yj) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            between = (yi > y) != (yj > y)
            with np.errstate(divide="ignore", invalid="ignore"):
                odd ^= between & (x < (xj - xi) * (y - yi) / (yj - yi) + xi)
    return odd


@pytest.mark.parametrize("name", POLYGONS)
def test_a_polygon_covers_the_pixels_whose_centres_are_inside(any_rgb, see, name):
    size = 16 if any_rgb == "scalar_rgb" else 64
    rings = [np.float32(ring).astype(float) for ring in POLYGONS[name]]
    s = 1 - 2 * (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(s, s)
    for a, b in ((a, b) for ring in rings for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)):
        line = abs((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / np.hypot(*(b - a))
        assert line.min() > 64 * 2.0**-24  # no pixel's centre lies on an edge
    vertices = "; ".join(" ".join(f"{px!r},{py!r},4" for px, py in ring.tolist()) for ring in rings)
    shape = f"""<shape type="polygon" id="it"><string name="vertices" value="{vertices}"/>
      <vector name="normal" value="0, 0, -1"/>{GLOW}</shape>"""
    picture = see(shape, size=(size, size), sensor=ORTHOGRAPHIC)
    assert np.array_equal(picture[..., 0], np.where(is_inside(rings, x, y), 2, 0))


FAN = """ply
format ascii 1.0
element vertex 9
property float x
property float y
property float z
element face 8
property list uchar int vertex_indices
end_header
0 0 4
-4 -4 4
0 -4 4
4 -4 4
4 0 4
4 4 4
0 4 4
-4 4 4
-4 0 4
""" + "".join(f"3 0 {1 + (i + 1) % 8} {1 + i}\n" for i in range(8))


@pytest.mark.parametrize("size", [8, 9, 33])
def test_no_ray_slips_through_an_edge_or_a_vertex(llvm_ad_rgb, see, tmp_path, size):
    # Eight triangles around (0, 0, 4), and a rectangle: rays go exactly through the common vertex, where `size` is
    # odd, and along all diagonals and axes.
    (tmp_path / "fan.ply").write_text(FAN)
    fan = f"""<shape type="ply" id="fan"><string name="filename" value="{tmp_path}/fan.ply"/>{GLOW}</shape>"""
    for body in (fan, wall(4, GLOW), wall(4, GLOW).replace("64", "4")):
        for sensor in (ORTHOGRAPHIC, fov(60)):
            assert np.all(see(body, size=(size, size), sensor=sensor) == 2)


def test_a_checkerboard_changes_where_the_fraction_passes_one_half(any_rgb, see):
    # u = (1 + x') / 2 over the rectangle, x' its own axis, which a turn by 180 degrees about y sends to -x; the film
    # spans it exactly; v likewise upwards. Mitsuba: both fractions above 1/2, or neither, show color0.
    board = """<bsdf type="blinnphong"><texture type="checkerboard" name="diffuse_reflectance">
      <rgb name="color0" value="0.25"/><rgb name="color1" value="0.75"/><transform name="to_uv"><scale x="2" y="1"/>
      </transform></texture></bsdf>"""
    one = wall(4, board).replace("64", "1")
    size = 8
    s = 1 - 2 * (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(s, s)
    u, v = (1 - x) / 2 * 2, (1 + y) / 2
    same = (u % 1 > 0.5) == (v % 1 > 0.5)
    picture = see(one + sun((0, 0, -1)), size=(size, size), sensor=ORTHOGRAPHIC)
    assert np.array_equal(picture[..., 0], np.where(same, 0.25, 0.75))


# ------------------------------------------------------------------------------------------------------- the terms
SHINY = """<bsdf type="blinnphong" id="shiny"><float name="diffuse_reflectance" value="0.5"/>
  <float name="specular_reflectance" value="0.25"/><float name="mirror_reflectance" value="0.125"/></bsdf>"""
SKY = '<emitter type="constant" id="sky"><float name="radiance" value="8"/></emitter>'
TERMS = {"ambient": 0.5 * 0.125, "diffuse": 0.5 * 2, "specular": 0.25 * 2, "mirrors": 0.125 * 8}


@pytest.mark.parametrize("left_out", [(), *((term,) for term in TERMS), ("ambient", "diffuse"), tuple(TERMS)])
def test_each_term_can_be_left_out(any_variant, see, left_out):
    # Everything straight on: n.l = n.h = 1, and all numbers are small multiples of 1/16.
    switches = "".join(f'<boolean name="enable_{term}" value="false"/>' for term in left_out)
    ambient = '<float name="ambient" value="0.125"/>'
    colour = sum(value for term, value in TERMS.items() if term not in left_out)
    assert np.all(see(wall(4, SHINY) + sun((0, 0, -1), 2) + SKY, ambient + switches) == colour)


def test_switching_terms_off_leaves_lamps_and_background(any_variant, see):
    switches = "".join(f'<boolean name="enable_{term}" value="false"/>' for term in (*TERMS, "shadows"))
    assert np.all(see(SKY, switches) == 8)
    assert np.all(see(wall(4, GLOW), switches) == 2)


@pytest.mark.parametrize(
    ("bsdf", "colour"),
    [
        ('<bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>', 2 * 0.5 / np.pi),
        ('<bsdf type="conductor"/>', 8.0),
        ('<bsdf type="conductor"><rgb name="specular_reflectance" value="0.25"/></bsdf>', 2.0),
        ('<bsdf type="conductor"><string name="material" value="none"/></bsdf>', 8.0),
        ('<bsdf type="twosided"><bsdf type="conductor"/></bsdf>', 8.0),
    ],
)
def test_materials_of_mitsuba_are_those_of_the_model(any_variant, see, agree, bsdf, colour):
    agree(see(wall(4, bsdf) + sun((0, 0, -1), 2) + SKY), colour)
