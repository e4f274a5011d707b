"""The lights of section 2 of the model, what blocks them, and the integrator's parameters that concern them.

Unless said otherwise a wall z = 4 with k_d = 1/2 is looked at along the z axis, in the point (0, 0, 4); n = (0, 0, -1).
"""

import math

import mitsuba as mi
import numpy as np
import pytest

HALF = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/></bsdf>'
WALL = f"""<shape type="rectangle" id="wall"><transform name="to_world"><scale value="-64, 64, -64"/>
  <translate z="4"/></transform>{HALF}</shape>"""
TEXTBOOK = '<string name="falloff" value="none"/>'
AMBIENT = '<rgb name="ambient" value="0.125"/>'


def sun(direction="0, 0, 1", irradiance=1.0, name="sun"):
    return f"""<emitter type="directional" id="{name}"><vector name="direction" value="{direction}"/>
      <float name="irradiance" value="{irradiance}"/></emitter>"""


def bulb(position, intensity=1.0, name="bulb"):
    return f"""<emitter type="point" id="{name}"><point name="position" value="{position}"/>
      <float name="intensity" value="{intensity}"/></emitter>"""


def spot(target, cutoff, more="", origin="0, 0, 0", name="spot"):
    return f"""<emitter type="spot" id="{name}"><transform name="to_world">
      <lookat origin="{origin}" target="{target}" up="0, 1, 0"/></transform>
      <float name="intensity" value="16"/><float name="cutoff_angle" value="{cutoff}"/>{more}</emitter>"""


def disk(z, x=0.0, radius=0.5):
    """Make a disk that faces the camera."""
    return f"""<shape type="disk" id="disk"><transform name="to_world"><scale value="-{radius}, {radius}, -1"/>
      <translate x="{x}" z="{z}"/></transform></shape>"""


# ------------------------------------------------------------------------------------------- how much arrives
def test_a_directional_light_adds_its_irradiance_times_the_cosine(any_variant, see, agree):
    assert np.all(see(WALL + sun()) == 0.5)
    # l = -normalize(1, 2, 2) = -(1, 2, 2) / 3: n.l = 2/3
    agree(see(WALL + sun("1, 2, 2", 3)), 0.5 * 3 * 2 / 3, condition=3 / 2)


def test_a_directional_light_ignores_the_scale_of_its_to_world(any_variant, see, agree):
    # M z = (4, 0, 3) 100: l = -(4, 0, 3) / 5
    light = """<emitter type="directional" id="sun"><transform name="to_world">
      <lookat origin="0, 0, 0" target="4, 0, 3" up="0, 1, 0"/><scale value="100"/></transform>
      <float name="irradiance" value="1"/></emitter>"""
    agree(see(WALL + light), 0.5 * 3 / 5, condition=5 / 3)


def test_a_point_light_fades_with_the_square_of_the_distance(any_variant, see, agree):
    assert np.all(see(WALL + bulb("0, 0, 2", 8)) == 0.5 * 8 / 4)
    # From (3, 0, 0): r = 5, n.l = 4/5
    agree(see(WALL + bulb("3, 0, 0", 8)), 0.5 * 8 / 25 * 4 / 5, condition=5 / 4 + 3 * 4 / 5)


def test_the_textbooks_point_light_does_not_fade(any_variant, see, agree):
    agree(see(WALL + bulb("3, 0, 0", 8), TEXTBOOK), 0.5 * 8 * 4 / 5, condition=5 / 4 + 3 * 4 / 5)
    assert np.all(see(WALL + bulb("0, 0, -1020", 8), TEXTBOOK) == 0.5 * 8)


def test_inverse_square_is_the_default(any_variant, see):
    named = '<string name="falloff" value="inverse_square"/>'
    assert np.array_equal(see(WALL + bulb("3, 1, 0"), named), see(WALL + bulb("3, 1, 0")))


def test_falloff_leaves_directional_lights_alone(any_variant, see):
    assert np.array_equal(see(WALL + sun("1, 2, 2"), TEXTBOOK), see(WALL + sun("1, 2, 2")))


def test_lights_have_colours(any_rgb, see, agree):
    light = sun().replace('<float name="irradiance" value="1.0"/>', '<rgb name="irradiance" value="1, 2, 4"/>')
    assert np.array_equal(see(WALL + light)[0, 0], [0.5, 1, 2])


