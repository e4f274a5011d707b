"""The surface around a hit: how its normal and coordinates change there, and what their roundings cost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_reference.instances import Placed
from whitted_reference.polygon import Polygon
from whitted_reference.ray_tree import RayNode
from whitted_reference.shapes import Cylinder, Primitive, Sphere
from whitted_reference.triangles import Triangle
from whitted_reference.vectors import add, scaled
from whitted_validation.forms import Matrix, radius
from whitted_validation.roundoffs import (
    COORDINATE,
    LOCAL,
    PLACED,
    PLANE_DISTANCE,
    PLANE_SLOPE,
    POLYGON,
    SPHERE_DISTANCE,
    VERTEX_NORMAL,
    WEIGHTS,
    V,
)


class Patch:
    """The surface around a hit: how its normal and coordinates change, by differences, and its own roundings."""

    def __init__(self, primitive: Primitive, node: RayNode) -> None:
        self._primitive = primitive
        self._node = node
        low, high = np.array(primitive.box[:3], float), np.array(primitive.box[3:], float)
        self.extent = high - low
        self.reach = np.maximum(np.abs(low), np.abs(high))
        self._g = np.array(node.n_g, float)
        first, second = primitive.normals(node.e, node.d, node.t, node.p)  # type: ignore[arg-type]
        self.flat = first is not second  # a shading normal of its own over a flat face
        inner = primitive.primitive if isinstance(primitive, Placed) else primitive
        self._inner = inner
        self._smooth = self.flat and isinstance(inner, Triangle) and inner.vertex_normals is not None
        self._ball = isinstance(inner, Sphere)
        self._polygon = isinstance(inner, Polygon)
        self._radius = math.sqrt(inner.data[7]) if isinstance(inner, Cylinder) else float(self.extent.max()) / 2.0
        # Two unit vectors across the normal, and the change of the normal along each.
        a = np.array([0.0, 1.0, 0.0]) if abs(self._g[0]) > 0.5 else np.array([1.0, 0.0, 0.0])
        u = np.cross(self._g, a)
        u /= np.linalg.norm(u)
        self._tangents = np.array([u, np.cross(self._g, u)])
        # A part in a million of the size: the difference is right to (10^-6)^2, and to 2^-53 / 10^-6.
        self._by = 1e-6 * float(np.linalg.norm(self.extent))
        curved = self._smooth or not self._is_flat(inner)
        if curved:
            turned = [self._normal_at(+t) - self._normal_at(-t) for t in self._tangents * self._by]
            self._slope = np.array(turned).T / (2.0 * self._by)
        else:
            self._slope = np.zeros((3, 2))
        self.curvature = 0.0
        if curved and not self._smooth:
            along = self._tangents @ np.array(node.d, float)
            towards = self._tangents @ self._slope  # the shape operator in the tangents
            self.curvature = abs(float(along @ towards @ along))
            self.flat = False
        else:
            self.flat = True

    @staticmethod
    def _is_flat(inner: Primitive) -> bool:
        return hasattr(inner, "sides") or hasattr(inner, "frame")

    def _moved(self, by: Matrix) -> tuple[Any, Any, Any, Any]:
        node = self._node
        assert node.p is not None
        e = tuple(x + y for x, y in zip(node.e, by.tolist(), strict=True))
        p = tuple(x + y for x, y in zip(node.p, by.tolist(), strict=True))
        return e, node.d, node.t, p

    def _normal_at(self, by: Matrix) -> Matrix:
        return np.array(self._primitive.normals(*self._moved(by))[0], float)

    def turn_of_normal(self, hit: Matrix) -> Matrix:
        """Return the error form of the normal that follows from that of the point."""
        turned: Matrix = self._slope @ (self._tangents @ hit)
        return turned

    @property
    def normal_roundings(self) -> float:
        """Own roundings of the normal, a component."""
        if self._smooth:
            n, n1, n2 = (np.array(normal, float) for normal in self._inner.vertex_normals)  # type: ignore[attr-defined]
            e1, e2, w = self._from_corner()
            beta, gamma = np.linalg.lstsq(np.array([e1, e2]).T, w, rcond=None)[0]
            turn = float(np.abs(n1 - n).max() + np.abs(n2 - n).max())
            size = float(np.linalg.norm(n + beta * (n1 - n) + gamma * (n2 - n)))
            return VERTEX_NORMAL + 5 * V + self._weights_off() * turn / size
        if self.flat:
            return V + POLYGON * self._polygon
        return 8 * V * (1.0 + (self._node.t + float(self.extent.max())) / self._radius)

    def _from_corner(self) -> Matrix:
        """Return two sides of a triangle and the way to the hit, from its first corner."""
        (a, b), (_, c), _ = self._inner.sides()  # type: ignore[attr-defined]
        away: Matrix = np.array([b, c, self._node.p], float) - np.array(a, float)
        return away

    def _weights_off(self) -> float:
        """Return how far each weight of the corners may be off."""
        e1, e2, _ = self._from_corner()
        return WEIGHTS * max(float(e1 @ e1), float(e2 @ e2)) / float(np.linalg.norm(np.cross(e1, e2)))

    def plane_reach(self, whole: Matrix | None) -> float:
        """How far rounding may leave a ray that starts on the surface off it, in units of `OFFSET`.

        `whole` is the reach of the shape, where the tracer does not keep that of each triangle.
        """
        g = np.abs(self._g)
        reach = float(g @ (self.reach if whole is None else whole))
        return max(reach, self.plane_tilt)

    @property
    def plane_tilt(self) -> float:
        """How far the plane that a search makes of a triangle's edges may leave it, in units of 4 u."""
        if not isinstance(self._inner, Triangle):
            return 0.0
        e, f, _ = self._from_corner()
        x, y, z = np.abs(e)
        p, q, r = np.abs(f)
        products = np.array([y * r + z * q, z * p + x * r, x * q + y * p])
        return float(self.extent @ products) / float(np.linalg.norm(np.cross(e, f)))

    @property
    def _off_plane(self) -> float:
        """How far the plane of a polygon, stored in single, may be off."""
        return POLYGON * float(np.abs(self._g) @ (self.reach + self.extent)) if self._polygon else 0.0

    def distance_roundings(self, t: float) -> float:
        """Own roundings of the meeting, as a distance along the normal."""
        if self._ball:
            return SPHERE_DISTANCE * (self._radius + t)
        if not self.flat:  # a tube: the foot carries the distance, half a chord that over the radius
            far = float(np.linalg.norm(self.extent)) + t
            return SPHERE_DISTANCE * far * max(1.0, far / self._radius)
        g, d = np.abs(self._g), np.abs(np.array(self._node.d, float))
        slant = float(g @ d) * t
        return PLANE_DISTANCE * (slant + float(g @ self.extent)) + PLANE_SLOPE * slant + self._off_plane

    @property
    def point_roundings(self) -> NDArray[np.float64]:
        """Own roundings of the point: of its coordinates, and of its place on the surface."""
        assert self._node.p is not None
        coordinates = 2 * V * np.abs(np.array(self._node.p, float))
        if self._ball or not self.flat:
            return np.asarray(coordinates + 8 * V * (float(self.extent.max()) + self._node.t))
        g = np.abs(self._g)
        return np.asarray(coordinates + (PLANE_DISTANCE * float(g @ self.extent) + self._off_plane) * g)

    def uv_error(self, hit: Matrix) -> tuple[float, float]:
        """Bound the errors of the surface coordinates: those that follow from the point, and their own roundings."""
        off = radius(self._uv_slope() @ (self._tangents @ hit)) + self.uv_roundings
        return float(off[0]), float(off[1])

    @property
    def uv_roundings(self) -> NDArray[np.float64]:
        """Own roundings of the surface coordinates."""
        if isinstance(self._inner, Triangle):
            u, u1, u2 = np.array(self._inner.uvs or ((0, 0), (1, 0), (0, 1)), float)
            size = np.maximum(1.0, np.abs([u, u1, u2]).max(axis=0))
            return np.asarray(COORDINATE * size + self._weights_off() * (np.abs(u1 - u) + np.abs(u2 - u)))
        return np.asarray(COORDINATE + LOCAL * (np.abs(self._uv_slope() @ self._tangents) @ self.extent))

    def _uv_slope(self) -> Matrix:
        """Return the change of the coordinates along both tangents, by differences along the surface."""
        ahead, behind = (
            np.array([self._primitive.uv(*self._moved(s * self._by * t)) for t in self._tangents], float)
            for s in (1.0, -1.0)
        )
        change = ahead - behind
        change -= np.rint(change)  # over the seam where a turn begins, coordinates jump by 1
        slope: Matrix = change.T / (2.0 * self._by)
        return slope


