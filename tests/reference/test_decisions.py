"""Every decision of the picture's definition (section 1), one test or more for each.

Unless said otherwise the stage is a floor z = 0 with normal +z, seen straight down, with k_a = k_d = 1/2,
and a directional light of irradiance 1 that shines straight down: the floor shows k_d = 1/2.
"""

from __future__ import annotations

import math
import sys
from decimal import Decimal
from fractions import Fraction

import pytest

from whitted_reference import SceneError, Tracer

FLOOR = """<shape type="rectangle" id="floor"><transform name="to_world"><scale value="8"/></transform>
  <bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/></bsdf></shape>"""
SUN = '<emitter type="directional" id="sun"><vector name="direction" value="0,0,-1"/></emitter>'
SKY = '<emitter type="constant"><float name="radiance" value="0.25"/></emitter>'
AMBIENT = '<rgb name="ambient" value="0.125"/>'
DOWN = (0, 0, -1)


def depth(n: int) -> str:
    return f'<integer name="max_depth" value="{n}"/>'


def mirror(k_m: float = 1.0) -> str:
    return f"""<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
      <float name="mirror_reflectance" value="{k_m}"/></bsdf>"""


# --------------------------------------------------------------------------------------- what is hit
def test_background_is_seen_from_depth_one(eye):
    assert eye(SKY, depth(1)).sees((0, 0, 1), DOWN, 0.25)
    assert eye(SKY, depth(0)).sees((0, 0, 1), DOWN, 0)


def test_lit_surface_is_seen_from_depth_two_with_ambient(eye):
    assert eye(FLOOR + SUN, AMBIENT + depth(1)).sees((0, 0, 1), DOWN, 0)
    assert eye(FLOOR + SUN, AMBIENT + depth(2)).sees((0, 0, 1), DOWN, Fraction(1, 2) + Fraction(1, 16))


def test_back_of_a_surface_is_black_in_every_term(eye):
    shining = FLOOR.replace("</shape>", '<emitter type="area"><float name="radiance" value="2"/></emitter></shape>')
    up = SUN.replace("0,0,-1", "0,0,1")
    assert eye(shining + up + SKY, AMBIENT).sees((0, 0, -1), (0, 0, 1), 0)


def test_surface_exactly_edge_on_is_not_hit(eye):
    assert eye(FLOOR + SKY).sees((-20, 0, 0), (1, 0, 0), 0.25)


def test_geometric_back_is_black_even_where_the_shading_normal_faces_the_eye(eye, ply):
    # The face's normal is +z; its vertex normals lean so far that they face an eye below the face.
    tilted = ply([(-1, -1, 0, 1, 0, 0.25), (2, -1, 0, 1, 0, 0.25), (-1, 2, 0, 1, 0, 0.25)], [(0, 1, 2)],
                 ("x", "y", "z", "nx", "ny", "nz"))  # fmt: skip
    body = '<shape type="ply"><string name="filename" value="t.ply"/></shape>'
    scene = eye(body + SKY, AMBIENT, files={"t.ply": tilted})
    # n.v > 0: v = (4, 0, -1) / |.|, n = (4, 0, 1) / |.|
    assert scene.sees((4, 0, -1), (-4, 0, 1), 0)
    above = Decimal(1) / 16 / Decimal("3.14159265358979323846264338327950288")
    assert scene.sees((4, 0, 1), (-4, 0, -1), above)


# ------------------------------------------------------------------------------------------ emission
def test_area_light_is_seen_from_depth_one_and_lights_nothing(eye):
    lamp = """<shape type="rectangle"><transform name="to_world"><translate z="-1"/></transform>
      <emitter type="area"><rgb name="radiance" value="2 3 4"/></emitter></shape>"""
    assert eye(lamp, depth(1)).sees((0, 0, 1), DOWN, 2, 3, 4)
    assert eye(lamp, depth(0)).sees((0, 0, 1), DOWN, 0)
    facing = lamp.replace('<translate z="-1"/>', '<rotate x="1" angle="180"/><translate z="1"/>')
    assert eye(FLOOR + facing).sees((4, 0, 1), DOWN, 0)