# --------------------------------------------------------------------------------------------------- spot lights
def cone(theta, cutoff, beam):
    """Give f(theta): 1 within the beam, linear down to 0 at the cutoff; degrees."""
    if theta <= beam:
        return 1.0
    return (cutoff - theta) / (cutoff - beam) if theta < cutoff else 0.0


@pytest.mark.parametrize("theta", [0, 10, 14, 16, 18, 19, 21, 60, 120, 180])
def test_a_spot_light_fades_linearly_from_three_quarters_of_its_cutoff(any_variant, see, agree, theta):
    # The light stands in the origin and is turned away from (0, 0, 4) by theta: r = 4, n.l = 1.
    # 1 / (cutoff - beam) multiplies the angle's error of 64 u: condition theta / (cutoff - theta).
    angle = math.radians(theta)
    light = spot(f"{math.sin(angle)}, 0, {math.cos(angle)}", 20)
    f = cone(theta, 20, 15)
    agree(see(WALL + light), 0.5 * 16 / 16 * f, condition=1 + 3 + (20 / (20 - theta) if 0 < f < 1 else 0))


@pytest.mark.parametrize("theta", [0.1, 0.3, 0.4, 0.45, 0.49, 0.51])
def test_a_narrow_spot_light_keeps_the_accuracy_of_an_angle(any_variant, see, agree, theta):
    # Half a degree: 1 - cos(theta) = 4e-5 would leave no more than 10 bits of theta. The axis is known to 64 u
    # (as a direction), so theta to 64 u rad, and f to 64 u / (cutoff - beam).
    angle = math.radians(theta)
    f = cone(theta, 0.5, 0.375)
    error = 1 / math.radians(0.5 - 0.375) / f if 0 < f < 1 else 0
    light = spot(f"{math.sin(angle)}, 0, {math.cos(angle)}", 0.5)
    agree(see(WALL + light), 0.5 * f, condition=1 + 3 + error)


@pytest.mark.parametrize(("theta", "seen"), [(0, 1), (19.9, 1), (20.1, 0)])
def test_a_spot_light_whose_beam_is_its_cutoff_has_a_sharp_edge(any_variant, see, agree, theta, seen):
    angle = math.radians(theta)
    light = spot(f"{math.sin(angle)}, 0, {math.cos(angle)}", 20, '<float name="beam_width" value="20"/>')
    agree(see(WALL + light), 0.5 * seen, condition=4)


def test_a_spot_lights_default_cutoff_is_20_degrees(any_variant, see):
    # At 17.5 degrees, half-way between 15 and 20: the same picture with the cutoff named and left out.
    angle = math.radians(17.5)
    light = spot(f"{math.sin(angle)}, 0, {math.cos(angle)}", 20)
    unnamed = light.replace('<float name="cutoff_angle" value="20"/>', "")
    assert unnamed != light
    assert np.array_equal(see(WALL + unnamed), see(WALL + light))
    assert np.all(see(WALL + light) > 0)


def test_the_textbooks_spot_light_keeps_its_cone_and_does_not_fade(any_variant, see, agree):
    angle = math.radians(17.5)
    light = spot(f"{math.sin(angle)}, 0, {math.cos(angle)}", 20)
    agree(see(WALL + light, TEXTBOOK), 0.5 * 16 * 0.5, condition=1 + 3 + 20 / 2.5)


# ------------------------------------------------------------------------------- lights at, in, behind surfaces
def test_a_light_behind_the_surface_adds_nothing(any_variant, see):
    assert np.all(see(WALL + bulb("0, 0, 5")) == 0)
    assert np.all(see(WALL + sun("0, 0, -1")) == 0)
    assert np.all(see(WALL + spot("0, 0, 0", 20, origin="0, 0, 5")) == 0)


@pytest.mark.parametrize("falloff", ["", TEXTBOOK])
def test_a_light_exactly_at_the_surface_adds_nothing(any_variant, see, falloff):
    assert np.all(see(WALL + bulb("0, 0, 4"), falloff) == 0)


def test_a_light_in_the_plane_of_the_surface_adds_nothing(any_variant, see):
    assert np.all(see(WALL + bulb("1, 0, 4")) == 0)
    assert np.all(see(WALL + sun("1, 0, 0")) == 0)


BALL = f"""<shape type="sphere" id="ball"><point name="center" value="0, 0, 4"/><float name="radius" value="2"/>
  {HALF}</shape>"""


