"""The `polygon` shape: its triangulation against exact rational arithmetic, its plane, its refusals."""

import itertools
import math
import re
import subprocess
import sys
from fractions import Fraction

import mitsuba as mi
import numpy as np
import pytest

SQUARE = "0,0,0 1,0,0 1,1,0 0,1,0"
BOW_TIE = "0,0,0 1,1,0 1,0,0 0,1,0"


def text(rings):
    return "; ".join(" ".join(f"{x!r},{y!r},{z!r}" for x, y, z in np.array(ring).tolist()) for ring in rings)


def polygon(vertices, **parameters):
    return mi.load_dict({"type": "polygon", "id": "it", "vertices": vertices, **parameters})


def mesh(shape):
    parameters = mi.traverse(shape)
    return (
        np.array(parameters["vertex_positions"]).reshape(-1, 3),
        np.array(parameters["faces"]).reshape(-1, 3),
        np.array(parameters["vertex_normals"]).reshape(-1, 3),
    )


# --- random polygons in the plane z = 0, all coordinates exact in float32 ---


def circle(count, radius, centre=(0.0, 0.0)):
    angles = 2 * math.pi * np.arange(count) / count
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.reshape(radius, (-1, 1)) + centre


def concave(rng):
    return [circle(12, rng.uniform(0.2, 1, 12))]


def self_crossing(rng):
    return [rng.uniform(-1, 1, (rng.integers(4, 12), 2))]


def holes(rng):
    ring = circle(9, rng.uniform(0.8, 1, 9))
    return [ring, *(circle(5, rng.uniform(0.05, 0.2, 5), c) for c in ((-0.3, 0.0), (0.3, 0.3), (0.2, -0.4)))]


def crossing_rings(rng):
    return [circle(6, rng.uniform(0.5, 1, 6), rng.uniform(-0.5, 0.5, 2)) for _ in range(3)]


