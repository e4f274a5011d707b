"""Each shape: where rays meet it, its normals, its uv, and what mirrored transforms do to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import pytest

from whitted_reference import NotDefined, SceneError, Tracer
from whitted_reference.arithmetic import FLOAT, INTERVAL


class Hit:
    """What a single ray meets: primitive, distance, normals and uv, each as a list of intervals."""

    def __init__(self, scene, e: Sequence[float], d: Sequence[float], with_uv: bool) -> None:
        for arithmetic in (FLOAT, INTERVAL):
            tracer = Tracer(scene, arithmetic)
            origin, (x, y, z) = arithmetic.vec(tuple(e)), arithmetic.vec(tuple(d))
            length = arithmetic.sqrt(x * x + y * y + z * z)
            d_unit = (x / length, y / length, z / length)
            before = arithmetic.before(arithmetic.of(0))
            primitive, t = tracer.first_hit(origin, d_unit, before, arithmetic.infinity, None)
            if primitive is None:
                self.t = None
                continue
            p = tuple(o + t * c for o, c in zip(origin, d_unit, strict=True))
            n, n_g = primitive.normals(origin, d_unit, t, p)
            uv = primitive.uv(origin, d_unit, t, p) if with_uv else ()
            if arithmetic is FLOAT:
                plain = (t, *n, *n_g, *uv)
            else:
                self.t, self.n, self.n_g, self.uv, self.id = t, n, n_g, uv, primitive.surface.id
                for interval, value in zip((t, *n, *n_g, *uv), plain, strict=True):
                    assert interval.low <= value <= interval.high
                    # Eight digits to spare below single precision, whatever the shape.
                    assert interval.width <= 2.0**-44


def near(intervals, exact, off=0.0) -> bool:
    """Tell whether exact numbers lie in the intervals, or no farther than `off` outside."""
    return all(i.low - off <= x <= i.high + off for i, x in zip(intervals, exact, strict=True))


@pytest.fixture
def hit(load_scene):
    def make(body: str, e: Sequence[float], d: Sequence[float], with_uv: bool = False, **kwargs) -> Hit:
        return Hit(load_scene(body, **kwargs), e, d, with_uv)

    return make


def shape(kind: str, *parameters: str, to_world: str = "") -> str:
    move = f'<transform name="to_world">{to_world}</transform>' if to_world else ""
    return f'<shape type="{kind}" id="it">{"".join(parameters)}{move}</shape>'


FLIP = '<boolean name="flip_normals" value="true"/>'
MIRROR_X = '<scale x="-1"/>'


# ------------------------------------------------------------------------------------------------ sphere
BALL = shape("sphere", '<point name="center" value="1,2,3"/>', '<float name="radius" value="2"/>')


@pytest.mark.parametrize(
    ("e", "d", "t", "n"),
    [
        ((1, 2, 8), (0, 0, -1), 3, (0, 0, 1)),
        ((1, 2, 3), (0, 0, -1), 2, (0, 0, -1)),  # from inside: the far side, its normal outward
        ((1, 2, 5), (0, 0, 1), 0, (0, 0, 1)),  # an eye on the surface sees it: camera rays are closed
        ((1, 2, 5), (0, 0, -1), 0, (0, 0, 1)),
        # Line at height 6/5 over the centre: half chord 8/5.
        ((-9, 2, Fraction(21, 5)), (1, 0, 0), 10 - Fraction(8, 5), (Fraction(-4, 5), 0, Fraction(3, 5))),
    ],
)
def test_sphere_is_met_at_the_smaller_root_ahead(hit, e, d, t, n):
    seen = hit(BALL, [float(x) for x in e], d)
    # 21/5 is not a binary number: the eye is off by up to 2^-51, the chord by 2^-51 * 2.
    off = 2.0**-49 if Fraction(21, 5) in e else 0.0
    assert near([seen.t, *seen.n], [t, *n], off)
    assert seen.n == seen.n_g or seen.n is seen.n_g


@pytest.mark.parametrize(("e", "d"), [((1, 2, 8), (0, 0, 1)), ((1, 4.5, 8), (0, 0, -1)), ((9, 9, 9), (1, 0, 0))])
def test_sphere_is_missed_behind_and_beside(hit, e, d):
    assert hit(BALL, e, d).t is None


def test_sphere_far_away_loses_no_digits(hit):
    # From 2^20 away the plain discriminant b^2 - c would cancel 40 of 53 bits; here the chord is exact.
    seen = hit(BALL, (1, 2, 3 + 2.0**20), (0, 0, -1))
    assert near([seen.t], [2**20 - 2])
    assert seen.t.width <= 2.0**-30


@pytest.mark.parametrize(
    ("parameters", "to_world", "sign"),
    [("", "", 1), (FLIP, "", -1), ("", MIRROR_X, -1), (FLIP, MIRROR_X, 1), ("", '<scale value="-1"/>', -1),
     ("", '<scale x="-1" y="-1"/>', 1)],
)  # fmt: skip
def test_mirrored_sphere_turns_inside_out(hit, parameters, to_world, sign):
    seen = hit(shape("sphere", parameters, to_world=to_world), (0, 0, 3), (0, 0, -1))
    assert near(seen.n, (0, 0, sign))


def test_sphere_uv_are_azimuth_and_polar_angle_of_its_own_axes(hit):
    for point, u, v in [((1, 1, 0), 0.125, 0.5), ((-1, 1, 0), 0.375, 0.5), ((1, -1, 0), 0.875, 0.5),
                        ((1, 0, 1), 0, 0.25), ((-1, 0, -1), 0.5, 0.75)]:  # fmt: skip
        seen = hit(shape("sphere"), [3 * x for x in point], [-x for x in point], with_uv=True)
        assert near(seen.uv, (u, v), 2.0**-50)  # atan2 of numbers off by 2^-53, over pi
    turned = shape("sphere", to_world='<matrix value="0 -1 0 0 1 0 0 0 0 0 1 0 0 0 0 1"/>')
    assert near(hit(turned, (0, 3, 3), (0, -1, -1), with_uv=True).uv, (0, 0.25), 2.0**-50)


def test_sphere_with_shear_or_unequal_scale_is_not_judged(load_scene):
    with pytest.raises(NotDefined, match="sphere with unequal scale"):
        load_scene(shape("sphere", to_world='<scale x="1.00001"/>'))
    with pytest.raises(NotDefined, match="sphere with shear"):
        load_scene(shape("sphere", to_world='<matrix value="1 0.001 0  0 1 0  0 0 1"/>'))
    load_scene(shape("sphere", to_world='<scale value="0.7"/><rotate x="0.6" y="0.8" angle="33"/>'))


# ----------------------------------------------------------------------------------- rectangle and disk
def test_rectangle_is_met_up_to_and_with_its_sides(hit):
    body = shape("rectangle", to_world='<scale x="2" y="4"/><translate z="1"/>')
    for x, y in [(0, 0), (2, 4), (-2, 4), (2, -4), (-2, -4), (2, 0), (0, -4)]:
        seen = hit(body, (x, y, 3), (0, 0, -1), with_uv=True)
        assert near([seen.t, *seen.n], [2, 0, 0, 1])
        assert near(seen.uv, ((x / 2 + 1) / 2, (y / 4 + 1) / 2))
    for x, y in [(math.nextafter(2, 3), 0), (0, math.nextafter(-4, -5))]:
        assert hit(body, (x, y, 3), (0, 0, -1)).t is None


def test_sheared_rectangle_is_a_parallelogram(hit):
    # (x, y) -> (x + y, y): corners (2, 1), (0, 1), (-2, -1), (0, -1).
    body = shape("rectangle", to_world='<matrix value="1 1 0  0 1 0  0 0 1"/>')
    assert near(hit(body, (1.5, 0.75, 1), (0, 0, -1), with_uv=True).uv, (0.875, 0.875))
    assert hit(body, (-0.5, 0.75, 1), (0, 0, -1)).t is None


def test_disk_is_met_up_to_and_with_its_rim(hit):
    body = shape("disk", to_world='<scale value="2"/>')
    for x, y in [(0, 0), (2, 0), (0, -2), (0, 1)]:
        seen = hit(body, (x, y, 3), (0, 0, -1))
        assert near([seen.t, *seen.n], [3, 0, 0, 1])
    assert hit(body, (math.nextafter(2, 3), 0, 3), (0, 0, -1)).t is None
    assert hit(body, (1.5, 1.5, 3), (0, 0, -1)).t is None


def test_disk_uv_are_radius_and_turn(hit):
    for (x, y), v in [((0.5, 0), 0), ((0, 0.5), 0.25), ((-0.5, 0), 0.5), ((0, -0.5), 0.75)]:
        assert near(hit(shape("disk"), (x, y, 3), (0, 0, -1), with_uv=True).uv, (0.5, v), 2.0**-50)


@pytest.mark.parametrize("kind", ["rectangle", "disk"])
@pytest.mark.parametrize(
    ("parameters", "to_world", "n"),
    [("", MIRROR_X, (0, 0, 1)), ("", '<scale z="-1"/>', (0, 0, -1)), (FLIP, "", (0, 0, -1)),
     (FLIP, '<scale z="-1"/>', (0, 0, 1)), ("", '<scale x="-1" y="-1" z="-1"/>', (0, 0, -1))],
)  # fmt: skip
def test_flat_shapes_follow_the_inverse_transpose(hit, kind, parameters, to_world, n):
    seen = hit(shape(kind, parameters, to_world=to_world), (0.25, 0.25, 3), (0, 0, -1))
    assert near(seen.n, n)
    assert near(seen.n_g, n)


@pytest.mark.parametrize("kind", ["rectangle", "disk"])
def test_normal_of_a_flat_shape_is_not_its_sheared_axis(hit, kind):
    # M z = (1, 0, 1) though the plane stays z = 0, whose normal is M^-T z = z.
    body = shape(kind, to_world='<matrix value="1 0 1  0 1 0  0 0 1"/>')
    assert near(hit(body, (0.25, 0.25, 3), (0, 0, -1)).n, (0, 0, 1))


# ---------------------------------------------------------------------------------------------- cylinder
TUBE = shape("cylinder", '<point name="p0" value="0,0,-1"/>', '<point name="p1" value="0,0,3"/>',
             '<float name="radius" value="2"/>')  # fmt: skip


def test_cylinder_is_met_between_its_ends_and_has_no_caps(hit):
    for z in (-1, 0, 3):
        seen = hit(TUBE, (5, 0, z), (-1, 0, 0), with_uv=True)
        assert near([seen.t, *seen.n], [3, 1, 0, 0])
        assert near(seen.uv, (0, (z + 1) / 4))
    for z in (-1 - 2.0**-40, 3 + 2.0**-40):
        assert hit(TUBE, (5, 0, z), (-1, 0, 0)).t is None
    assert hit(TUBE, (0, 0, 9), (0, 0, -1)).t is None


def test_cylinder_is_met_on_the_far_side_through_an_open_end(hit):
    # In through the end z = 3: from (0, 0, 5) along (-1, 0, -1) the tube is met at (-2, 0, 3).
    assert near([hit(TUBE, (1, 0, 5), (-1, 0, -1)).t], [math.sqrt(18)], 2.0**-50)
    assert near(hit(TUBE, (1, 0, 5), (-1, 0, -1)).n, (-1, 0, 0), 2.0**-50)


@pytest.mark.parametrize(
    ("parameters", "to_world", "sign"),
    [("", "", 1), (FLIP, "", -1), ("", MIRROR_X, 1), (FLIP, MIRROR_X, -1), ("", '<scale z="-1"/>', 1)],
)
def test_mirrored_cylinder_stays_outward(hit, parameters, to_world, sign):
    body = shape("cylinder", parameters, '<point name="p0" value="0,0,-1"/>', to_world=to_world)
    assert near(hit(body, (3, 0, 0), (-1, 0, 0)).n, (sign, 0, 0))


def test_cylinder_may_be_longer_than_wide_but_not_flattened(load_scene):
    load_scene(shape("cylinder", to_world='<scale z="3"/><rotate x="1" angle="40"/>'))
    with pytest.raises(NotDefined, match="cylinder with unequal scale"):
        load_scene(shape("cylinder", to_world='<scale x="1.00001"/>'))


# -------------------------------------------------------------------------------------------------- cube
@pytest.mark.parametrize("to_world", ["", MIRROR_X, '<scale value="-1"/>'])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_cube_is_outward_however_mirrored(hit, to_world, axis, side):
    e, n = [0.25, 0.125, 0.5], [0, 0, 0]
    e[axis], n[axis] = 3 * side, side
    d = [-x for x in n]
    seen = hit(shape("cube", to_world=to_world), e, d)
    assert near([seen.t, *seen.n, *seen.n_g], [2, *n, *n])


def test_cube_faces_each_span_the_unit_square_of_uv(hit):
    # Mitsuba's cube.cpp: on the top face u runs with +y... as its table of corners says.
    assert near(hit(shape("cube"), (0.5, 0.25, 3), (0, 0, -1), with_uv=True).uv, (0.625, 0.75))
    assert near(hit(shape("cube"), (0.5, -3, 0.25), (0, 1, 0), with_uv=True).uv, (0.625, 0.75))
    assert near(hit(shape("cube"), (3, 0.5, 0.25), (-1, 0, 0), with_uv=True).uv, (0.75, 0.375))


# ---------------------------------------------------------------------------------------------- triangles
def mesh(*parameters: str, to_world: str = "") -> str:
    return shape("ply", '<string name="filename" value="m.ply"/>', *parameters, to_world=to_world)


FACETED = '<boolean name="face_normals" value="true"/>'


def test_triangle_distance_and_weights_by_cramers_rule(hit, ply):
    # Plane x + y + z = 1, met along (1, 1, 1) at (1/3, 1/3, 1/3); beta = gamma = 1/3.
    files = {"m.ply": ply([(1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2)])}
    seen = hit(mesh(FACETED), (2, 2, 2), (-1, -1, -1), files=files, with_uv=True)
    third = Fraction(1, 3)
    assert near(seen.uv, (third, third))
    root = 1 / math.sqrt(3)
    assert near([seen.t, *seen.n], [5 * root, root, root, root], 2.0**-50)


def test_triangle_uv_and_normals_are_interpolated(hit, ply):
    rows = [(0, 0, 0, 0, 0, 1, 0, 0), (4, 0, 0, 0, 0, 1, 1, 0), (0, 4, 0, 1, 0, 1, 0, 0.5)]
    files = {"m.ply": ply(rows, [(0, 1, 2)], ("x", "y", "z", "nx", "ny", "nz", "u", "v"))}
    seen = hit(mesh(), (1, 2, 3), (0, 0, -1), files=files, with_uv=True)  # beta 1/4, gamma 1/2
    assert near(seen.uv, (0.25, 0.25))
    # n = (1/2) z + (1/2) (1, 0, 1) / sqrt 2, normalised.
    x, z = 0.5 / math.sqrt(2), 0.5 + 0.5 / math.sqrt(2)
    assert near(seen.n, (x / math.hypot(x, z), 0, z / math.hypot(x, z)), 2.0**-50)
    assert near(seen.n_g, (0, 0, 1))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_geometric_normal_turns_to_the_shading_normal(hit, ply, order):
    rows = [(0, 0, 0, 0, 0, 1), (4, 0, 0, 0, 0, 1), (0, 4, 0, 0, 0, 1)]
    files = {"m.ply": ply(rows, [order], ("x", "y", "z", "nx", "ny", "nz"))}
    seen = hit(mesh(), (1, 1, 3), (0, 0, -1), files=files)
    assert near(seen.n_g, (0, 0, 1))
    assert near(hit(mesh(FLIP), (1, 1, 3), (0, 0, -1), files=files).n, (0, 0, -1))


@pytest.mark.parametrize(("parameters", "to_world", "z"), [
    ((FACETED,), "", 1), ((FACETED,), MIRROR_X, -1), ((FACETED, FLIP), MIRROR_X, 1), ((), "", 1),
    ((), MIRROR_X, -1),
])  # fmt: skip
def test_mesh_without_normals_reverses_with_its_winding(hit, ply, parameters, to_world, z):
    files = {"m.ply": ply([(-4, -4, 0), (4, -4, 0), (0, 4, 0)], [(0, 1, 2)])}
    seen = hit(mesh(*parameters, to_world=to_world), (0, 0, 3), (0, 0, -1), files=files)
    assert near(seen.n, (0, 0, z))


def test_mesh_with_normals_keeps_them_when_mirrored(hit, ply):
    rows = [(-4, -4, 0, 0, 0, 1), (4, -4, 0, 0, 0, 1), (0, 4, 0, 0, 0, 1)]
    files = {"m.ply": ply(rows, [(0, 1, 2)], ("x", "y", "z", "nx", "ny", "nz"))}
    assert near(hit(mesh(to_world=MIRROR_X), (0, 0, 3), (0, 0, -1), files=files).n, (0, 0, 1))
    # M^-T, not M: squeezed along x, a normal leans towards x.
    rows = [(*row[:3], 1, 0, 1) for row in rows]
    files = {"m.ply": ply(rows, [(0, 1, 2)], ("x", "y", "z", "nx", "ny", "nz"))}
    seen = hit(mesh(to_world='<scale x="0.5"/>'), (0, 0, 3), (0, 0, -1), files=files)
    assert near(seen.n, (2 / math.sqrt(5), 0, 1 / math.sqrt(5)), 2.0**-50)


def test_vertex_normals_are_made_of_the_faces_weighted_by_angle(hit, ply):
    # Two faces meet along x = 0: one flat with 90 degrees at the origin, one upright with 45 degrees.
    vertices = [(0, 0, 0), (4, 0, 0), (0, 4, 0), (0, 4, 4)]
    faces = [(0, 1, 2), (0, 2, 3)]  # normals z and x, angles at vertex 0: pi/2 and pi/4
    files = {"m.ply": ply(vertices, faces)}
    seen = hit(mesh(), (0, 0, 3), (0, 0, -1), files=files)
    assert near(seen.n, (1 / math.sqrt(5), 0, 2 / math.sqrt(5)), 2.0**-48)


def test_zero_area_triangles_are_never_hit(hit, ply):
    vertices = [(0, 0, 0), (1, 1, 0), (3, 3, 0), (0.1, 0.1, 0)]
    files = {"m.ply": ply(vertices, [(0, 1, 2), (0, 0, 1), (0, 3, 1)])}
    assert hit(mesh(FACETED), (1, 1, 3), (0, 0, -1), files=files).t is None


def test_no_ray_slips_between_triangles_that_share_an_edge(load_scene, ply, bumpy):
    """Aim from inside a closed mesh at points of its edges and at its vertices: every ray must hit."""
    vertices, faces = bumpy
    files = {"m.ply": ply(vertices, faces)}
    tracer = Tracer(load_scene(mesh(FACETED, to_world='<rotate x="1" angle="17"/>'), files=files), hierarchy=False)
    world = Tracer(load_scene(mesh(FACETED, to_world='<rotate x="1" angle="17"/>'), files=files))
    corners = [c for p in tracer.primitives[::3] for c in [p._corners]]
    for a, b, c in corners:
        for target in (a, [(x + y) / 2 for x, y in zip(a, b, strict=True)],
                       [x + (y - x) / 3 for x, y in zip(b, c, strict=True)]):  # fmt: skip
            e = (0.1, -0.05, 0.02)
            d = [t - o for t, o in zip(target, e, strict=True)]
            length = math.hypot(*d)
            d = tuple(x / length for x in d)
            one = tracer.first_hit(e, d, 0.0, math.inf, None)
            assert one[0] is not None
            other = world.first_hit(e, d, 0.0, math.inf, None)
            assert (one[0].index, one[1]) == (other[0].index, other[1])


# ---------------------------------------------------------------------------------------------- instances
GROUP = """<shape type="shapegroup" id="group"><shape type="sphere" id="ball"/></shape>
  <shape type="instance" id="it"><ref id="group"/><transform name="to_world">{}</transform></shape>"""


def test_instance_makes_an_ellipsoid(hit):
    seen = hit(GROUP.format('<scale x="4" y="2" z="1"/><translate z="1"/>'), (0, 0, 5), (0, 0, -1))
    assert near([seen.t, *seen.n], [3, 0, 0, 1])
    assert seen.id == "it/ball"
    # At local (3/5, 0, 4/5) the normal is M^-T of it: (3/20, 0, 4/5), normalised.
    seen = hit(GROUP.format('<scale x="4" y="2" z="1"/>'), (2.4, 0, 5), (0, 0, -1))
    length = math.hypot(3 / 20, 4 / 5)
    assert near([seen.t, *seen.n], [4.2, 3 / 20 / length, 0, 4 / 5 / length], 2.0**-48)  # 2.4 is rounded


def test_instance_keeps_distances_along_the_ray(hit):
    assert near([hit(GROUP.format('<scale x="1" y="1" z="4"/>'), (0, 0, 9), (0, 0, -1)).t], [5])
    # From inside, the far side; and again for a ray that leaves the near side (see the mirror ball).
    assert near([hit(GROUP.format('<scale value="4"/>'), (0, 0, 0), (0, 0, -1)).t], [4])


def test_mesh_in_a_mirrored_instance_keeps_its_normals_on_its_outside(hit, ply):
    # M^-T of (0.5, 0, 1) under z -> -z is (0.5, 0, -1); the face's winding must follow that side.
    rows = [(-4, -4, 0, 0.5, 0, 1), (4, -4, 0, 0.5, 0, 1), (0, 4, 0, 0.5, 0, 1)]
    files = {"m.ply": ply(rows, [(0, 1, 2)], ("x", "y", "z", "nx", "ny", "nz"))}
    group = GROUP.replace('<shape type="sphere" id="ball"/>', mesh())
    seen = hit(
        group.replace('id="it"><ref', 'id="place"><ref').format('<scale z="-1"/>'), (0, 0, -3), (0, 0, 1), files=files
    )
    assert near(seen.n_g, (0, 0, -1))
    assert near(seen.n, (0.5 / math.sqrt(1.25), 0, -1 / math.sqrt(1.25)), 2.0**-50)


@pytest.mark.parametrize("to_world", ["", MIRROR_X, '<scale value="-2"/>'])
def test_mirrored_instance_stays_outward(hit, to_world):
    seen = hit(GROUP.format(to_world), (0, 0, 9), (0, 0, -1))
    assert near(seen.n, (0, 0, 1))


def test_instance_refers_to_a_group_and_nothing_else(load_scene):
    with pytest.raises(SceneError, match="exactly one shapegroup"):
        load_scene('<shape type="instance"/>')
    with pytest.raises(SceneError, match="`lamp` is an area light"):
        load_scene('<shape type="shapegroup" id="g"><shape type="sphere" id="lamp"><emitter type="area"/>'
                   "</shape></shape>")  # fmt: skip


def test_inside_an_instance_a_ball_blocks_its_own_far_side(eye):
    body = """<shape type="shapegroup" id="group"><shape type="sphere">
      <bsdf type="twosided"><bsdf type="blinnphong"/></bsdf></shape></shape>
      <shape type="instance"><ref id="group"/>
        <transform name="to_world"><scale value="2"/></transform></shape>
      <emitter type="directional"><vector name="direction" value="0,0,-1"/></emitter>"""
    assert eye(body).sees((0, 0, 0), (0, 0, -1), 0)
    assert eye(body).sees((0, 0, 5), (0, 0, -1), 0.5)


# ------------------------------------------------------------------------------------------ refused input
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (shape("sphere", '<float name="radius" value="0"/>'), "`it`: radius is 0"),
        (shape("sphere", '<float name="radius" value="1e-50"/>'), "`it`: radius is 0"),
        (shape("cylinder", '<float name="radius" value="0"/>'), "`it`: radius 0"),
        (shape("cylinder", '<point name="p1" value="0,0,0"/>'), "`it`: radius 1, length 0"),
        (shape("rectangle", to_world='<scale x="0"/>'), "<transform> of `rectangle` `it`: `to_world` is singular"),
        (
            shape("disk", to_world='<scale value="1e-39"/>'),
            "<transform> of `disk` `it`: `to_world` is singular or not finite",
        ),
        (shape("cube", to_world='<scale value="1e30"/><scale value="1e30"/>'), "singular or not finite"),
        (
            shape("sphere", '<float name="radius" value="nan"/>'),
            "of `sphere` `it` `radius`: `nan` is not a finite decimal number",
        ),
        (shape("sphere", '<point name="center" value="0,1e39,0"/>'), "`1e39` is beyond single precision"),
    ],
)
def test_degenerate_and_endless_shapes_are_refused(load_scene, body, message):
    with pytest.raises(SceneError) as error:
        load_scene(body)
    assert message in str(error.value)
