"""The shapes of a scene as tables, and the refined hit on the one that Embree names."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted import precise
from mitsuba_whitted.accel import Accel
from mitsuba_whitted.camera import Rays
from mitsuba_whitted.centre import centre_of
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.instances import Instances
from mitsuba_whitted.meshes import Meshes
from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.tables import column, fetch, index_column, opaque
from mitsuba_whitted.transforms import matrix_of

Vector = NDArray[np.float64]


class Kind(IntEnum):
    """How a hit on a shape is computed; the letters are those of the tables."""

    RECTANGLE = 0
    """Plane through `a` with normal `b`."""
    DISK = 1
    """The same."""
    SPHERE = 2
    """Centre `a`, radius `r`."""
    CYLINDER = 3
    """Axis through `a` along `b`, radius `r`."""
    MESH = 4
    """Triangles, each with a plane of its own."""


PLANES = {Kind.RECTANGLE, Kind.DISK}

_KINDS = {"Rectangle": Kind.RECTANGLE, "Disk": Kind.DISK, "Sphere": Kind.SPHERE, "Cylinder": Kind.CYLINDER}

_PLACED_BY = {
    Kind.SPHERE: "its to_world, with center and radius,",
    Kind.CYLINDER: "its to_world, with p0, p1 and radius,",
}
"""What Mitsuba folds into to_world."""


class Hit(NamedTuple):
    """A hit point and what stands there. Normals have unit length and are on the shape's own front side."""

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


class _Row(NamedTuple):
    """What the tables keep of one shape, in float64."""

    kind: Kind
    a: Vector
    b: Vector
    r: float
    sign: float
    """-1 where the normal of the formula points to the back."""
    reach: Vector
    to_local: Vector
    """Linear part of the inverse of to_world, (3, 3): texture coordinates come from it."""


class Surfaces:
    """All shapes of a scene: which one a ray meets is Embree's answer, where it meets it is computed here.

    Members of groups keep their own coordinates; all others, and every ray, are relative to `centre`.
    """

    def __init__(self, graph: SceneGraph) -> None:
        shapes = graph.all_shapes
        self.centre = centre_of(graph)
        self.origin = opaque(mi.Vector3f(*self.centre.tolist()))
        origins = [self.centre] * len(graph.plain) + [np.zeros(3)] * (len(shapes) - len(graph.plain))
        rows = [_row(graph, shape, origin) for shape, origin in zip(shapes, origins, strict=True)]
        self.kinds = {row.kind for row in rows}
        self.accel = Accel(graph, shapes, self.centre)
        box = self.accel.bbox()
        extent = float(max(box.extents())) if box.valid() else 0.0
        self._corners = opaque(mi.Point3f(box.min)), opaque(mi.Point3f(box.max))
        # A plane through the origin along the axes is met without rounding, and any shift but zero is enough.
        self.least_reach = opaque(mi.Float(1e-9 * extent))

        self._kind = index_column([row.kind] for row in rows)
        self._a_r = column([*row.a, row.r] for row in rows)
        self._b_sign = column([*row.b, row.sign] for row in rows)
        self._reach = column([*row.reach, 0.0] for row in rows)
        self._to_local = column(row.to_local.ravel() for row in rows)

        self.meshes = Meshes(graph, shapes, origins)
        self.instances = Instances(graph, self.centre) if graph.instances else None

    def approached(self, rays: Rays) -> Rays:
        """Begin the traversal of camera rays where they enter the bounding box.

        Mitsuba solves the plain quadratic for cylinders, and finds small far ones badly. The hit is computed from
        the true origin all the same.
        """
        if Kind.CYLINDER not in self.kinds:
            return rays
        low, high = ((corner - rays.o) * dr.rcp(rays.d) for corner in self._corners)
        enters = dr.max(dr.minimum(low, high)) * (1 - 8 * precise.UNIT_ROUNDOFF)  # two roundings, with room
        begin = dr.dot(rays.shift, rays.d)
        lead = dr.select(enters > begin, enters - begin, 0)  # a ray inside a face of the box: NaN, no lead
        return rays._replace(shift=mi.Vector3f(dr.fma(lead, rays.d, rays.shift)), end=rays.end - lead)

    def first_hit(self, ray: mi.Ray3f, active: Any) -> mi.PreliminaryIntersection3f:
        """Ask Embree which primitive the ray meets first."""
        return self.accel.first_hit(ray, active)

    def blocked(self, ray: mi.Ray3f, active: Any) -> Any:
        """Whether anything lies on the ray.

        Mitsuba's ``ray_test`` solves the plain quadratic for spheres and misses up to 40 % of small far ones;
        its ``ray_intersect_preliminary`` moves the origin close first.
        """
        if Kind.SPHERE in self.kinds:
            return self.first_hit(ray, active).is_valid()
        return self.accel.any_hit(ray, active)

    def hit(self, pi: mi.PreliminaryIntersection3f, ray: mi.Ray3f, o: Any, with_uv: bool) -> Hit:
        """Compute the hit that `pi` names from the true origin `o` of the ray.

        ``ray.o`` is where the traversal began: `o`, moved a little off its surface or to the near plane.
        """
        valid = pi.is_valid()
        d, t = ray.d, pi.t + dr.dot(ray.o - o, ray.d)
        shape, instance, face = self.accel.met(pi, valid)
        if self.instances:
            placement = self.instances.placement(instance, valid)
            o, d, t = placement.to_local(o, d, t)

        kind = fetch(mi.UInt32, self._kind, shape, valid)
        sign = mi.Float(1)
        reach = mi.Vector3f(fetch(mi.Vector4f, self._reach, shape, valid).xyz)
        p, n, n_g, uv = mi.Point3f(0), mi.Normal3f(0), mi.Normal3f(0), mi.Point2f(0)

        if self.kinds - {Kind.MESH}:
            a_r = fetch(mi.Vector4f, self._a_r, shape, valid)
            b_sign = fetch(mi.Vector4f, self._b_sign, shape, valid)
            a, r = mi.Point3f(a_r.xyz), a_r.w
            b, sign = mi.Normal3f(b_sign.xyz), b_sign.w
            if self.kinds & PLANES:
                p, n = mi.Point3f(precise.plane_point(o, d, a, b)), b
            if Kind.SPHERE in self.kinds:
                outward = mi.Normal3f(precise.sphere_normal(o, d, a, r, t))
                p = dr.select(kind == +Kind.SPHERE, mi.Point3f(dr.fma(r, outward, a)), p)
                n = dr.select(kind == +Kind.SPHERE, outward, n)
            if Kind.CYLINDER in self.kinds:
                on_cylinder, outward = precise.cylinder_point(o, d, a, b, r, t)
                p = dr.select(kind == +Kind.CYLINDER, mi.Point3f(on_cylinder), p)
                n = dr.select(kind == +Kind.CYLINDER, mi.Normal3f(outward), n)
            n_g = n
            if with_uv:
                uv = self._texture_coordinates(kind, p - a, shape, valid)

        if Kind.MESH in self.kinds:
            here = valid & (kind == +Kind.MESH)
            on_mesh = self.meshes.hit(face, o, d, shape, with_uv, here)
            p = dr.select(here, on_mesh.p, p)
            n = dr.select(here, on_mesh.n, n)
            n_g = dr.select(here, on_mesh.n_g, n_g)
            uv = dr.select(here, on_mesh.uv, uv)
            sign = dr.select(here, on_mesh.sign, sign)

        n, n_g = n * sign, n_g * sign
        if self.instances:
            p, n, n_g, reach = placement.to_world(p, n, n_g, reach)
        if self.meshes.smooth:
            n_g = dr.select(dr.dot(n_g, n) < 0, -n_g, n_g)
        return Hit(shape, p, n, n_g, uv, reach)

    def _texture_coordinates(self, kind: Any, off_origin: Any, shape: Any, active: Any) -> Any:
        """Mitsuba's (u, v) of its analytic shapes, from a vector off the image of their local origin."""
        x, y, z = (dr.dot(fetch(mi.Vector3f, self._to_local, 3 * shape + i, active), off_origin) for i in range(3))
        uv = mi.Point2f(dr.fma(x, 0.5, 0.5), dr.fma(y, 0.5, 0.5))  # rectangle
        if self.kinds - {Kind.RECTANGLE, Kind.MESH}:
            turn = dr.atan2(y, x) * (0.5 / dr.pi)
            turn = dr.select(turn < 0, turn + 1, turn)
            radius = dr.sqrt(x * x + y * y)
            uv = dr.select(kind == +Kind.DISK, mi.Point2f(radius, turn), uv)
            uv = dr.select(kind == +Kind.CYLINDER, mi.Point2f(turn, z), uv)
            polar = dr.atan2(radius, z) * (1 / dr.pi)
            uv = dr.select(kind == +Kind.SPHERE, mi.Point2f(turn, polar), uv)
        return uv