def test_a_light_inside_a_ball_does_not_shine_out(any_variant, see):
    assert np.all(see(BALL + bulb("0, 0, 4")) == 0)
    assert np.all(see(BALL + bulb("0, 0, 2.5")) == 0)
    assert np.all(see(WALL.replace('z="4"', 'z="8"') + BALL + bulb("0, 0, 4"), size=(9, 9)) == 0)


def test_a_light_inside_a_ball_lights_it_from_within(any_variant, see):
    # Camera in the middle of a ball that is turned inside out; the lamp is there too: r = 2, n.l = 1.
    ball = BALL.replace("0, 0, 4", "0, 0, 0").replace("<point", '<boolean name="flip_normals" value="true"/><point')
    assert np.all(see(ball + bulb("0, 0, 0", 8)) == 0.5 * 8 / 4)


# ----------------------------------------------------------------------------------------------------- occluders
@pytest.mark.parametrize(
    ("z", "shaded"),
    [(2, True), (1 + 2.0**-10, True), (1 + 2.0**-16, True), (1 - 2.0**-16, False), (1 - 2.0**-10, False), (-1, False)],
)
def test_what_stands_behind_a_point_light_casts_no_shadow(any_variant, see, z, shaded):
    # The wall's point (0, 0, 4), the light in (0, 0, 1), and a disk just before it or just behind; the camera looks
    # from the side, past the disk. 2^-16 is 256 ulp of the coordinates: no rounding hides it.
    sensor = """<sensor type="perspective"><float name="fov" value="1"/><transform name="to_world">
      <lookat origin="-4, 0, 0" target="0, 0, 4" up="0, 1, 0"/></transform>{film}</sensor>"""
    picture = see(WALL + bulb("0, 0, 1", 9) + disk(z), sensor=sensor)
    assert np.all((picture == 0) == shaded)


def test_a_directional_light_is_blocked_from_infinitely_far(any_variant, see):
    assert np.all(see(WALL + sun() + disk(-1e6)) == 0)
    assert np.all(see(WALL + sun() + disk(-1e6, x=1)) == 0.5)


def test_every_shape_blocks_whatever_its_side_and_material(any_variant, see):
    # Behind the camera, at z = -2, between the sun and the wall.
    shapes = {
        "rectangle": "",
        "disk": "",
        "cube": "",
        "sphere": "",
        "cylinder": '<vector name="p0" value="0, -1, 0"/><vector name="p1" value="0, 1, 0"/>',
        "polygon": '<string name="vertices" value="-1,-1,0 1,-1,0 1,1,0 -1,1,0"/>',
    }
    materials = {
        "blinnphong": HALF,
        "mirror": '<bsdf type="conductor"/>',
        "lamp": '<emitter type="area"/>',
        "diffuse": '<bsdf type="diffuse"/>',
        "two-sided": '<bsdf type="twosided"><bsdf type="diffuse"/></bsdf>',
    }
    for shape, parameters in shapes.items():
        for turn in (1, -1):
            for material in materials.values():
                blocker = f"""<shape type="{shape}" id="blocker">{parameters}<transform name="to_world">
                  <scale value="0.75, 0.75, 0.75"/><scale value="1, 1, {turn if shape != "sphere" else 1}"/>
                  <translate z="-2"/></transform>{material}</shape>"""
                assert np.all(see(WALL + sun() + blocker) == 0), (shape, turn, material)
    assert np.all(see(WALL + sun()) == 0.5)


def test_shadows_can_be_left_out(any_variant, see):
    assert np.all(see(WALL + sun() + disk(-2), '<boolean name="enable_shadows" value="false"/>') == 0.5)


def test_without_shadows_a_light_below_the_horizon_still_adds_nothing(any_variant, see):
    assert np.all(see(WALL + sun("0, 0, -1"), '<boolean name="enable_shadows" value="false"/>') == 0)


# ------------------------------------------------------------------------------------------------------- epsilon
GAP = 2.0**-20
"""About 1e-6 of a scene of size 1 and more."""


