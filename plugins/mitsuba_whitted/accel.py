"""What Embree traverses: shapes of the scene, and stand-ins for those that it would not traverse well."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.meshes import triangles_of
from mitsuba_whitted.ray import Found, Ray
from mitsuba_whitted.scene_graph import SceneGraph, searched_by_optix
from mitsuba_whitted.tables import fetch, index_column
from mitsuba_whitted.transforms import Matrix, matrix_of, moved


class Accel:
    """An acceleration structure of our own over Mitsuba's shapes.

    It has Embree's robust flag, without which rays slip through the edges of meshes, and is made anew when a
    shape changed, through whichever scene. Only its answer which primitive comes first is used, so that a
    stand-in may be rounded. What instances place is put into world space: Mitsuba sets no such flag inside a
    group, and its spheres go wrong where an instance makes the ray's direction longer than 1. All triangles of all
    instances become one mesh, other shapes are placed one by one. Ellipsoids, which Mitsuba has not, stay
    instances, but of spheres enlarged so far that the direction gets no longer.
    """

    def __init__(
        self, graph: SceneGraph, shapes: list[mi.Shape], left_out: Container[int], centre: NDArray[np.float64]
    ) -> None:
        row_of = {shape: row for row, shape in enumerate(shapes)}
        plain = [shape for shape in graph.plain if row_of[shape] not in left_out]
        contents: list[Any] = [] if centre.any() else plain
        placed = [[row_of[shape], 0] for shape in contents]
        triangles: list[tuple[list[int], NDArray[Any], NDArray[Any]]] = []
        ellipsoids: list[tuple[list[int], Any, Any]] = []
        for number, to_world, members in _placements(graph, plain, centre):
            for member in members:
                who = [row_of[member], number]
                if member.is_mesh():
                    triangles.append((who, *_world_triangles(graph, member, to_world)))
                elif member.class_name() == "Sphere" and not _keeps_shape(to_world):
                    ellipsoids.append((who, *_ellipsoid(graph, member, to_world)))
                else:
                    contents.append(_moved(graph, member, to_world))
                    placed.append(who)
        self._as_given = all(row == [place, 0] for place, row in enumerate(placed)) and not (triangles or ellipsoids)
        self._soup: Any = None
        if triangles:
            self._soup_number = len(contents)
            contents.append(_soup(triangles))
            placed.append([0, 0])  # each of its triangles has a row of its own
            self._soup = index_column(np.concatenate([_numbered(who, faces) for who, _, faces in triangles]))
        spheres = [shape.class_name() == "Sphere" for shape in contents]
        self._round = bool(ellipsoids) or any(spheres)
        # Embree follows rays that it is told are alike as one beam. Among triangles that takes half the time, among
        # spheres alone a tenth more (`whitted benchmark speed`, the row `coherence`).
        self._coherent = bool(ellipsoids) or not all(spheres)
        contents += [it for *_, it in ellipsoids]
        self._placed = index_column([*placed, *(who for who, *_ in ellipsoids)] or [[0, 0]])
        self._scene = _scene([*(group for _, group, _ in ellipsoids), *contents])
        # Embree tells the number of what was met, but for what an instance places; OptiX tells the object alone.
        self._number_of = _NumberOf(self._scene) if ellipsoids or searched_by_optix() else None
        self._ellipsoids = bool(ellipsoids)

    def first(self, ray: Ray, found: Found, active: Any, inside: bool) -> Found:
        """Ask Embree which primitive the ray meets first, and go on with it if it is nearer than `found`.

        Where a ray may begin makes no difference to it.
        """
        shifted, lead = ray._replace(end=found.t).from_shifted()
        pi = self._scene.ray_intersect_preliminary(shifted, coherent=self._coherent, active=active)
        nearer = active & pi.is_valid()
        return found.or_nearer(nearer, pi.t + lead, *self._met(pi, nearer))

    def blocked(self, ray: Ray, active: Any, inside: bool) -> Any:
        """Ask Embree whether there is anything on the ray.

        Mitsuba's ``ray_test`` solves the plain quadratic for spheres and misses up to 40 % of small far ones;
        its ``ray_intersect_preliminary`` moves the origin close first.
        """
        shifted, _ = ray.from_shifted()
        active = active & (shifted.maxt > 0)  # of a ray that ends before it begins ray_test says that it is blocked
        if self._round:
            return self._scene.ray_intersect_preliminary(shifted, coherent=self._coherent, active=active).is_valid()
        return self._scene.ray_test(shifted, coherent=self._coherent, active=active)

    def _met(self, pi: mi.PreliminaryIntersection3f, active: Any) -> tuple[Any, Any, Any]:
        """Row of the shape that the answer stands for, number of its instance, number of its triangle."""
        number = self._number(pi, active)
        if self._as_given:
            return number, mi.UInt32(0), pi.prim_index
        who = fetch(mi.Vector2u, self._placed, number, active)
        face = pi.prim_index
        if self._soup is not None:
            in_soup = active & (number == self._soup_number)
            triangle = fetch(mi.Vector3u, self._soup, pi.prim_index, in_soup)
            who = dr.select(in_soup, triangle.xy, who)
            face = dr.select(in_soup, triangle.z, face)
        return who.x, who.y, face

    def _number(self, pi: mi.PreliminaryIntersection3f, active: Any) -> Any:
        """Tell the number of what was met, in the order of the scene's shapes."""
        if self._number_of is None:
            return pi.shape_index
        if not self._ellipsoids:
            return self._number_of(pi.shape, active)
        placed = active & (pi.instance != None)  # noqa: E711  # a lane each
        return self._number_of(dr.select(placed, pi.instance, pi.shape), active)