def stars(rng):
    count = int(rng.choice([5, 7, 9]))
    return [circle(count, rng.uniform(0.9, 1))[np.arange(count) * (count // 2) % count]]


def on_a_grid(rng):
    """Vertices on few grid points, so that edges overlap, touch, repeat and cross in vertices."""
    return [rng.integers(-2, 3, (rng.integers(4, 10), 2)) for _ in range(rng.integers(1, 4))]


def with_redundant_vertices(rng):
    """Points in the middle of edges (exactly: the mean of two small multiples of 1/8), some of them twice."""
    ring = np.round(circle(7, rng.uniform(0.3, 1, 7)) * 64) / 64
    middles = (ring + np.roll(ring, -1, axis=0)) / 2
    return [np.repeat(np.stack([ring, middles], axis=1).reshape(-1, 2), rng.integers(1, 3, 14), axis=0)]


def touching_rings(rng):
    outer, inner = np.array([[-2, -2], [2, -2], [2, 2], [-2, 2]]), np.array([[-2, 0], [0, -1], [0, 1]])
    return [outer, inner, np.array([[0, -1], [2, -1], [2, 1], [0, 1]]), rng.integers(-2, 3, (3, 2))]


KINDS = [
    concave,
    self_crossing,
    holes,
    crossing_rings,
    stars,
    on_a_grid,
    with_redundant_vertices,
    touching_rings,
]
PER_KIND = 26  # 8 kinds: 208 polygons


def polygons(kind):
    """Rings of `PER_KIND` polygons that have a normal, and the shape that the plugin makes of each."""
    rng = np.random.default_rng(KINDS.index(kind))
    made = 0
    while made < PER_KIND:
        rings = [np.float32(ring).astype(float) for ring in kind(rng)]
        solid = [np.column_stack([ring, np.zeros(len(ring))]) for ring in rings]
        yield rings, polygon(text(solid), normal=[0, 0, 1])
        made += 1


def edges(rings):
    return [(tuple(a), tuple(b)) for ring in rings for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)]


def exact(point):
    return tuple(Fraction(float(x)) for x in point[:2])


def cross(o, a, b):
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def is_odd(point, outline):
    """Count the edges to the right of the point in rational numbers: the textbook's test."""
    x, y = exact(point)
    odd = False
    for a, b in outline:
        (x0, y0), (x1, y1) = exact(a), exact(b)
        if (y0 > y) != (y1 > y):
            odd ^= x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    return odd


def odd_area(outline):
    """Sum the trapezoids between edges and two neighbouring heights at which edges end or cross, exactly."""
    segments = [(exact(a), exact(b)) for a, b in outline]
    segments = [(min(s, key=lambda p: p[1]), max(s, key=lambda p: p[1])) for s in segments if s[0][1] != s[1][1]]
    heights = {end[1] for s in segments for end in s}
    for i, (a, b) in enumerate(segments):
        for c, d in segments[:i]:
            denominator = (b[0] - a[0]) * (d[1] - c[1]) - (b[1] - a[1]) * (d[0] - c[0])
            if denominator:
                t = ((c[0] - a[0]) * (d[1] - c[1]) - (c[1] - a[1]) * (d[0] - c[0])) / denominator
                heights.add(a[1] + t * (b[1] - a[1]))
    heights = sorted(heights)
    area = Fraction(0)
    for low, high in itertools.pairwise(heights):
        middle = (low + high) / 2
        at_middle = sorted(
            a[0] + (middle - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) for a, b in segments if a[1] < middle < b[1]
        )
        area += (high - low) * sum(right - left for left, right in zip(at_middle[::2], at_middle[1::2], strict=True))
    return area


def moved(rings, positions):
    """Bound by how much rounding has moved a vertex of the mesh.

    By nothing but where rings cross, and there by half a unit in the last place in each coordinate.
    """
    if len(positions) == 1 + sum(map(len, rings)):
        return 0.0
    return math.sqrt(0.5) * float(np.spacing(np.float32(np.abs(np.concatenate(rings)).max())))


@pytest.mark.parametrize("kind", KINDS)
def test_points_lie_in_one_triangle_where_the_crossings_are_odd_and_in_none_elsewhere(kind, llvm_ad_rgb):
    rng = np.random.default_rng(1)
    for rings, shape in polygons(kind):
        positions, faces, _ = mesh(shape)
        outline = edges(rings)
        corners = [[exact(positions[v]) for v in face] for face in faces]
        slack = moved(rings, positions)
        for point in np.float32(rng.uniform(-2, 2, (40, 2))):
            if slack and min(distance(point, a, b) for a, b in outline) <= 2 * slack:
                continue
            p = exact(point)
            around = sum(all(cross(t[i - 1], t[i], p) > 0 for i in range(3)) for t in corners)
            assert around == is_odd(point, outline), (rings, point)


def distance(point, a, b):
    a, b, p = np.array(a), np.array(b), np.array(point, float)
    length2 = (b - a) @ (b - a)
    t = np.clip((p - a) @ (b - a) / length2, 0, 1) if length2 else 0.0
    return np.linalg.norm(p - (a + t * (b - a)))


@pytest.mark.parametrize("kind", KINDS)
def test_the_area_is_that_of_the_odd_even_rule(kind, llvm_ad_rgb):
    for rings, shape in polygons(kind):
        positions, faces, _ = mesh(shape)
        outline = edges(rings)
        doubles = [cross(*(exact(positions[v]) for v in face)) for face in faces]
        # A boundary of length L, moved by at most s, sweeps at most L s, and pi s^2 about each vertex.
        slack = moved(rings, positions)
        length = sum(math.dist(a, b) for a, b in outline)
        limit = length * slack + len(positions) * math.pi * slack**2
        assert abs(sum(doubles) / 2 - odd_area(outline)) <= limit, rings
        assert all(double >= -2 * limit for double in doubles), rings  # counter-clockwise, as `normal` wants


@pytest.mark.parametrize("kind", KINDS)
def test_no_vertex_lies_within_an_edge_of_a_triangle(kind, llvm_ad_rgb):
    for rings, shape in polygons(kind):
        positions, faces, _ = mesh(shape)
        slack = 2 * moved(rings, positions)
        used = {tuple(positions[v][:2]) for v in np.unique(faces)}
        for face in faces:
            for a, b in zip(face, np.roll(face, -1), strict=True):
                ends = tuple(positions[a][:2]), tuple(positions[b][:2])
                others = [v for v in used - set(ends) if distance(v, *ends) <= slack]
                assert not others, (rings, ends, others)


@pytest.mark.parametrize("kind", KINDS)
def test_no_ray_slips_through_an_edge_between_two_triangles(kind, llvm_ad_rgb):
    rng = np.random.default_rng(2)
    rays = 0
    for rings, shape in polygons(kind):
        positions, faces, _ = mesh(shape)
        directed = {(a, b) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)}
        shared = np.array([(a, b) for a, b in directed if a < b and (b, a) in directed])
        if not len(shared):
            continue
        t = rng.uniform(0.1, 0.9, (len(shared), 30, 1))
        target = positions[shared[:, :1]] * (1 - t) + positions[shared[:, 1:]] * t
        target = target.reshape(-1, 3).astype(np.float32)
        origin = target + rng.uniform((-1, -1, 0.5), (1, 1, 2), target.shape).astype(np.float32)
        d = target - origin
        scene = mi.load_dict({"type": "scene", "it": shape, "embree_use_robust_intersections": True})
        ray = mi.Ray3f(mi.Point3f(origin.T), mi.Vector3f((d / np.linalg.norm(d, axis=1, keepdims=True)).T))
        hit = np.array(scene.ray_test(ray))
        assert hit.all(), (rings, target[~hit])
        rays += len(target)
    assert rays > 1000


def test_vertices_that_float32_cannot_tell_apart_are_one(llvm_ad_rgb):
    # The first edge passes 2^-22 / 33 = 7e-9 below the corner (1, 1), which is less than half a unit
    # in the last place: two crossings and the corner are one vertex. The corner is a hair above the
    # plane, where the crossings alone would not be, and a gap would open.
    shape = polygon(f".9375,.9375,0 3,{3 - 2**-22!r},0 3,-3,0; 1,1,1e-5 2,-1,0 0,-1,0", normal=[0, 0, 1])
    positions, faces, _ = mesh(shape)
    assert len({tuple(p[:2]) for p in positions[1:].tolist()}) == len(positions) - 1
    assert all(len(set(face)) == 3 for face in faces.tolist())
    near_corner = positions[np.unique(faces)]
    near_corner = near_corner[np.abs(near_corner[:, :2] - 1).max(axis=1) < 1e-3]
    assert near_corner.tolist() == [[1, 1, np.float32(1e-5)]]


# --- the plane ---


def plane(shape):
    """Read the plane as other programs do: vertex 0 and the normal."""
    positions, faces, normals = mesh(shape)
    assert (normals == normals[0]).all()
    corners = positions[faces].astype(float)
    windings = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (windings @ normals[0].astype(float) > 0).all(), "some triangle is wound against the normal"
    return positions[0].tolist(), normals[0].tolist()


def test_the_normal_is_on_the_side_from_which_the_first_ring_runs_counter_clockwise(any_variant):
    assert plane(polygon(SQUARE)) == ([0.5, 0.5, 0], [0, 0, 1])
    assert plane(polygon("0,1,0 1,1,0 1,0,0 0,0,0")) == ([0.5, 0.5, 0], [0, 0, -1])
    # from a reflex corner, where the first three vertices alone would say the opposite
    assert plane(polygon("1,1,0 0,4,0 0,0,0 4,0,0"))[1] == [0, 0, 1]


def test_where_edges_cross_in_a_tilted_plane_a_vertex_of_the_plane_is_made(any_variant):
    positions, _, _ = mesh(polygon("0,0,0 4,4,12 3,-1,1 0,2,4"))  # in z = x + 2 y
    assert positions[5].tolist() == [1, 1, 3]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_axes_may_be_exchanged_in_cyclic_order(axis, sign, llvm_ad_rgb):
    square = np.roll([[0, 0, 5], [2, 0, 5], [2, 1, 5], [0, 1, 5]], axis, axis=1)[::sign]
    expected = np.roll([0.0, 0, sign], axis).tolist()
    assert plane(polygon(text([square]))) == (np.roll([1, 0.5, 5], axis).tolist(), expected)


def test_a_bow_tie_takes_the_first_three_vertices_that_are_not_on_one_line(any_variant):
    assert plane(polygon(BOW_TIE))[1] == [0, 0, -1]
    assert plane(polygon("0,0,0 0,0,0 .5,.5,0 1,1,0 1,0,0 0,1,0"))[1] == [0, 0, -1]
    assert plane(polygon("1,0,0 0,1,0 0,0,0 1,1,0"))[1] == [0, 0, 1]


def test_a_turned_bow_tie_does_not_take_three_vertices_that_only_rounding_lifts_off_a_line(llvm_ad_rgb):
    turn = mi.ScalarTransform4f().rotate([0.36, 0.48, 0.8], 37).scale([1, 0.7, 1])
    n = np.array(plane(polygon("0,0,0 .3,.3,0 1,1,0 1,0,0 0,1,0", to_world=turn))[1])
    expected = -np.array(turn.matrix)[:3, 2]
    # n comes from coordinates of size 1 with errors of half a unit in the last place: 2^-24 * sqrt(3) per
    # vertex, over the height 0.3 of the triangle (0,0) (.3,.3) (1,0)
    assert np.linalg.norm(n - expected) <= 4 * 2**-24 * math.sqrt(3) / 0.3


def test_a_ring_whose_newell_vector_is_short_against_its_perimeter_counts_as_a_bow_tie(llvm_ad_rgb):
    def lobes(excess):  # of two opposite triangles the second is larger: Newell's vector is (0, 0, excess)
        return f"0,0,0 1,1,0 1,0,0 0,{1 + excess!r},0"

    # 1e-6 perimeter^2 = 1e-6 (2 + 2 sqrt 2)^2 = 2.33e-5 lies between these
    assert plane(polygon(lobes(2.0**-15)))[1] == [0, 0, 1]
    assert plane(polygon(lobes(2.0**-16)))[1] == [0, 0, -1]


def test_the_parameter_normal_decides_and_need_not_be_of_unit_length(any_variant):
    assert plane(polygon(SQUARE, normal=[0, 0, -7]))[1] == [0, 0, -1]
    assert plane(polygon(BOW_TIE, normal=[0, 0, 0.1]))[1] == [0, 0, 1]


def test_without_a_normal_the_transformed_ring_decides_with_one_the_inverse_transpose(any_variant):
    mirror = mi.ScalarTransform4f().scale([-1, 1, 1])
    assert plane(polygon(SQUARE, to_world=mirror)) == ([-0.5, 0.5, 0], [0, 0, -1])
    assert plane(polygon(SQUARE, to_world=mirror, normal=[0, 0, 1])) == ([-0.5, 0.5, 0], [0, 0, 1])
    shear = mi.ScalarTransform4f([[1, 0, 0, 0], [0, 1, 0, 0], [1, 0, 1, 0], [0, 0, 0, 1]])  # z += x
    n = np.array(plane(polygon(SQUARE, to_world=shear, normal=[0, 0, 1]))[1])
    np.testing.assert_array_equal(n, np.float32([-math.sqrt(0.5), 0, math.sqrt(0.5)]))


@pytest.mark.parametrize("flip", [False, True])
def test_a_hit_has_the_polygons_normal_for_shading_and_for_geometry(any_variant, flip):
    shape = polygon("0,0,2 0,3,2 3,0,2", flip_normals=flip)  # clockwise: normal -z
    scene = mi.load_dict({"type": "scene", "it": shape})
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(0.5, 0.5, 0), mi.Vector3f(0, 0, 1)))
    for n in (si.n, si.sh_frame.n):
        np.testing.assert_array_equal(np.ravel(n), [0, 0, 1 if flip else -1])


