"""The polygon: crossing rule, rings, its plane and normal, and what is refused."""

from __future__ import annotations

import math

import pytest

from whitted_reference import SceneError, Tracer
from whitted_reference.arithmetic import DECIMAL, FLOAT, INTERVAL

SQUARE = "-2,-2,0 2,-2,0 2,2,0 -2,2,0"
HOLE = "-1,-1,0 1,-1,0 1,1,0 -1,1,0"
PENTAGRAM = "0,4,0 2.5,-3,0 -4,1.5,0 4,1.5,0 -2.5,-3,0"


def polygon(vertices: str, extra: str = "", to_world: str = "") -> str:
    move = f'<transform name="to_world">{to_world}</transform>' if to_world else ""
    return f'<shape type="polygon" id="it"><string name="vertices" value="{vertices}"/>{extra}{move}</shape>'


@pytest.fixture
def meets(load_scene):
    """Return the first hit of a vertical ray through (x, y), the same in all arithmetics, or None."""

    def make(body: str, x: float, y: float, d: tuple[int, int, int] = (0, 0, -1)):
        answers = []
        for arithmetic in (FLOAT, DECIMAL, INTERVAL):
            with arithmetic.scope():
                tracer = Tracer(load_scene(body), arithmetic)
                e = arithmetic.vec((x, y, -8.0 * d[2]))
                found = tracer.first_hit(e, arithmetic.vec(d), arithmetic.of(0), arithmetic.infinity, None)
                if found[0] is None:
                    answers.append(None)
                    continue
                normal = found[0].normals(e, arithmetic.vec(d), found[1], e)[0]
                answers.append((found[1], normal))
        assert len({answer is None for answer in answers}) == 1
        if answers[0] is None:
            return None
        t, n = answers[2]
        plain = (answers[0][0], *answers[0][1])
        assert all(i.low <= value <= i.high for i, value in zip((t, *n), plain, strict=True))
        return plain

    return make


def test_concave_polygon_has_no_area_in_its_notch(meets):
    notched = polygon("-2,-2,0 2,-2,0 2,2,0 0,-1,0 -2,2,0")
    assert meets(notched, 0, -1.5) is not None
    assert meets(notched, 1.5, 0.5) is not None
    assert meets(notched, 0, 0.5) is None
    assert meets(notched, 3, 0.5) is None


@pytest.mark.parametrize("hole", [HOLE, " ".join(reversed(HOLE.split()))])
@pytest.mark.parametrize("first", [True, False])
def test_no_ring_has_a_role(meets, hole, first):
    rings = f"{SQUARE}; {hole}" if first else f"{hole} ; {SQUARE}"
    assert meets(polygon(rings), 0.25, 0.5) is None
    assert meets(polygon(rings), 1.5, 0.5) is not None
    island = rings + "; -0.5,-0.5,0 0.5,-0.5,0 0.5,0.5,0 -0.5,0.5,0"
    assert meets(polygon(island), 0.25, 0.125) is not None


def test_pentagram_is_hollow_in_the_middle(meets):
    assert meets(polygon(PENTAGRAM), 0.125, 0) is None
    assert meets(polygon(PENTAGRAM), 0.125, 3) is not None


def test_ray_level_with_a_vertex_counts_it_once(meets):
    # At y = 0 the line to the right passes exactly through the corner (2, 0): the half-open rule.
    diamond = polygon("0,-2,0 2,0,0 0,2,0 -2,0,0")
    assert meets(diamond, 0.5, 0) is not None
    assert meets(diamond, -3, 0) is None
    assert meets(diamond, -3, 2) is None


def test_plane_passes_through_the_mean_of_the_first_ring(meets):
    # Lifted within the tolerance: the first ring's mean decides, the plane is level by the given normal.
    up = '<vector name="normal" value="0,0,1"/>'
    warped = polygon("-2,-2,0.00001525878906 2,-2,0 2,2,0 -2,2,0", up)
    t, *n = meets(warped, 1, 1)
    assert n == [0, 0, 1]
    assert t == 8 - 2.0**-16 / 4
    # A second ring does not move it.
    t, *_ = meets(polygon("-2,-2,0 2,-2,0 2,2,0 -2,2,0; -1,-1,0.00001525878906 1,-1,0 0,1,0", up), 1.5, 1.5)
    assert t == 8


