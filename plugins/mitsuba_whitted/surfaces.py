"""The surfaces of a scene: which one a ray meets, where, and what stands there."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted import precise
from mitsuba_whitted.accel import Accel
from mitsuba_whitted.centre import centre_of
from mitsuba_whitted.few import Few, few_of
from mitsuba_whitted.instances import Instances
from mitsuba_whitted.meshes import Meshes
from mitsuba_whitted.ray import Found, Ray
from mitsuba_whitted.scene_graph import SceneGraph, searched_by_optix
from mitsuba_whitted.shapes import PLANES, Kind, row_of
from mitsuba_whitted.tables import column, double_column, fetch, opaque

FEW_PLANES = 2
"""Normals of so many rectangles and disks are constants of the kernel, among which a lane selects, however many other
shapes there are: a floor, or a floor and a wall."""


class Hit(NamedTuple):
    """A hit point and what stands there, in double. Normals have any length, and are on the shape's own front side."""

    shape: Any
    """Row of the shape in the tables."""
    p: Any
    n: Any
    """Shading normal."""
    n_g: Any
    """Geometric normal, on the side of `n`."""
    uv: Any
    reach: Any
    """Largest absolute coordinates of the surface: see `precise.ray_offset`."""


class Surfaces:
    """All shapes of a scene: which one a ray meets is Embree's answer, where it meets it is computed here.

    Members of groups keep their own coordinates; all others, and every ray, are relative to `centre`.
    """

    def __init__(self, graph: SceneGraph) -> None:
        shapes = graph.all_shapes
        self.centre = centre_of(graph)
        self.origin = opaque(mi.Vector3f(*self.centre.tolist()))
        origins = [self.centre] * len(graph.plain) + [np.zeros(3)] * (len(shapes) - len(graph.plain))
        rows = [row_of(graph, shape, origin) for shape, origin in zip(shapes, origins, strict=True)]
        self.kinds = {row.kind for row in rows}
        self.textured = self.kinds
        """Kinds of which some shape wears a texture: the others need no coordinates."""
        self.rows = rows
        few = few_of(rows, bool(graph.instances))
        if searched_by_optix():
            for number, row in enumerate(rows):
                if row.kind == Kind.RECTANGLE and number not in few:  # two triangles: see `meshes`
                    rows[number] = row._replace(reach=np.full(3, row.reach.max()))
        self.few = Few({number: rows[number] for number in few})
        self.searched = len(few) < len(rows)
        """Whether there are more than the few."""
        self._searches: list[Few | Accel] = [self.few] if few else []
        if self.searched:
            self._searches.append(Accel(graph, shapes, few, self.centre))
        self._a_r = double_column([*row.a, row.r] for row in rows)
        self._b_sign = double_column([*row.b, row.sign] for row in rows)
        self._flipped = any(row.sign < 0 for row in rows if row.kind != Kind.MESH)
        planes = {number: row for number, row in enumerate(rows) if row.kind in PLANES}
        self._few_planes: dict[int, tuple[Any, Any, Any]] = {}
        """Shading normal, geometric normal and reach of the planes if these are so few that no table is needed."""
        if len(planes) <= FEW_PLANES:
            for number, row in planes.items():
                normals = (opaque(mi.Normal3d(*normal.tolist())) for normal in (row.b, row.plane))
                self._few_planes[number] = *normals, opaque(mi.Vector3f(*row.reach.tolist()))
        else:
            self._planes = double_column(row.plane for row in rows)
        self._balls_beside = len(self._few_planes) == len(planes) and self.kinds <= {*PLANES, Kind.SPHERE}
        """Whether all else are spheres, whose kind and reach need no table either."""
        self._reach_kind = column([*row.reach, row.kind] for row in rows)
        self._to_local = double_column(axis for row in rows for axis in row.to_local)

        self.meshes = Meshes(graph, shapes, origins)
        self.instances = Instances(graph, self.centre) if graph.instances else None

        corners = _box(graph) - self.centre
        self._corners = tuple(opaque(mi.Point3f(*corner)) for corner in corners.tolist())
        # A plane through the origin along the axes is met without rounding, and any shift but zero is enough.
        self.least_reach = opaque(mi.Float(1e-9 * float(np.ptp(corners, axis=0).max())))

    def approached(self, ray: Ray) -> Ray:
        """Let the search for what a camera ray meets begin where the ray enters the bounding box.

        Mitsuba solves the plain quadratic for cylinders, and finds small far ones badly. The hit is computed from
        the true origin all the same.
        """
        if Kind.CYLINDER not in self.kinds:
            return ray
        o, d = ray.rounded()[:2]
        low, high = ((corner - o) * dr.rcp(d) for corner in self._corners)
        enters = dr.max(dr.minimum(low, high)) * (1 - 8 * precise.UNIT_ROUNDOFF)  # two roundings, with room
        begin = dr.dot(ray.shift, d)
        lead = dr.select(enters > begin, enters - begin, 0)  # a ray inside a face of the box: NaN, no lead
        return ray._replace(shift=mi.Vector3f(dr.fma(lead, d, ray.shift)))

    def first_hit(self, ray: Ray, active: Any, inside: bool = True) -> Found:
        """Find the primitive that the ray meets first; `inside` says whether it may begin inside a ball."""
        ray = ray.rounded()
        found = Found.nothing(ray)
        for search in self._searches:
            found = search.first(ray, found, active, inside)
        return found

    def blocked(self, ray: Ray, active: Any, inside: bool = True) -> Any:
        """Whether anything lies on the ray."""
        ray = ray.rounded()
        blocked = mi.Bool(False)
        for search in self._searches:
            blocked |= search.blocked(ray, active & (blocked ^ True), inside)
        return blocked

    def hit(self, found: Found, ray: Ray, with_uv: bool) -> Hit:
        """Compute the hit on the primitive that was found."""
        valid, shape = found.valid, found.shape
        o, d, t = ray.o, ray.d, found.t
        if self.instances:
            placement = self.instances.placement(found.instance, valid)
            o, d, t = placement.to_local(o, d, t)

        sign = mi.Float64(1)
        a_r = fetch(mi.Vector4d, self._a_r, shape, valid)
        a, r = mi.Point3d(a_r.xyz), a_r.w
        kind, reach = self._kind_and_reach(shape, a, r, valid)
        p, n, n_g, uv = mi.Point3d(0), mi.Normal3d(0), mi.Normal3d(0), mi.Point2d(0)

        if self.kinds - {Kind.MESH}:
            b_sign = fetch(mi.Vector4d, self._b_sign, shape, valid)
            b = mi.Normal3d(b_sign.xyz)
            sign = b_sign.w if self._flipped else sign
            w, off = o - a, mi.Vector3d(0)
            if self.kinds & PLANES:
                n, n_g = self._plane_normals(shape, b, valid)
                off = mi.Vector3d(precise.plane_point(w, d, n_g))
            if Kind.SPHERE in self.kinds:
                outward = mi.Normal3d(precise.sphere_normal(w, d, r, t))
                off = dr.select(kind == float(Kind.SPHERE), mi.Vector3d(outward), off)
                n = dr.select(kind == float(Kind.SPHERE), outward, n)
                n_g = dr.select(kind == float(Kind.SPHERE), outward, n_g)
            if Kind.CYLINDER in self.kinds:
                on_cylinder, outward = precise.cylinder_point(w, d, b, r, t)
                off = dr.select(kind == float(Kind.CYLINDER), mi.Vector3d(on_cylinder), off)
                n = dr.select(kind == float(Kind.CYLINDER), mi.Normal3d(outward), n)
                n_g = dr.select(kind == float(Kind.CYLINDER), mi.Normal3d(outward), n_g)
            p = mi.Point3d(a + off)
            if with_uv and self.textured - {Kind.MESH}:
                uv = self._texture_coordinates(kind, off, shape, valid)

        if Kind.MESH in self.kinds:
            here = valid & (kind == float(Kind.MESH))
            on_mesh = self.meshes.hit(found.face, o, d, shape, with_uv and Kind.MESH in self.textured, here)
            p = dr.select(here, on_mesh.p, p)
            n = dr.select(here, on_mesh.n, n)
            n_g = dr.select(here, on_mesh.n_g, n_g)
            uv = dr.select(here, on_mesh.uv, uv)
            sign = dr.select(here, on_mesh.sign, sign)
            # Where an instance turns the shape, coordinates along a face come to count across it.
            own_reach = dr.maximum(on_mesh.reach, reach) if self.instances else on_mesh.reach
            reach = dr.select(here, own_reach, reach)

        if self._flipped or self.meshes.flipped:
            n, n_g = n * sign, n_g * sign
        if self.instances:
            p, n, n_g, reach = placement.to_world(p, n, n_g, reach)
        if self.meshes.smooth:
            n_g = dr.select(dr.dot(n_g, n) < 0, -n_g, n_g)
        return Hit(shape, p, n, n_g, uv, reach)

    def _kind_and_reach(self, shape: Any, a: Any, r: Any, active: Any) -> tuple[Any, Any]:
        """Kind of a shape as a number, and its reach: by a table, or by the numbers of the few planes beside balls."""
        if not self._balls_beside:
            reach_kind = fetch(mi.Vector4f, self._reach_kind, shape, active)
            kind = reach_kind.w if len(self.kinds) > 1 else mi.Float(float(max(self.kinds)))
            return kind, mi.Vector3f(reach_kind.xyz)
        kind, reach = mi.Float(float(Kind.SPHERE)), dr.abs(mi.Vector3f(a)) + mi.Float(r)
        for number, (_, _, of_plane) in self._few_planes.items():
            kind = dr.select(shape == number, float(self.rows[number].kind), kind)
            reach = dr.select(shape == number, of_plane, reach)
        return kind, reach

    def _plane_normals(self, shape: Any, b: Any, active: Any) -> tuple[Any, Any]:
        """Shading and geometric normal of a rectangle or disk; anything of another shape."""
        if not self._few_planes:
            return b, fetch(mi.Normal3d, self._planes, shape, active)
        (_, (n, n_g, _)), *others = self._few_planes.items()
        for number, (other, other_g, _) in others:
            n, n_g = dr.select(shape == number, other, n), dr.select(shape == number, other_g, n_g)
        return n, n_g

    def _texture_coordinates(self, kind: Any, off_origin: Any, shape: Any, active: Any) -> Any:
        """Mitsuba's (u, v) of its analytic shapes, from a vector off the image of their local origin."""
        x, y, z = (dr.dot(fetch(mi.Vector3d, self._to_local, 3 * shape + i, active), off_origin) for i in range(3))
        uv = mi.Point2d(dr.fma(x, 0.5, 0.5), dr.fma(y, 0.5, 0.5))  # rectangle
        if self.textured - {Kind.RECTANGLE, Kind.MESH}:
            turn = dr.atan2(y, x) * (0.5 / dr.pi)
            turn = dr.select(turn < 0, turn + 1, turn)
            radius = dr.sqrt(x * x + y * y)
            if Kind.DISK in self.textured:
                uv = dr.select(kind == float(Kind.DISK), mi.Point2d(radius, turn), uv)
            if Kind.CYLINDER in self.textured:
                uv = dr.select(kind == float(Kind.CYLINDER), mi.Point2d(turn, z), uv)
            if Kind.SPHERE in self.textured:
                polar = dr.atan2(radius, z) * (1 / dr.pi)
                uv = dr.select(kind == float(Kind.SPHERE), mi.Point2d(turn, polar), uv)
        return uv


def _box(graph: SceneGraph) -> NDArray[np.float64]:
    """Lower and upper corner of the box around all shapes, (2, 3)."""
    boxes = [box for box in (shape.bbox() for shape in graph.shapes) if box.valid()]
    if not boxes:
        return np.zeros((2, 3))
    return np.array([np.min([box.min for box in boxes], axis=0), np.max([box.max for box in boxes], axis=0)], float)