def test_vertices_are_transformed_as_those_of_a_mesh_file_to_the_bit(llvm_ad_rgb, tmp_path):
    rng = np.random.default_rng(3)
    ring = np.float32(rng.uniform(-3, 3, (50, 3)) * [1, 1, 0]) + np.float32([0, 0, 0.1])
    file = tmp_path / "ring.obj"
    file.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in ring.tolist()) + "f 1 2 3\n" * 48)
    file.write_text(file.read_text() + "".join(f"f {i} {i + 1} {i + 2}\n" for i in range(1, 49)))
    to_world = mi.ScalarTransform4f().translate([0.1, 0.7, -3]).rotate([0.36, 0.48, 0.8], 50).scale([0.3, 2, 1])
    loaded = mi.load_dict({"type": "obj", "filename": str(file), "to_world": to_world, "face_normals": True})
    own = mesh(polygon(text([ring.tolist()]), to_world=to_world))[0][1:51]
    np.testing.assert_array_equal(own, np.array(mi.traverse(loaded)["vertex_positions"]).reshape(-1, 3))


def test_a_vertex_off_the_plane_is_borne_up_to_the_limit_and_refused_beyond(llvm_ad_rgb):
    # Four corners of a square, one lifted by e: the plane through their mean leaves each e/4 off.
    limit = 1e-5 * math.sqrt(2) + 2 * 2.0**-23
    polygon(f"0,0,0 1,0,0 1,1,0 0,1,{3.99 * limit!r}")
    with pytest.raises(RuntimeError, match=r"polygon `it`: vertex \d at .* off the plane of the polygon"):
        polygon(f"0,0,0 1,0,0 1,1,0 0,1,{4.01 * limit!r}")