@pytest.mark.parametrize("shape", ["rectangle", "disk", "sphere", "cube"])
def test_unset_epsilon_keeps_a_narrow_gap_dark(any_variant, see, shape):
    # A lid that nearly touches the wall in (0, 0, 1/2): the sun cannot reach that point. The camera's near plane
    # lies in the gap, so that the lid is not seen.
    wall = WALL.replace('z="4"', 'z="0.5"')
    middle = 0.5 - GAP if shape in ("rectangle", "disk") else 0.25 - GAP
    lid = f"""<shape type="{shape}" id="lid"><transform name="to_world"><scale value="0.25"/>
      <translate z="{middle}"/></transform></shape>"""
    view = f"""<sensor type="perspective"><float name="fov" value="1"/>
      <float name="near_clip" value="{0.5 - GAP / 2}"/>{{film}}</sensor>"""
    assert np.all(see(wall + sun(), sensor=view) == 0.5)
    assert np.all(see(wall + sun() + lid, sensor=view) == 0)
    flat = shape in ("rectangle", "disk")  # of the others, the far side blocks as well
    assert np.all((see(wall + sun() + lid, '<float name="epsilon" value="2e-6"/>', sensor=view) > 0) == flat)


def test_the_textbooks_epsilon_ignores_what_is_nearer(any_variant, see):
    # A disk in front of the wall at distance 1/4, seen past it: shaded without, lit with an epsilon above 1/4.
    sensor = """<sensor type="perspective"><float name="fov" value="1"/><transform name="to_world">
      <lookat origin="-4, 0, 0" target="0, 0, 4" up="0, 1, 0"/></transform>{film}</sensor>"""
    body = WALL + sun() + disk(3.75, radius=0.125)
    for epsilon, lit in (("", False), (0.125, False), (0.24, False), (0.26, True), (1, True)):
        parameter = f'<float name="epsilon" value="{epsilon}"/>' if epsilon else ""
        assert np.all((see(body, parameter, sensor=sensor) > 0) == lit), epsilon


def test_the_textbooks_epsilon_holds_for_mirrors_too(any_variant, see):
    # The camera stands between a mirror z = 1/4 and a lamp z = -1/4: the reflected ray meets the lamp at 1/2.
    mirror = WALL.replace('z="4"', 'z="0.25"').replace(
        HALF,
        """<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
        <float name="mirror_reflectance" value="1"/></bsdf>""",
    )
    lamp = """<shape type="rectangle" id="lamp"><transform name="to_world"><translate z="-0.25"/></transform>
      <emitter type="area"><float name="radiance" value="2"/></emitter></shape>"""
    for epsilon, seen in ((0.01, True), (0.49, True), (0.51, False)):
        picture = see(mirror + lamp, f'<float name="epsilon" value="{epsilon}"/>')
        assert np.all(picture == (2 if seen else 0)), epsilon


# ------------------------------------------------------------------------------------------------------- ambient
def test_ambient_light_alone_shows_k_a(any_variant, see):
    assert np.all(see(WALL, AMBIENT) == 0.5 * 0.125)  # k_a is k_d unless named
    named = WALL.replace("</bsdf>", '<float name="ambient_reflectance" value="0.25"/></bsdf>')
    assert np.all(see(named, AMBIENT) == 0.25 * 0.125)


def test_ambient_light_reaches_what_is_in_shadow(any_variant, see):
    assert np.all(see(WALL + sun() + disk(-2), AMBIENT) == 0.5 * 0.125)


def test_ambient_light_may_be_a_grey_number(any_variant, see):
    assert np.all(see(WALL, '<float name="ambient" value="0.125"/>') == 0.5 * 0.125)


def test_ambient_light_has_a_colour(any_rgb, see):
    assert np.array_equal(see(WALL, '<rgb name="ambient" value="0.5, 0.25, 2"/>')[0, 0], [0.25, 0.125, 1])


# ------------------------------------------------------------------------------------------------ seen, not used
LAMP = """<shape type="rectangle" id="lamp"><transform name="to_world"><translate z="{z}"/></transform>
  <emitter type="area" id="glow"><float name="radiance" value="8"/></emitter></shape>"""


def test_an_area_light_is_seen_and_lights_nothing(any_variant, see):
    turned = LAMP.format(z=2).replace("<translate", '<scale value="-1, 1, -1"/><translate')
    assert np.all(see(turned) == 8)
    assert np.all(see(WALL + LAMP.format(z=-1)) == 0)  # it stands behind the camera and faces the wall


def test_an_area_light_is_black_from_behind(any_variant, see):
    assert np.all(see(LAMP.format(z=2), AMBIENT) == 0)


def test_a_background_is_seen_and_lights_nothing(any_variant, see):
    sky = '<emitter type="constant" id="sky"><float name="radiance" value="2"/></emitter>'
    assert np.all(see(sky) == 2)
    assert np.all(see(WALL + sky) == 0)


def test_without_a_background_there_is_black(any_variant, see):
    assert np.all(see("") == 0)
    assert np.all(see(sun()) == 0)


