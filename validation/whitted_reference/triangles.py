"""Triangles with watertight edges, and the vertex normals of meshes."""

from __future__ import annotations

from fractions import Fraction

from whitted_reference import scene
from whitted_reference.arithmetic import Arithmetic
from whitted_reference.shapes import Primitive, box_of, turned, unit
from whitted_reference.vectors import Number, Vec, add, cross, dot, negated, scaled, sub


class Triangle(Primitive):
    """A triangle with watertight edges.

    Which side of an edge the ray passes is the sign of d.(P x Q), P and Q the ends of the edge seen from
    e. The ends are always taken in the same order (that of their coordinates), so two triangles that
    share an edge compute the same number for it and cannot both miss; 0 belongs to both. The distance
    and the weights beta, gamma are Cramer's rule (Shirley et al. 2009, section 4.4.2).
    """

    __slots__ = ("_arithmetic", "_corners", "_g", "uvs", "vertex_normals")

    def __init__(
        self,
        corners: tuple[scene.Floats3, scene.Floats3, scene.Floats3],
        normals: tuple[Vec, Vec, Vec] | None,
        uvs: tuple[tuple[float, float], ...] | None,
        flip: bool,
        arithmetic: Arithmetic,
    ) -> None:
        self._arithmetic = arithmetic
        a, b, c = (arithmetic.vec(v) for v in corners)
        self._corners: tuple[Vec, Vec, Vec] = (a, b, c)
        winding = cross(sub(b, a), sub(c, a))
        ordered = [x for corner in sorted(corners) for x in arithmetic.vec(corner)]
        self.data = (*ordered, *winding)
        self._g = unit(winding, arithmetic)
        if flip:
            self._g = negated(self._g)
            normals = (negated(normals[0]), negated(normals[1]), negated(normals[2])) if normals else None
        self.vertex_normals = normals
        self.uvs = [arithmetic.vec(uv) for uv in uvs] if uvs else None
        self.box = box_of(list(corners))

    def hit(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Ask on which side of each edge the ray passes, then for the distance."""
        ax, ay, az, bx, by, bz, cx, cy, cz, nx, ny, nz = self.data
        ax -= ex
        ay -= ey
        az -= ez
        bx -= ex
        by -= ey
        bz -= ez
        ab = dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)
        cx -= ex
        cy -= ey
        cz -= ez
        bc = dx * (by * cz - bz * cy) + dy * (bz * cx - bx * cz) + dz * (bx * cy - by * cx)
        if (ab > 0 and bc < 0) or (ab < 0 and bc > 0):
            return None
        ac = dx * (ay * cz - az * cy) + dy * (az * cx - ax * cz) + dz * (ax * cy - ay * cx)
        if (ac > 0 and (ab > 0 or bc > 0)) or (ac < 0 and (ab < 0 or bc < 0)):
            return None
        slope = dx * nx + dy * ny + dz * nz
        if slope == 0:
            return None
        t = (ax * nx + ay * ny + az * nz) / slope
        return t if start < t <= end else None

    def sides(self) -> list[tuple[Vec, Vec]]:
        """Return the two ends of each side."""
        a, b, c = self._corners
        return [(a, b), (b, c), (c, a)]

    def _weights(self, e: Vec, d: Vec) -> tuple[Number, Number]:
        """Return beta and gamma: e + t d = a + beta (b - a) + gamma (c - a)."""
        a, b, c = self._corners
        ab, ac, q = sub(b, a), sub(c, a), sub(e, a)
        across = cross(d, ac)
        determinant = dot(ab, across)
        return dot(q, across) / determinant, dot(d, cross(q, ab)) / determinant

    def normals(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec]:
        """Return the interpolated normal, or without vertex normals the face's own, and the face's."""
        if self.vertex_normals is None:
            return self._g, self._g
        beta, gamma = self._weights(e, d)
        n0, n1, n2 = self.vertex_normals
        n = unit(add(add(scaled(n0, 1 - beta - gamma), scaled(n1, beta)), scaled(n2, gamma)), self._arithmetic)
        return n, turned(self._g, n)

    def uv(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Number, Number]:
        """Return the interpolated uv, or without any (beta, gamma)."""
        beta, gamma = self._weights(e, d)
        if self.uvs is None:
            return beta, gamma
        (u0, v0), (u1, v1), (u2, v2) = self.uvs
        alpha = 1 - beta - gamma
        return alpha * u0 + beta * u1 + gamma * u2, alpha * v0 + beta * v1 + gamma * v2


def triangles(mesh: scene.Mesh, arithmetic: Arithmetic) -> list[Primitive]:
    """Build a mesh's triangles in file order, without those of zero area, which are never hit."""
    normals = vertex_normals(mesh, arithmetic)
    result: list[Primitive] = []
    for i, j, k in mesh.faces:
        corners = (mesh.vertices[i], mesh.vertices[j], mesh.vertices[k])
        if _is_degenerate(*corners):
            continue
        own = (normals[i], normals[j], normals[k]) if normals else None
        uvs = (mesh.uvs[i], mesh.uvs[j], mesh.uvs[k]) if mesh.uvs else None
        result.append(Triangle(corners, own, uvs, mesh.flip, arithmetic))
    return result


def _is_degenerate(a: scene.Floats3, b: scene.Floats3, c: scene.Floats3) -> bool:
    """Tell exactly whether three points lie on a line."""
    ab, ac = sub(b, a), sub(c, a)
    n = cross(ab, ac)
    # Differences and products are off by 2^-53 each, relative to sizes bounded by |ab| |ac|; if the
    # result is above 2^-40 of that it is certainly not zero and the exact arithmetic can be spared.
    if dot(n, n) > 2.0**-80 * dot(ab, ab) * dot(ac, ac) and ab != ac:
        return False
    exact = [(Fraction(x), Fraction(y), Fraction(z)) for x, y, z in (a, b, c)]
    return not any(cross(sub(exact[1], exact[0]), sub(exact[2], exact[0])))


def vertex_normals(mesh: scene.Mesh, arithmetic: Arithmetic) -> list[Vec] | None:
    """Return unit normals per vertex: the file's under M^-T, or made from the faces, or None."""
    if mesh.normals is not None:
        rows = [arithmetic.vec(row) for row in mesh.to_world.normal]
        vectors = [arithmetic.vec(n) for n in mesh.normals]
        return [unit((dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)), arithmetic) for v in vectors]
    if not mesh.smooth:
        return None
    return _angle_weighted(mesh, arithmetic)


def _angle_weighted(mesh: scene.Mesh, arithmetic: Arithmetic) -> list[Vec]:
    """Add up each face's unit normal times its angle at the vertex (Thuermer and Wuethrich 1998)."""
    zero: Vec = arithmetic.vec((0.0, 0.0, 0.0))
    sums = [zero] * len(mesh.vertices)
    points: list[Vec] = [arithmetic.vec(v) for v in mesh.vertices]
    for face in mesh.faces:
        if _is_degenerate(*(mesh.vertices[i] for i in face)):
            continue
        corners = [points[i] for i in face]
        n = unit(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])), arithmetic)
        for k in range(3):
            to_next, to_last = sub(corners[k - 2], corners[k]), sub(corners[k - 1], corners[k])
            turn = cross(to_next, to_last)
            angle = arithmetic.atan2(arithmetic.sqrt(dot(turn, turn)), dot(to_next, to_last))
            sums[face[k]] = add(sums[face[k]], scaled(n, angle))
    # A vertex of no face, or one whose faces cancel, gets x: Mitsuba's choice.
    unused: Vec = arithmetic.vec((1.0, 0.0, 0.0))
    return [unit(n, arithmetic) if any(n) else unused for n in sums]