# --- extremes ---


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9])
def test_polygons_of_any_size_are_hit_inside_and_missed_in_their_hole(llvm_ad_rgb, size):
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * size
    scene = mi.load_dict({"type": "scene", "it": polygon(text([2 * square, square]))})
    x = mi.Float([1.5, 0.5, 2.5]) * size
    hit = scene.ray_test(mi.Ray3f(mi.Point3f(x, 0, size), mi.Vector3f(0, 0, -1)))
    assert np.array(hit).tolist() == [True, False, False]


@pytest.mark.parametrize("width", [2.0**-10, 2.0**-20, 2.0**-21])
def test_a_thin_polygon_is_no_line_yet(llvm_ad_rgb, width):
    shape = polygon(f"0,0,0 1,0,0 1,{width!r},0 0,{width!r},0")
    assert plane(shape)[1] == [0, 0, 1]
    assert float(shape.surface_area()[0]) == width


def test_a_polygon_without_an_inside_is_never_hit(any_variant):
    for vertices in (f"{SQUARE}; {SQUARE}", "0,0,0 1,0,0 2,0,0"):
        scene = mi.load_dict({"type": "scene", "it": polygon(vertices, normal=[0, 0, 1])})
        ray = mi.Ray3f(mi.Point3f(0.5, 0.25, 1), mi.Vector3f(0, 0, -1))
        assert not np.any(scene.ray_test(ray))