def _placements(
    graph: SceneGraph, plain: list[Any], centre: NDArray[np.float64]
) -> Iterator[tuple[int, Matrix, list[Any]]]:
    """List what is not traversed as it is: number of the placement, its transform, and the shapes.

    Instances count from 1. Where the scene is moved to its centre, its own shapes are a placement like them.
    """
    if centre.any():
        yield 0, moved(np.eye(4), -centre), plain
    for number, instance in enumerate(graph.instances, 1):
        to_world = matrix_of(graph.value(instance, "to_world"), f"instance `{instance.id()}`")
        yield number, moved(to_world, -centre), graph.members[graph.group_of[instance]]


def _scene(contents: list[Any]) -> mi.Scene:
    """Make a scene of these objects, in this order: it is Embree's numbering of their geometry."""
    names = [each.id() for each in contents]
    numbered = {str(i): each for i, each in enumerate(contents)}
    scene = mi.load_dict({"type": "scene", "embree_use_robust_intersections": True, **numbered}, optimize=False)
    for each, name in zip(contents, names, strict=True):
        each.set_id(name)  # load_dict has named them after its keys
    return scene


def _world_triangles(graph: SceneGraph, mesh: mi.Shape, to_world: Matrix) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices of a mesh of a group where an instance puts them, and its faces."""
    if mesh.class_name() == "Rectangle":
        to_world = to_world @ matrix_of(graph.value(mesh, "to_world"), f"shape `{mesh.id()}`")
        vertices = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], float)
        faces = np.array([[0, 1, 2], [2, 1, 3]], np.uint32)
    else:
        vertices, faces = triangles_of(graph, mesh)
    return vertices @ to_world[:3, :3].T + to_world[:3, 3], faces


def _numbered(who: list[int], faces: NDArray[Any]) -> NDArray[np.uint32]:
    """Rows of shape, instance and number of each face."""
    count = len(faces)
    return np.column_stack([np.full(count, who[0]), np.full(count, who[1]), np.arange(count)]).astype(np.uint32)


def _soup(triangles: list[tuple[list[int], NDArray[Any], NDArray[Any]]]) -> mi.Mesh:
    """Make one mesh of all triangles."""
    starts = np.cumsum([0, *(len(vertices) for _, vertices, _ in triangles)])
    vertices = np.concatenate([vertices for _, vertices, _ in triangles])
    faces = np.concatenate([faces + start for (_, _, faces), start in zip(triangles, starts, strict=False)])
    mesh = mi.Mesh("instances", len(vertices), len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return mesh


def _keeps_shape(to_world: Matrix) -> bool:
    """Whether a sphere stays one, as near as float32 can tell: u = 2^-24 a number, three numbers a column."""
    gram = to_world[:3, :3].T @ to_world[:3, :3]
    scale = gram[0, 0]
    return bool(np.all(np.abs(gram - scale * np.eye(3)) <= 6 * 2.0**-24 * scale))


def _moved(graph: SceneGraph, shape: mi.Shape, to_world: Matrix) -> Any:
    """Make a sphere, disk or cylinder of a group where an instance puts it."""
    inner = matrix_of(graph.value(shape, "to_world"), f"shape `{shape.id()}`")
    return _shape(shape.class_name().lower(), to_world @ inner)


def _ellipsoid(graph: SceneGraph, sphere: mi.Shape, to_world: Matrix) -> tuple[Any, Any]:
    """Make a group of one sphere, and an instance of it.

    A ray's direction in the group is at most 1 / sigma long, with sigma the smallest stretch of the instance. A
    power of two keeps every number as it was.
    """
    sigma = float(np.linalg.svd(to_world[:3, :3], compute_uv=False)[-1])
    enlarge = np.diag([2.0 ** min(0, math.floor(math.log2(sigma)))] * 3 + [1.0])
    inner = matrix_of(graph.value(sphere, "to_world"), f"shape `{sphere.id()}`")
    group = mi.load_dict({"type": "shapegroup", "sphere": _shape("sphere", enlarge @ inner)})
    placed = to_world @ np.linalg.inv(enlarge)
    return group, mi.load_dict({"type": "instance", "to_world": _transform(placed), "group": group})


def _transform(matrix: Matrix) -> Any:
    return mi.ScalarTransform4f(matrix.tolist())


def _shape(kind: str, to_world: Matrix) -> Any:
    level = mi.logger().log_level()
    mi.set_log_level(mi.LogLevel.Error)  # of shear it warns; but it traverses sheared disks and cylinders rightly
    try:
        return mi.load_dict({"type": kind, "to_world": _transform(to_world)})
    finally:
        mi.set_log_level(level)


class _NumberOf:
    """From a shape in a kernel to its number in a scene."""

    def __init__(self, scene: mi.Scene) -> None:
        if not dr.is_jit_v(mi.Float):
            self._numbers: Any = {shape: number for number, shape in enumerate(scene.shapes())}
            return
        registry = np.array(dr.reinterpret_array(mi.UInt32, scene.shapes_dr()))
        numbers = np.zeros((max(registry, default=0) + 1, 1), np.uint32)
        numbers[registry, 0] = np.arange(len(registry))
        self._numbers = index_column(numbers)

    def __call__(self, shape: Any, active: Any) -> Any:
        if not dr.is_jit_v(mi.Float):
            return self._numbers.get(shape, 0)
        return fetch(mi.UInt32, self._numbers, dr.reinterpret_array(mi.UInt32, shape), active)