def _row(graph: SceneGraph, shape: mi.Shape, centre: Vector) -> _Row:
    kind = _KINDS.get(shape.class_name(), Kind.MESH)
    if kind == Kind.MESH and not shape.is_mesh():
        raise SceneError(
            f"shape `{shape.id()}`: {shape.class_name()} is not handled; "
            "allowed are spheres, rectangles, disks, cylinders, meshes and instances of them"
        )
    if shape.is_medium_transition():
        raise SceneError(f"shape `{shape.id()}`: participating media are not handled")

    box = shape.bbox()
    reach = np.maximum(np.abs(np.array(box.min, float) - centre), np.abs(np.array(box.max, float) - centre))
    flipped = -1.0 if shape.has_flipped_normals() else 1.0
    if kind == Kind.MESH:
        zero = np.zeros(3)
        return _Row(kind, zero, zero, 0.0, flipped, reach, np.zeros((3, 3)))

    to_world = graph.value(shape, "to_world")
    matrix = matrix_of(to_world, f"shape `{shape.id()}`", _PLACED_BY.get(kind, "to_world"))
    linear, origin = matrix[:3, :3], matrix[:3, 3] - centre
    to_local = np.linalg.inv(linear)

    radius = float(np.linalg.norm(linear[:, 0]))
    normal = linear[:, 2]
    if kind in PLANES:
        normal = np.array(to_world.inverse_transpose, float).reshape(4, 4)[:3, 2]
        if not np.all(np.isfinite(normal)) or not normal.any():
            raise SceneError(f"shape `{shape.id()}`: to_world is too large or too small for a normal in float32")
    if kind == Kind.CYLINDER and np.linalg.det(linear) < 0:
        flipped = -flipped  # Mitsuba notes the mirror as a flip, to keep the normal outward
    return _Row(kind, origin, normal / np.linalg.norm(normal), radius, flipped, reach, to_local)