# --- as a plugin ---


def snippets():
    page = type(polygon(SQUARE)).__doc__
    blocks = re.findall(r"code-tab:: (\w+)\n(?: +:name:.*\n)?\n((?:.*\S.*\n)+)", page)
    return dict(blocks)


def test_the_snippets_of_the_manual_page_load_and_make_the_same_mesh(any_variant):
    code = snippets()
    from_xml = mi.load_string(f'<scene version="3.0.0">{code["xml"]}</scene>', optimize=False).shapes()[0]
    from_dict = mi.load_dict(eval(f"{{{code['python']}}}"))
    for a, b in zip(mesh(from_xml), mesh(from_dict), strict=True):
        np.testing.assert_array_equal(a, b)
    assert float(np.ravel(from_xml.surface_area())[0]) == 16 - 2


def test_a_scene_keeps_the_python_object_with_its_bsdf_and_id(any_variant):
    scene = mi.load_string(
        f"""<scene version="3.0.0">
            <shape type="polygon" id="first"><string name="vertices" value="{SQUARE}"/>
                <bsdf type="blinnphong" id="paint"/></shape>
            <shape type="polygon" id="lamp"><string name="vertices" value="{BOW_TIE}"/>
                <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
        </scene>""",
        optimize=False,
    )
    first, lamp = scene.shapes()
    assert [type(s).__name__ for s in (first, lamp)] == ["Polygon"] * 2
    assert (first.id(), lamp.id(), first.bsdf().id(), lamp.is_emitter()) == ("first", "lamp", "paint", True)
    assert "id = 'first'" in str(scene)


def test_polygons_that_mitsuba_merges_by_their_material_stay_as_they_are(llvm_ad_rgb):
    shapes = "".join(
        f'<shape type="polygon"><string name="vertices" value="{vertices}"/><ref id="paint"/></shape>'
        for vertices in (SQUARE, BOW_TIE)
    )
    scene = mi.load_string(f'<scene version="3.0.0"><bsdf type="blinnphong" id="paint"/>{shapes}</scene>')
    (merged,) = scene.shapes()
    assert float(merged.surface_area()[0]) == 1 + 0.5


def test_texture_coordinates_are_the_object_coordinates_in_the_unit_square(any_variant):
    turn = mi.ScalarTransform4f().translate([5, 6, 7]).rotate([1, 0, 0], 90)
    shape = polygon("-1,-1,0 3,-1,0 3,1,0 -1,1,0", to_world=turn)
    uv = np.array(mi.traverse(shape)["vertex_texcoords"]).reshape(-1, 2)
    # positions of up to 9, rounded, then measured over extents of 4 and 2
    np.testing.assert_allclose(uv, [[0.5, 0.5], [0, 0], [1, 0], [1, 1], [0, 1]], rtol=0, atol=2 * 2**-20 / 2)


