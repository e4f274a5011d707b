"""Instances: placed copies of shape groups."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.tables import column, fetch, index_column
from mitsuba_whitted.transforms import matrix_of


class Placement(NamedTuple):
    """Where the instance of a hit stands; the identity for shapes that are no part of one."""

    to_world_rows: tuple[Any, Any, Any]
    """Vector4f each: a row of the matrix."""
    to_local_rows: tuple[Any, Any, Any]

    def to_local(self, o: Any, d: Any, t: Any) -> tuple[Any, Any, Any]:
        """Bring a ray into the group's space, its direction again of unit length."""
        d = mi.Vector3f(*(dr.dot(row.xyz, d) for row in self.to_local_rows))
        length = dr.norm(d)
        return mi.Point3f(*(dr.dot(row.xyz, o) + row.w for row in self.to_local_rows)), d * dr.rcp(length), t * length

    def to_world(self, p: Any, n: Any, n_g: Any, reach: Any) -> tuple[Any, Any, Any, Any]:
        """Bring a hit back; a normal goes by the inverse transposed, so that it stays on its side."""
        rows = self.to_world_rows
        return (
            mi.Point3f(*(dr.dot(row.xyz, p) + row.w for row in rows)),
            self._normal(n),
            self._normal(n_g),
            mi.Vector3f(*(dr.dot(dr.abs(row.xyz), reach) + dr.abs(row.w) for row in rows)),
        )

    def _normal(self, n: Any) -> Any:
        x, y, z = self.to_local_rows
        return mi.Normal3f(dr.normalize(mi.Vector3f(n.x * x.xyz + n.y * y.xyz + n.z * z.xyz)))


class Instances:
    """The instances of a scene, and which shape of its group a ray has met.

    Mitsuba tells a hit on an instance by the number of the shape inside a group that it does not name; only
    the full intersection record has the shape itself. So scenes with instances, and only they, pay for it.
    """

    def __init__(self, graph: SceneGraph, shapes: list[mi.Shape]) -> None:
        self._row_of_shape = _ByObject(shapes)
        self._row_of_instance = _ByObject(graph.instances, first=1)
        placed = [matrix_of(graph.value(each, "to_world"), f"instance `{each.id()}`") for each in graph.instances]
        matrices = [np.eye(4), *placed]
        self._to_world = column(matrix[:3].ravel() for matrix in matrices)
        self._to_local = column(np.linalg.inv(matrix)[:3].ravel() for matrix in matrices)

    def shape_of(self, pi: mi.PreliminaryIntersection3f, ray: mi.Ray3f, active: Any) -> Any:
        """Row of the shape that was hit."""
        si = pi.compute_surface_interaction(ray, +mi.RayFlags.Minimal, active)
        return self._row_of_shape(si.shape, active)

    def placement(self, pi: mi.PreliminaryIntersection3f, active: Any) -> Placement:
        """Transform of the instance that was hit."""
        row = self._row_of_instance(pi.instance, active)
        return Placement(self._rows(self._to_world, row, active), self._rows(self._to_local, row, active))

    @staticmethod
    def _rows(table: Any, row: Any, active: Any) -> tuple[Any, Any, Any]:
        x, y, z = (fetch(mi.Vector4f, table, 3 * row + i, active) for i in range(3))
        return x, y, z


class _ByObject:
    """From a shape in a kernel to its row in our tables, 0 for none."""

    def __init__(self, shapes: list[mi.Shape], first: int = 0) -> None:
        if not dr.is_jit_v(mi.Float):
            self._rows: Any = {shape: first + i for i, shape in enumerate(shapes)}
            return
        registry: list[int] = [np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0] for shape in shapes]
        rows = np.zeros(max(registry) + 1, np.uint32)
        rows[registry] = np.arange(first, first + len(shapes))
        self._rows = index_column([rows])

    def __call__(self, shape: Any, active: Any) -> Any:
        if not dr.is_jit_v(mi.Float):
            return self._rows.get(shape, 0)
        return fetch(mi.UInt32, self._rows, dr.reinterpret_array(mi.UInt32, shape), active)