@pytest.mark.parametrize(
    ("vertices", "extra", "to_world", "z"),
    [
        (SQUARE, "", "", 1),
        (" ".join(reversed(SQUARE.split())), "", "", -1),
        (SQUARE, '<boolean name="flip_normals" value="true"/>', "", -1),
        (SQUARE, '<vector name="normal" value="0,0,-3"/>', "", -1),
        (SQUARE, "", '<scale x="-1"/>', -1),  # the winding is mirrored
        (SQUARE, '<vector name="normal" value="0,0,2"/>', '<scale x="-1"/>', 1),  # M^-T n is not
        (SQUARE, '<vector name="normal" value="0,0,2"/>', '<scale z="-1"/>', -1),
        # A bow-tie has no Newell vector: the first three vertices that are not collinear.
        ("-2,-2,0 2,2,0 2,-2,0 -2,2,0", "", "", -1),
        ("-2,-2,0 0,0,0 2,2,0 2,-2,0 -2,2,0", "", "", -1),
    ],
)
def test_normal_is_given_or_newells_or_of_the_first_corner(meets, vertices, extra, to_world, z):
    body = polygon(vertices, extra, to_world)
    assert meets(body, -1.5, 0.25)[1:] == (0, 0, z)


def test_polygon_behind_the_eye_or_beyond_the_light_is_not_met(eye):
    floor = polygon(SQUARE, '<bsdf type="blinnphong"/>')
    roof = polygon(SQUARE, '<bsdf type="blinnphong"/>', '<translate z="3"/>').replace('id="it"', 'id="roof"')
    lamp = """<emitter type="point"><point name="position" value="0.5,0.25,2"/>
      <float name="intensity" value="4"/></emitter>"""
    assert eye(floor + roof + lamp).sees((0.5, 0.25, 1), (0, 0, -1), 0.5)
    assert eye(floor + roof + lamp).sees((0.5, 0.25, 5), (0, 0, -1), 0)


def test_projection_follows_the_largest_component_of_the_normal(meets, load_scene):
    # A square in the plane x = 1, seen along x; projected along z or y it would have no area.
    body = polygon("1,-2,-2 1,2,-2 1,2,2 1,-2,2")
    tracer = Tracer(load_scene(body))
    primitive, t = tracer.first_hit((5.0, 0.5, 1.5), (-1.0, 0.0, 0.0), 0.0, math.inf, None)
    assert (primitive.index, t) == (0, 4)
    assert tracer.first_hit((5.0, 0.5, 2.5), (-1.0, 0.0, 0.0), 0.0, math.inf, None)[0] is None


def test_vertices_are_transformed_before_anything_else(meets):
    turned = polygon(SQUARE, to_world='<matrix value="0 -1 0 0  1 0 0 0  0 0 1 0  0 0 0 1"/><translate z="3"/>')
    assert meets(turned, 1, 1.5)[0] == 5


@pytest.mark.parametrize(
    ("vertices", "extra", "message"),
    [
        ("0,0,0 1,0,0", "", "a ring of `vertices` has 2 vertices; allowed: from 3"),
        ("0,0,0 1,0,0 0,1,0;", "", "a ring of `vertices` has 0 vertices"),
        ("0,0,0 1,0 0,1,0", "", "holds `1,0`; allowed: x,y,z"),
        ("0,0,0 1,x,0 0,1,0", "", "`x` is not a finite decimal number"),
        ("0,0,0 1,1,1 3,3,3", "", "all vertices of the first ring are collinear"),
        ("0,0,0 1,0,0 1,1,0.01 0,1,0", "", "off the polygon's plane; allowed:"),
        (SQUARE, '<vector name="normal" value="0,1,0"/>', "off the polygon's plane"),
        (SQUARE, '<vector name="normal" value="0,0,0"/>', "`normal` is zero"),
    ],
)
def test_polygons_without_a_plane_are_refused(load_scene, vertices, extra, message):
    with pytest.raises(SceneError) as error:
        load_scene(polygon(vertices, extra))
    assert message in str(error.value)
    assert "`it`" in str(error.value) or "finite" in message


def test_polygon_far_from_the_origin_may_be_as_flat_as_single_precision(load_scene):
    # At 2^20 one unit in the last place is 1/8: two of them are allowed.
    far = "1048576,0,0 1048577,0,0 1048577,1,{} 1048576,1,0"
    load_scene(polygon(far.format("0.125")))
    with pytest.raises(SceneError, match="off the polygon's plane"):
        load_scene(polygon(far.format("2")))