class PlacedPatch(Patch):
    """The surface of an instance: a hit inside with its own roundings, and what bringing it out costs.

    The ray is brought in and the hit out by matrices in float64. (Who is met first is decided outside, on vertices
    put into world space in float64 and rounded once: see `beams`.)
    """

    def __init__(self, primitive: Placed, node: RayNode) -> None:
        super().__init__(primitive, node)
        e, d, length = primitive.inner_ray(node.e, node.d)
        t = node.t * length
        p = add(e, scaled(d, t))
        n, n_g = primitive.primitive.normals(e, d, t, p)
        self._inside = Patch(primitive.primitive, RayNode(node.k, e, d, t=t, p=p, n=n, n_g=n_g))
        self._length = length
        self._shift, inverse = matrices(primitive)
        self._matrix = np.abs(np.linalg.inv(inverse))
        self._p = np.abs(np.array(p, float))
        self._g_inside = np.abs(np.array(n_g, float))
        # |M^-T n|, for both normals: a distance along the normal inside is 1 / |M^-T n_g| as long outside.
        self._n_size, self._g_size = (float(np.linalg.norm(inverse.T @ np.array(m, float))) for m in (n, n_g))
        self._rows = float(np.abs(inverse.T).sum(axis=1).max())

    @property
    def normal_roundings(self) -> float:
        """Those inside, and of M^-T n: its rows 1 and dot product 3, more where they cancel."""
        return (self._inside.normal_roundings + 4 * V) * self._rows / self._n_size

    def plane_reach(self, whole: Matrix | None) -> float:
        """Of the shape inside, brought out."""
        assert whole is not None
        inside = np.maximum(whole, self._inside.plane_tilt * self._g_inside)
        return float(np.abs(self._g) @ (self._matrix @ inside + np.abs(self._shift)))

    @property
    def uv_roundings(self) -> NDArray[np.float64]:
        """Those inside."""
        return self._inside.uv_roundings

    def distance_roundings(self, t: float) -> float:
        """Those inside, as a distance outside."""
        return self._inside.distance_roundings(t * self._length) / self._g_size

    @property
    def point_roundings(self) -> NDArray[np.float64]:
        """Those inside, brought out, and of the matrix."""
        out = self._matrix @ self._inside.point_roundings
        return np.asarray(out + PLACED * (self._matrix @ self._p + np.abs(self._shift)))


def matrices(primitive: Placed) -> tuple[Matrix, Matrix]:
    """Return the translation of an instance, and the inverse of its linear part."""
    data = np.array(primitive.data, float)
    return data[:3], data[3:].reshape(3, 3)


def patch_of(primitive: Primitive, node: RayNode) -> Patch:
    """Return the surface around a hit."""
    return PlacedPatch(primitive, node) if isinstance(primitive, Placed) else Patch(primitive, node)