def test_an_edit_that_moves_every_vertex_moves_the_plane(llvm_ad_rgb):
    shape = polygon(BOW_TIE)
    parameters = mi.traverse(shape)
    positions = np.array(parameters["vertex_positions"]).reshape(-1, 3)
    parameters["vertex_positions"] = np.ravel(positions + np.float32([0, 0, 2]))
    parameters.update()
    positions, faces, normals = mesh(shape)
    assert positions[0].tolist() == [0.5, 0.5, 2]
    n = normals[np.unique(faces)]  # Mitsuba computes them anew, and not to unit length in every last bit
    assert (n[:, :2] == 0).all()
    assert (n[:, 2] < 0).all()


def test_shapely_is_imported_for_the_first_polygon_only():
    program = """if True:
        import sys, mitsuba_whitted, mitsuba as mi
        mi.set_variant("scalar_rgb")
        mi.load_dict({"type": "blinnphong"})
        assert "shapely" not in sys.modules
        mi.load_dict({"type": "polygon", "vertices": "0,0,0 1,0,0 0,1,0"})
        assert "shapely" in sys.modules
    """
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"vertices": ""}, "ring 1 has 0 vertices"),
        ({"vertices": "0,0,0 1,0,0"}, "ring 1 has 2 vertices, allowed are 3 or more"),
        ({"vertices": f"{SQUARE};"}, "ring 2 has 0 vertices"),
        ({"vertices": "0,0 1,0,0 1,1,0"}, "vertex `0,0` is not of the form x,y,z"),
        ({"vertices": "0,0,0,0 1,0,0 1,1,0"}, "vertex `0,0,0,0` is not of the form x,y,z"),
        ({"vertices": "0, 0, 0 1,0,0 1,1,0"}, "vertex `0,` is not of the form x,y,z"),
        ({"vertices": "0,0,zero 1,0,0 1,1,0"}, "vertex `0,0,zero` is not of the form x,y,z"),
        ({"vertices": "1_0,0,0 1,0,0 1,1,0"}, "vertex `1_0,0,0` is not of the form x,y,z"),
        ({"vertices": "0,0,nan 1,0,0 1,1,0"}, "vertex `0,0,nan` is 0,0,nan, allowed are finite numbers"),
        ({"vertices": "0,0,0 1e39,0,0 1,1,0"}, "vertex `1e39,0,0` is inf,0,0, allowed are finite numbers"),
        ({"vertices": "0,0,0 1,1,1 3,3,3 2,2,2"}, "all vertices of its first ring lie on one line"),
        ({"vertices": "1,1,1 1,1,1 1,1,1"}, "all vertices of its first ring lie on one line"),
        ({"vertices": "0,0,0 1,0,0 1,1,0 0,1,0.1"}, "vertex . at .,.,.* is 0.0249 off the plane"),
        ({"vertices": f"{SQUARE}; 0,0,1 1,0,1 0,1,1"}, "vertex 5 at 0,0,1 is 1 off the plane"),
        ({"normal": [0, 0, 0]}, "normal is 0,0,0, allowed is any finite vector but 0,0,0"),
        ({"normal": [0, math.nan, 1]}, "normal is 0,nan,1"),
        (
            {"normal": [1, 0, 0]},
            "vertex 1 at 0,0,0 is 0.5 off the plane of the polygon, whose normal is 1,0,0",
        ),
        ({"vertices": [1, 2, 3]}, "vertices is .*, allowed is a string"),
    ],
)
def test_wrong_input_is_refused_with_the_objects_id_and_the_value(parameters, complaint, llvm_ad_rgb):
    with pytest.raises(RuntimeError, match=f"polygon `it`: {complaint}"):
        polygon(**{"vertices": SQUARE, **parameters})


@pytest.mark.parametrize("scale", [(1, 1, 0), (1e-39, 1, 1), (math.nan, 1, 1), (math.inf, 1, 1)])
def test_a_transform_that_flattens_or_is_not_finite_is_refused(scale, llvm_ad_rgb):
    with pytest.raises(RuntimeError, match=r"polygon `it`: (to_world is singular|transformed vertex)"):
        polygon(SQUARE, to_world=mi.ScalarTransform4f().scale(scale))


def test_a_misspelt_parameter_is_refused(llvm_ad_rgb):
    with pytest.raises(RuntimeError, match="unreferenced property"):
        polygon(SQUARE, normals=[0, 0, 1])