@pytest.fixture
def messages():
    """Collect the messages that Mitsuba logs, of level Info and above."""
    found = []

    class Listener(mi.Appender):
        def append(self, level, text):
            found.append(text)

        def log_progress(self, *arguments):
            pass

    logger, level = mi.logger(), mi.log_level()
    listener = Listener()
    logger.add_appender(listener)
    mi.set_log_level(mi.LogLevel.Info)
    yield found
    mi.set_log_level(level)
    logger.remove_appender(listener)


def test_a_light_that_lights_nothing_is_named_once(llvm_ad_rgb, scene_of, messages):
    # Once a process: the ids are those of no other test.
    sky = '<emitter type="constant" id="heaven"/>'
    scene = scene_of(WALL + LAMP.format(z=-1).replace("glow", "ember") + sky + bulb("0, 0, 0"))
    for _ in range(3):
        np.array(mi.render(scene, spp=1))
    for name, count in (("ember", 1), ("heaven", 1), ("bulb", 0)):
        assert sum(f"`{name}`" in message for message in messages) == count, messages


def test_a_number_of_samples_that_is_no_square_is_named_once(llvm_ad_rgb, scene_of, messages):
    # Likewise.
    scene = scene_of(WALL)
    for spp in (4, 211, 211, 1):
        np.array(mi.render(scene, spp=spp))
    assert sum("211 samples" in message for message in messages) == 1


# ------------------------------------------------------------------------------------------------------ envmap
def test_an_environment_map_is_seen_directly_and_in_mirrors(any_rgb, see, tmp_path):
    # Two halves: 8, 16, 32 around +z, which is the middle of the map, as u = atan2(x, -z) / 2 pi; else 1, 2, 4.
    data = np.zeros((8, 16, 3), np.float32)
    data[:] = [1, 2, 4]
    data[:, 4:12] = [8, 16, 32]
    path = tmp_path / "sky.exr"
    mi.Bitmap(data).write(str(path))
    sky = f'<emitter type="envmap" id="sky"><string name="filename" value="{path}"/></emitter>'
    assert np.array_equal(see(sky)[0, 0], [8, 16, 32])
    mirror = WALL.replace(
        HALF,
        """<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
        <float name="mirror_reflectance" value="0.5"/></bsdf>""",
    )
    assert np.array_equal(see(sky + mirror)[0, 0], [0.5, 1, 2])


def test_a_coloured_background_is_seen_in_mirrors(any_rgb, see):
    sky = '<emitter type="constant" id="sky"><rgb name="radiance" value="1, 2, 4"/></emitter>'
    mirror = WALL.replace(HALF, '<bsdf type="conductor"/>')
    assert np.array_equal(see(sky + mirror)[0, 0], [1, 2, 4])


# -------------------------------------------------------------------------------------------------- many lights
@pytest.mark.parametrize("count", [1, 15, 16, 17, 33, 100])
def test_many_lights_add_up(llvm_ad_rgb, see, count):
    # Powers of two, straight on: the wall shows 1/2 for every light, exactly.
    suns = "".join(sun(name=f"sun{i}") for i in range(count))
    assert np.all(see(WALL + suns) == 0.5 * count)
    bulbs = "".join(bulb("0, 0, 2", 4, f"bulb{i}") for i in range(count))
    assert np.all(see(WALL + bulbs) == 0.5 * count)
    spots = "".join(spot("0, 0, 4", 20, name=f"spot{i}") for i in range(count))
    assert np.all(see(WALL + spots) == 0.5 * count)
    assert np.all(see(WALL + suns + bulbs + spots) == 1.5 * count)


def test_the_picture_of_many_lights_is_the_sum_of_their_pictures(llvm_ad_rgb, see):
    # Different lights, some of them blocked. A sum of n terms, none negative, has n roundings at most.
    rng = np.random.default_rng(8)
    lights = [bulb(", ".join(map(str, rng.uniform(-3, 3, 3))), 8, f"bulb{i}") for i in range(20)]
    lights += [sun(", ".join(map(str, rng.uniform([-1, -1, 1], 1))), 1, f"sun{i}") for i in range(20)]
    body = WALL + disk(2, 1)
    alone = sum(see(body + light, size=(5, 5)) for light in lights)
    together = see(body + "".join(lights), size=(5, 5))
    assert np.all(np.abs(together - alone) <= len(lights) * 2.0**-24 * alone)