def test_area_light_has_no_diffuse_reflection_of_its_own(eye):
    lamp = '<shape type="rectangle"><emitter type="area"><float name="radiance" value="2"/></emitter></shape>'
    assert eye(lamp + SUN, AMBIENT).sees((0, 0, 1), DOWN, 2)


# --------------------------------------------------------------------------------- shadows: the segment
def roof(z: float, size: float = 1.0, extra: str = "") -> str:
    return f"""<shape type="rectangle" id="roof"><transform name="to_world"><scale value="{size}"/>
      <translate z="{z}"/></transform>{extra}</shape>"""


@pytest.mark.parametrize("gap", ["1", "1e-3", "1e-9", "1e-30"])
def test_everything_above_a_point_blocks_however_near(eye, gap):
    # The eye looks from below the roof where there is room, from the side else: along the floor's normal
    # only the roof's top would be seen, so the slanted ray starts between roof and floor.
    scene = eye(FLOOR + roof(float(gap)) + SUN)
    e = (0.0, 0.0, float(gap) / 2)
    assert scene.sees(e, DOWN, 0)
    assert scene.sees((4, 0, 1), DOWN, 0.5)


@pytest.mark.parametrize(
    "extra",
    ["", '<boolean name="flip_normals" value="true"/>', '<bsdf type="conductor"/>',
     '<emitter type="area"><float name="radiance" value="1"/></emitter>'],
)  # fmt: skip
def test_every_shape_blocks_from_both_sides_whatever_its_material(eye, extra):
    assert eye(FLOOR + roof(1, extra=extra) + SUN).sees((0, 0, 0.5), DOWN, 0)


def point_light(z: float) -> str:
    return f"""<emitter type="point" id="lamp"><point name="position" value="0,0,{z}"/>
      <float name="intensity" value="4"/></emitter>"""


def test_what_stands_behind_a_point_light_casts_no_shadow(eye):
    assert eye(FLOOR + roof(3) + point_light(2)).sees((0, 0, 0.5), DOWN, Fraction(1, 2))  # k_d 4 / 2^2
    assert eye(FLOOR + roof(1) + point_light(2)).sees((0, 0, 0.5), DOWN, 0)


def test_a_surface_exactly_at_the_light_does_not_block_and_is_a_tie(load_scene):
    tracer = Tracer(load_scene(FLOOR + roof(2) + point_light(2)))
    colour = tracer.raycolor((0.0, 0.0, 0.5), (0.0, 0.0, -1.0), 0.0, 10.0)
    assert colour == (0.5, 0.5, 0.5)
    assert tracer.ties == [("roof", "lamp")]


def test_a_light_exactly_at_the_point_adds_nothing_and_is_a_tie(load_scene):
    tracer = Tracer(load_scene(FLOOR + point_light(0)))
    assert tracer.raycolor((0.0, 0.0, 0.5), (0.0, 0.0, -1.0), 0.0, 10.0) == (0, 0, 0)
    assert tracer.ties == [("floor", "lamp")]


# ------------------------------------------------------------- a secondary ray leaves its own point
BALL = '<shape type="sphere" id="ball"><bsdf type="twosided">{}</bsdf></shape>'
LAMBERT = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/></bsdf>'


def test_a_ball_does_not_shade_its_own_lit_side(eye):
    assert eye('<shape type="sphere"><bsdf type="blinnphong"/></shape>' + SUN).sees((0, 0, 3), DOWN, 0.5)


def test_inside_a_ball_its_far_side_blocks_a_light_outside(eye):
    inside = BALL.format(LAMBERT)
    # Seen from the centre: the point (0, 0, -1), its normal turned up.
    assert eye(inside + SUN).sees((0, 0, 0), DOWN, 0)
    # A light inside is nearer than the far side: k_d 4 / (3/2)^2.
    assert eye(inside + point_light(0.5)).sees((0, 0, 0), DOWN, Fraction(1, 2) * 4 / Fraction(9, 4))


