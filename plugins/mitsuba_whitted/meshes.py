"""Triangle meshes as tables: all meshes of a scene one after another in shared buffers."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted import precise
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.scene_graph import SceneGraph, searched_by_optix
from mitsuba_whitted.tables import fetch, index_column, stored


class MeshHit(NamedTuple):
    """A hit on a triangle; the normals are those of Mitsuba before `sign` is applied."""

    p: Any
    n: Any
    n_g: Any
    uv: Any
    sign: Any
    reach: Any
    """As of `Hit`, but of the triangle alone."""


class Meshes:
    """Vertices, faces and face normals of all meshes, and the hit on one of their triangles.

    A face's normal is computed in float64 at load: from float32 edges it would be wrong by u times the aspect
    ratio of the triangle. So it is in Embree, and a ray that leaves has to begin that much further off: each
    face keeps its own reach, and a large mesh of small triangles leaks no light for its size. Vertices of face f
    of shape s are at ``faces[3 (first_face[s] + f) ...]``.
    """

    def __init__(self, graph: SceneGraph, shapes: list[mi.Shape], origins: list[NDArray[np.float64]]) -> None:
        parts = [
            _Part(graph, shape, origin) if _triangles(shape) else None
            for shape, origin in zip(shapes, origins, strict=True)
        ]
        meshes = [part for part in parts if part]
        self.smooth = any(len(part.normals) for part in meshes)
        self.flipped = any(part.flags & _FLIPPED for part in meshes)
        if not meshes:
            return

        first_face, first_vertex, faces, rows = 0, 0, [], []
        for part in parts:
            rows.append((first_face, part.flags, 0, 0) if part else (0, 0, 0, 0))
            if part:
                faces.append(part.faces + first_vertex)
                first_face += len(part.faces)
                first_vertex += len(part.positions)
        self._rows = index_column(rows)
        self._faces = stored(np.concatenate(faces))
        positions = np.concatenate([part.positions for part in meshes])
        self._point = mi.Point3f if positions.dtype == np.float32 else mi.Point3d
        self._positions = stored(positions)
        self._planes = stored(np.concatenate([part.planes() for part in meshes]))
        if self.smooth:
            self._normals = stored(np.concatenate([part.padded(part.normals, 3) for part in meshes]))
        self._has_texcoords = any(len(part.texcoords) for part in meshes)
        if self._has_texcoords:
            self._texcoords = stored(np.concatenate([part.padded(part.texcoords, 2) for part in meshes]))

    def hit(self, face: Any, o: Any, d: Any, shape: Any, with_uv: bool, active: Any) -> MeshHit:
        """Compute the hit on triangle number `face` of mesh `shape` by the ray from `o` along `d`."""
        row = fetch(mi.Vector4u, self._rows, shape, active)
        flags = row.y
        face = row.x + face
        corner = fetch(mi.Vector3u, self._faces, face, active)
        plane = fetch(mi.Vector4d, self._planes, face, active)
        n_g = mi.Normal3d(plane.xyz)
        v0 = self._vertex(corner.x, active)
        w = mi.Vector3d(precise.plane_point(o - v0, d, n_g))
        n, uv = n_g, mi.Point2d(0)

        if self.smooth or with_uv:
            v1, v2 = self._vertex(corner.y, active), self._vertex(corner.z, active)
            beta, gamma = precise.barycentric(w, v1 - v0, v2 - v0)
        if self.smooth:
            n_i = [mi.Normal3d(fetch(mi.Normal3f, self._normals, corner[i], active)) for i in range(3)]
            smooth = mi.Normal3d(_interpolate(beta, gamma, *n_i))
            n = dr.select((flags & _SMOOTH) != 0, smooth, n)
        if with_uv:
            uv = mi.Point2d(beta, gamma)
            if self._has_texcoords:
                uv_i = [mi.Point2d(fetch(mi.Point2f, self._texcoords, corner[i], active)) for i in range(3)]
                uv = dr.select((flags & _TEXCOORDS) != 0, _interpolate(beta, gamma, *uv_i), uv)
        sign = dr.select((flags & _FLIPPED) != 0, mi.Float64(-1), mi.Float64(1))
        reach = mi.Vector3f(plane.w * dr.abs(n_g))  # sum |n_i| reach_i = plane.w
        return MeshHit(mi.Point3d(v0 + w), n, n_g, uv, sign, reach)

    def _vertex(self, number: Any, active: Any) -> Any:
        return mi.Point3d(fetch(self._point, self._positions, number, active))


_SMOOTH, _TEXCOORDS, _FLIPPED = 1, 2, 4


def _interpolate(beta: Any, gamma: Any, x0: Any, x1: Any, x2: Any) -> Any:
    return dr.fma(x2 - x0, gamma, dr.fma(x1 - x0, beta, x0))


def _triangles(shape: mi.Shape) -> bool:
    """Whether the hit is on a triangle; a rectangle is a mesh to Mitsuba but one parallelogram to us."""
    return bool(shape.is_mesh()) and shape.class_name() != "Rectangle"


class _Part:
    """One mesh on its way into the shared buffers."""

    def __init__(self, graph: SceneGraph, mesh: Any, origin: NDArray[np.float64]) -> None:
        self.positions: NDArray[Any] = _buffer(graph, mesh, "vertex_positions", np.float32, 3)
        self.normals = _buffer(graph, mesh, "vertex_normals", np.float32, 3)
        self.texcoords = _buffer(graph, mesh, "vertex_texcoords", np.float32, 2)
        self.faces = _buffer(graph, mesh, "faces", np.uint32, 3)
        if not len(self.faces):
            raise SceneError(f"shape `{mesh.id()}`: has no triangle; a mesh must have one")
        for name in ("positions", "normals", "texcoords"):
            wrong = np.flatnonzero(~np.isfinite(getattr(self, name)).all(axis=1))
            if len(wrong):
                raise SceneError(
                    f"shape `{mesh.id()}`: vertex {wrong[0]} has {name} {getattr(self, name)[wrong[0]].tolist()}; "
                    "they must be finite"
                )
        self.face_normals = self._face_normals()
        if type(mesh).__name__ == "Polygon":
            self.positions, n = flattened(self.positions, self.normals, self.faces)
            self.face_normals = np.broadcast_to(n, self.face_normals.shape)
            self.normals = self.normals[:0]
        if origin.any():  # in double: not every difference is a single number
            self.positions = self.positions - origin
        else:
            self.positions = self.positions.astype(np.float32, copy=False)
        self.flags = (
            _SMOOTH * bool(len(self.normals))
            + _TEXCOORDS * bool(len(self.texcoords))
            + _FLIPPED * bool(mesh.has_flipped_normals())
        )

    def padded(self, values: NDArray[Any], width: int) -> NDArray[Any]:
        """Give a mesh that lacks `values` zeros, so that one vertex number serves all buffers."""
        return values if len(values) else np.zeros((len(self.positions), width), np.float32)

    def _face_normals(self) -> NDArray[np.float64]:
        v0, v1, v2 = np.moveaxis(self.positions.astype(np.float64)[self.faces], 1, 0)
        normals = np.cross(v1 - v0, v2 - v0)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        unit: NDArray[np.float64] = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        return unit  # zero for a triangle of no area, which no ray hits

    def planes(self) -> NDArray[np.float64]:
        """Give the normal of each face and its reach along that, (n, 4): see `precise.ray_offset`.

        The reach is sum |n_i| max |v_i|, or what Embree's plane is off where that is more: a component
        e_j f_k - e_k f_j of the normal, from edges e and f, rounds by up to 4 u (|e_j f_k| + |e_k f_j|), each
        product three times and the difference once, and that tilts the plane over the extent of the triangle. OptiX
        was seen to miss planes across an axis too, where Embree rounds nothing: by up to u of the extent.
        """
        corners = self.positions.astype(np.float64)[self.faces]
        e, f = np.abs(corners[:, 1] - corners[:, 0]), np.abs(corners[:, 2] - corners[:, 0])
        i, j, k = np.array([0, 1, 2]), np.array([1, 2, 0]), np.array([2, 0, 1])
        products = e[:, j] * f[:, k] + e[:, k] * f[:, j]
        double_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        tilt = (np.ptp(corners, axis=1)[:, i] * products).sum(axis=1)
        tilt = np.divide(tilt, double_area, out=np.zeros_like(tilt), where=double_area > 0)
        if searched_by_optix():
            tilt = np.maximum(tilt, np.ptp(corners, axis=1).max(axis=1) / 2)
        off = (np.abs(self.face_normals) * np.abs(corners).max(axis=1)).sum(axis=1)
        return np.column_stack([self.face_normals, np.maximum(off, tilt)])


def triangles_of(graph: SceneGraph, mesh: mi.Mesh) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    """Vertices of a mesh, those of a polygon on its plane, and its faces."""
    positions = _buffer(graph, mesh, "vertex_positions", np.float32, 3)
    faces = _buffer(graph, mesh, "faces", np.uint32, 3)
    if type(mesh).__name__ == "Polygon":
        positions, _ = flattened(positions, _buffer(graph, mesh, "vertex_normals", np.float32, 3), faces)
    return positions, faces


def flattened(
    positions: NDArray[Any], normals: NDArray[Any], faces: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Put all of a polygon on its one plane: through its first vertex, with the normal of every corner.

    Mitsuba computes the normals anew when vertices are edited, but not that of the first, which has no face.
    """
    a, n = positions[0].astype(np.float64), normals[faces[0, 0]].astype(np.float64)
    n /= np.linalg.norm(n)
    return positions - ((positions - a) @ n)[:, None] * n, n


def _buffer(graph: SceneGraph, mesh: mi.Mesh, name: str, kind: Any, width: int) -> NDArray[Any]:
    return np.array(graph.value(mesh, name), dtype=kind).reshape(-1, width)
