"""Instances: placed copies of shape groups."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.precise import rcp
from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.tables import column, double_column, fetch
from mitsuba_whitted.transforms import matrix_of, moved


class Placement(NamedTuple):
    """Where the instance of a hit stands; the identity for shapes that are no part of one."""

    to_world_rows: tuple[Any, Any, Any]
    """Vector4d each: a row of the matrix."""
    to_local_rows: tuple[Any, Any, Any]
    normal_rows: tuple[Any, Any, Any]
    """Vector3d each: a row of M^-T, as single numbers give it."""

    def to_local(self, o: Any, d: Any, t: Any) -> tuple[Any, Any, Any]:
        """Bring a ray into the group's space, its direction again of unit length."""
        d = mi.Vector3d(*(dr.dot(row.xyz, d) for row in self.to_local_rows))
        length = dr.norm(d)
        return mi.Point3d(*(dr.dot(row.xyz, o) + row.w for row in self.to_local_rows)), d * rcp(length), t * length

    def to_world(self, p: Any, n: Any, n_g: Any, reach: Any) -> tuple[Any, Any, Any, Any]:
        """Bring a hit back; a normal goes by the inverse transposed, stays on its side, and has any length."""
        rows = self.to_world_rows
        return (
            mi.Point3d(*(dr.dot(row.xyz, p) + row.w for row in rows)),
            self._normal(n),
            self._normal(n_g),
            mi.Vector3f(*(mi.Float(dr.dot(dr.abs(row.xyz), mi.Vector3d(reach)) + dr.abs(row.w)) for row in rows)),
        )

    def _normal(self, n: Any) -> Any:
        return mi.Normal3d(*(dr.dot(row, n) for row in self.normal_rows))


class Instances:
    """Transforms of the instances of a scene, by their number counted from 1; 0 is no instance."""

    def __init__(self, graph: SceneGraph, centre: NDArray[np.float64]) -> None:
        transforms = [graph.value(each, "to_world") for each in graph.instances]
        names = [f"instance `{each.id()}`" for each in graph.instances]
        placed = [matrix_of(to_world, name) for to_world, name in zip(transforms, names, strict=True)]
        turning = [np.array(to_world.inverse_transpose, float).reshape(4, 4)[:3, :3] for to_world in transforms]
        matrices = [np.eye(4), *(moved(matrix, -centre) for matrix in placed)]
        self._to_world = double_column(row for matrix in matrices for row in matrix[:3])
        self._to_local = double_column(row for matrix in matrices for row in np.linalg.inv(matrix)[:3])
        self._normals = column(row for matrix in [np.eye(3), *turning] for row in matrix)

    def placement(self, instance: Any, active: Any) -> Placement:
        """Transform of the instance with this number."""
        to_world, to_local = (self._rows(table, instance, active) for table in (self._to_world, self._to_local))
        x, y, z = (mi.Vector3d(fetch(mi.Vector3f, self._normals, 3 * instance + i, active)) for i in range(3))
        return Placement(to_world, to_local, (x, y, z))

    @staticmethod
    def _rows(table: Any, row: Any, active: Any) -> tuple[Any, Any, Any]:
        x, y, z = (fetch(mi.Vector4d, table, 3 * row + i, active) for i in range(3))
        return x, y, z