def test_inside_a_mirror_ball_the_ray_goes_across_again_and_again(eye):
    # Along the axis every bounce comes from the other pole, where a lamp at the centre adds k_d 4 / 1.
    body = BALL.format('<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/>'
                       '<float name="mirror_reflectance" value="0.5"/></bsdf>')  # fmt: skip
    lit = Fraction(2)
    scene = eye(body + point_light(0), depth(4))
    assert scene.sees((0, 0, 0.25), DOWN, lit * (1 + Fraction(1, 2) + Fraction(1, 4)))


def test_a_tube_drops_only_the_root_at_the_leaving_point(eye):
    tube = f"""<shape type="cylinder"><point name="p0" value="0,-4,0"/><point name="p1" value="0,4,0"/>
      <bsdf type="twosided">{LAMBERT}</bsdf></shape>"""
    assert eye(tube + SUN).sees((0, 0, 0), DOWN, 0)
    assert eye(tube + point_light(0.5)).sees((0, 0, 0), DOWN, Fraction(1, 2) * 4 / Fraction(9, 4))
    assert eye(tube + SUN).sees((0, 0, 3), DOWN, 0.5)


def test_a_tube_lets_light_out_and_in_through_its_open_ends(eye):
    # From (0, 0, -1) inside, towards (3, 4, 0): the far side would be met at y = 4 > 1/2, beyond the end.
    tube = f"""<shape type="cylinder"><point name="p0" value="0,-0.5,0"/><point name="p1" value="0,0.5,0"/>
      <bsdf type="twosided">{LAMBERT}</bsdf></shape>"""
    light = point_light(2).replace("0,0,2", "0,4,2").replace('"4"', '"25"')
    assert eye(tube + light).sees((0, 0, 0), DOWN, Fraction(1, 2) * Fraction(3, 5))


# ------------------------------------------------------------------------------------ epsilon, for teaching
def epsilon(value: float) -> str:
    return f'<float name="epsilon" value="{value}"/>'


def test_epsilon_leaves_out_what_is_nearer_and_nothing_else(eye):
    assert eye(FLOOR + roof(0.25) + SUN, epsilon(0.5)).sees((0, 0, 0.125), DOWN, 0.5)
    assert eye(FLOOR + roof(0.75) + SUN, epsilon(0.5)).sees((0, 0, 0.125), DOWN, 0)


def test_epsilon_applies_to_the_own_ball_as_to_any_other(eye):
    # From (0, 0, -1) inside the unit ball the far side is 2 away.
    assert eye(BALL.format(LAMBERT) + SUN, epsilon(1)).sees((0, 0, 0), DOWN, 0)
    assert eye(BALL.format(LAMBERT) + SUN, epsilon(3)).sees((0, 0, 0), DOWN, 0.5)


def test_epsilon_applies_to_mirror_rays_and_not_to_camera_rays(eye):
    glass = FLOOR.replace("</bsdf>", '<float name="mirror_reflectance" value="1"/></bsdf>')
    lamp = roof(0.25, extra="""<boolean name="flip_normals" value="true"/>
      <emitter type="area"><float name="radiance" value="2"/></emitter>""")  # fmt: skip
    assert eye(glass + lamp + SKY).sees((0, 0, 0.125), DOWN, 2)
    assert eye(glass + lamp + SKY, epsilon(0.5)).sees((0, 0, 0.125), DOWN, 0.25)


# ------------------------------------------------------------------------------------------ the horizon
def test_light_below_the_horizon_adds_nothing_highlight_included(eye):
    shiny = FLOOR.replace("</bsdf>", '<float name="specular_reflectance" value="1"/>'
                          '<float name="exponent" value="0"/></bsdf>')  # fmt: skip
    below = SUN.replace("0,0,-1", "4,0,1")  # l = (-4, 0, -1): n.l < 0 though n.h > 0 for a slanted eye
    assert eye(shiny + below).sees((0, 0, 1), DOWN, 0)
    level = SUN.replace("0,0,-1", "1,0,0")
    assert eye(shiny + level).sees((0, 0, 1), DOWN, 0)


def test_light_behind_the_face_adds_nothing_though_the_shading_normal_sees_it(eye, ply):
    tilted = ply([(-1, -1, 0, 1, 0, 1), (2, -1, 0, 1, 0, 1), (-1, 2, 0, 1, 0, 1)], [(0, 1, 2)],
                 ("x", "y", "z", "nx", "ny", "nz"))  # fmt: skip
    body = '<shape type="ply"><string name="filename" value="t.ply"/><bsdf type="blinnphong"/></shape>'
    below = SUN.replace("0,0,-1", "-4,0,1")  # l = (4, 0, -1): n.l > 0, n_g.l < 0
    assert eye(body + below, files={"t.ply": tilted}).sees((0, 0, 1), DOWN, 0)
    above = SUN.replace("0,0,-1", "-1,0,-1")  # l = n: n.l = 1
    assert eye(body + above, files={"t.ply": tilted}).sees((0, 0, 1), DOWN, 0.5)


def test_mirror_ray_into_the_face_is_not_followed(eye, ply):
    # n = (1, 0, 1/4) / |.|, v = (-1/8, 0, 1) / |.|: n.v > 0, n_g.v > 0, but r leaves below the face.
    tilted = ply([(-1, -1, 0, 1, 0, 0.25), (2, -1, 0, 1, 0, 0.25), (-1, 2, 0, 1, 0, 0.25)], [(0, 1, 2)],
                 ("x", "y", "z", "nx", "ny", "nz"))  # fmt: skip
    body = '<shape type="ply"><string name="filename" value="t.ply"/>' + mirror() + "</shape>"
    assert eye(body + SKY, files={"t.ply": tilted}).sees((-0.125, 0, 1), (0.125, 0, -1), 0)
    assert eye(body + SKY, files={"t.ply": tilted}).sees((4, 0, 1), (-4, 0, -1), 0.25)


# ------------------------------------------------------------------------------------------- the highlight
def test_highlight_is_n_h_to_the_exponent_and_contains_no_cosine(eye):
    shiny = """<shape type="rectangle"><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
      <float name="specular_reflectance" value="0.5"/><float name="exponent" value="{}"/></bsdf></shape>"""
    # Eye straight above, light in the direction (4, 0, 3) / 5: n.l = 3/5, (n.h)^2 = (1 + 3/5) / 2 = 4/5.
    sun = """<emitter type="point"><point name="position" value="4,0,3"/>
      <float name="intensity" value="25"/></emitter>"""
    for exponent in (2, 6):
        assert eye(shiny.format(exponent) + sun).sees(
            (0, 0, 1), DOWN, Fraction(1, 2) * Fraction(4, 5) ** (exponent // 2)
        )
    # Above SMALL_EXPONENT the other formula is used; the answer must be as exact.
    assert eye(shiny.format(128) + sun).sees((0, 0, 1), DOWN, Fraction(1, 2) * Fraction(4, 5) ** 64)


@pytest.mark.parametrize("exponent", [101, 1e4, 1e5])
def test_sharp_highlights_keep_their_digits(eye, exponent):
    # Eye and light stand so that nothing is exact and n.h is below 1 by about 1 / exponent, where the
    # highlight is of the order of 1 and the plain power of n.h would lose as many digits as exponent has.
    shiny = f"""<shape type="sphere"><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
      <float name="specular_reflectance" value="1"/><float name="exponent" value="{exponent}"/></bsdf></shape>"""
    lamp = """<emitter type="point"><point name="position" value="3,1,5"/>
      <float name="intensity" value="30"/></emitter>"""
    aside = 1 / math.sqrt(exponent)
    colour = eye(shiny + lamp).see((-2.3, 0.4, 5), (2.3 + 0.06 + aside, -0.4 + 0.15, -4.02))[0]
    assert colour.low > 0.0


def test_exponent_zero_gives_a_highlight_of_one(eye):
    shiny = """<shape type="rectangle"><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
      <float name="specular_reflectance" value="0.5"/><float name="exponent" value="0"/></bsdf></shape>"""
    assert eye(shiny + SUN.replace("0,0,-1", "4,0,-1")).sees((0, 0, 1), DOWN, 0.5)


# ------------------------------------------------------------------------------------------------- sides
def test_inside_twosided_the_normal_turns_and_the_second_material_is_behind(eye):
    two = FLOOR.replace("<bsdf", '<bsdf type="twosided"><bsdf').replace("</bsdf>", "</bsdf>{}</bsdf>")
    up = SUN.replace("0,0,-1", "0,0,1")
    assert eye(two.format("") + up, AMBIENT).sees((0, 0, -1), (0, 0, 1), Fraction(9, 16))
    other = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.25"/></bsdf>'
    assert eye(two.format(other) + up, AMBIENT).sees((0, 0, -1), (0, 0, 1), Fraction(9, 32))
    assert eye(two.format(other) + SUN, AMBIENT).sees((0, 0, 1), DOWN, Fraction(9, 16))
    # The light must be on the side that is seen.
    assert eye(two.format("") + SUN).sees((0, 0, -1), (0, 0, 1), 0)


def test_area_light_stays_one_sided_inside_twosided(eye):
    body = FLOOR.replace("<bsdf", '<bsdf type="twosided"><bsdf').replace(
        "</bsdf>", '</bsdf></bsdf><emitter type="area"><float name="radiance" value="2"/></emitter>'
    )
    up = SUN.replace("0,0,-1", "0,0,1")
    assert eye(body + up).sees((0, 0, -1), (0, 0, 1), 0.5)
    assert eye(body + SUN).sees((0, 0, 1), DOWN, 2.5)


# ------------------------------------------------------------------------------------------------- depth
# Two walls that face each other at z = 0 and z = 2, and a lamp between that lights both with k_d 2 = 1.
HALL = """<shape type="rectangle"><transform name="to_world"><scale value="8"/></transform>{0}</shape>
  <shape type="rectangle"><transform name="to_world"><scale x="8" y="8" z="-1"/>
    <translate z="2"/></transform>{0}</shape>
  <emitter type="point"><point name="position" value="0,0,1"/><float name="intensity" value="2"/></emitter>"""


@pytest.mark.parametrize(("max_depth", "expected"), [(1, 0), (2, Fraction(1, 2)), (3, Fraction(3, 4))])
def test_mirrors_show_lamps_from_depth_two_and_lit_surfaces_from_three(eye, max_depth, expected):
    # A mirror (k_m = 1/4) under a ceiling that shines 2 and under the light of a lamp shows k_d = 1/2.
    lower = (
        FLOOR.replace('"floor">', '"mirror">')
        .replace('value="0.5"/>', 'value="0"/>')
        .replace("</bsdf>", '<float name="mirror_reflectance" value="0.25"/></bsdf>')
    )
    ceiling = """<shape type="rectangle">
      <transform name="to_world"><scale z="-1"/><translate z="2"/></transform>
      <bsdf type="blinnphong"/><emitter type="area"><float name="radiance" value="2"/></emitter></shape>
      <emitter type="point"><point name="position" value="0,0,1"/><float name="intensity" value="2"/>
      </emitter>"""
    assert eye(lower + ceiling, depth(max_depth)).sees((0, 0, 0.5), DOWN, expected)


def test_two_mirrors_add_up_a_series_that_depth_cuts(eye):
    # c_n = 1 + k_m c_(n-1)
    wall = '<bsdf type="blinnphong"><float name="mirror_reflectance" value="0.5"/></bsdf>'
    for n in range(1, 9):
        expected = sum(Fraction(1, 2) ** i for i in range(n - 1))
        assert eye(HALL.format(wall), depth(n)).sees((0, 0, 0.5), DOWN, expected)


def test_unlimited_depth_ends_when_the_share_falls_below_2_to_minus_24(eye):
    wall = '<bsdf type="blinnphong"><float name="mirror_reflectance" value="0.5"/></bsdf>'
    # Ray k carries 2^-k; 2^-24 is not below 2^-24, so ray 24 is the last.
    expected = sum(Fraction(1, 2) ** i for i in range(25))
    assert eye(HALL.format(wall), depth(-1)).sees((0, 0, 0.5), DOWN, expected)


def test_unlimited_depth_goes_on_while_one_channel_carries_enough(eye):
    wall = """<bsdf type="blinnphong"><rgb name="mirror_reflectance" value="0.5 0.00390625 0"/></bsdf>"""
    red = sum(Fraction(1, 2) ** i for i in range(25))
    green = sum(Fraction(1, 256) ** i for i in range(25))
    assert eye(HALL.format(wall), depth(-1)).sees((0, 0, 0.5), DOWN, red, green, 1)


def test_unlimited_depth_ends_after_1024_bounces(eye):
    wall = '<bsdf type="blinnphong"><float name="mirror_reflectance" value="1"/></bsdf>'
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(5000)
    try:
        assert eye(HALL.format(wall), depth(-1)).sees((0, 0, 0.5), DOWN, 1025)
        # Ray 1024 is the last that sees anything, shining walls included.
        shining = wall + '<emitter type="area"><float name="radiance" value="1"/></emitter>'
        assert eye(HALL.format(shining), depth(-1)).sees((0, 0, 0.5), DOWN, 2 * 1025)
        # "With -1, and only then": a finite depth goes farther.
        assert eye(HALL.format(wall), depth(1101)).sees((0, 0, 0.5), DOWN, 1100)
    finally:
        sys.setrecursionlimit(limit)


def test_finite_depth_knows_no_least_share(eye):
    wall = '<bsdf type="blinnphong"><float name="mirror_reflectance" value="0.00390625"/></bsdf>'
    expected = sum(Fraction(1, 256) ** i for i in range(6))
    assert eye(HALL.format(wall), depth(7)).sees((0, 0, 0.5), DOWN, expected)


def test_depth_below_minus_one_is_refused(load_scene):
    with pytest.raises(SceneError, match=r"max_depth.*-2.*allowed: whole numbers -1 to"):
        load_scene(FLOOR, depth(-2))


# -------------------------------------------------------------------------------------------------- ties
def test_coincident_surfaces_that_differ_are_a_tie(load_scene):
    twin = FLOOR.replace('"floor"', '"twin"').replace('value="0.5"', 'value="0.25"')
    tracer = Tracer(load_scene(FLOOR + twin))
    tracer.raycolor((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.0, 10.0)
    assert tracer.ties == [("floor", "twin")]


def test_a_shared_edge_of_one_flat_surface_is_no_tie_and_of_a_bent_one_is(load_scene, ply):
    corners = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
    body = """<shape type="ply"><string name="filename" value="t.ply"/>
      <boolean name="face_normals" value="true"/></shape>"""
    faces = [(0, 1, 2), (0, 2, 3)]
    flat = Tracer(load_scene(body, files={"t.ply": ply(corners, faces)}))
    flat.raycolor((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.0, 10.0)
    assert flat.ties == []
    corners[1] = (1.0, -1.0, -1.0)
    bent = Tracer(load_scene(body, files={"t.ply": ply(corners, faces)}))
    bent.raycolor((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.0, 10.0)
    assert len(bent.ties) == 1


# ---------------------------------------------------------------------------------------------- switches
@pytest.mark.parametrize(
    ("switch", "expected"),
    [
        ("", Fraction(1, 16) + Fraction(1, 2) + Fraction(1, 4) + Fraction(1, 32)),
        ("enable_ambient", Fraction(1, 2) + Fraction(1, 4) + Fraction(1, 32)),
        ("enable_diffuse", Fraction(1, 16) + Fraction(1, 4) + Fraction(1, 32)),
        ("enable_specular", Fraction(1, 16) + Fraction(1, 2) + Fraction(1, 32)),
        ("enable_mirrors", Fraction(1, 16) + Fraction(1, 2) + Fraction(1, 4)),
    ],
)
def test_each_switch_leaves_out_one_term(eye, switch, expected):
    body = FLOOR.replace("</bsdf>", """<float name="specular_reflectance" value="0.25"/>
      <float name="mirror_reflectance" value="0.125"/></bsdf>""")  # fmt: skip
    off = f'<boolean name="{switch}" value="false"/>' if switch else ""
    assert eye(body + SUN + SKY, AMBIENT + off).sees((0, 0, 1), DOWN, expected)


def test_without_shadows_nothing_blocks(eye):
    off = '<boolean name="enable_shadows" value="false"/>'
    assert eye(FLOOR + roof(1) + SUN, off).sees((0, 0, 0.5), DOWN, 0.5)
