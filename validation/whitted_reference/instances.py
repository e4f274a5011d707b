"""A primitive seen through a transform: the ray is moved into the primitive's own space."""

from __future__ import annotations

import math
from itertools import product

from whitted_reference.arithmetic import Arithmetic
from whitted_reference.shapes import Primitive, box_of, turned, unit
from whitted_reference.transforms import Affine, inverse_linear
from whitted_reference.vectors import Number, Vec, dot


class Placed(Primitive):
    """One primitive of a group, through the group's to_world; distances along the ray keep their meaning."""

    __slots__ = ("_arithmetic", "_normal", "primitive", "stretch")

    def __init__(self, primitive: Primitive, to_world: Affine, arithmetic: Arithmetic) -> None:
        self.primitive = primitive
        self._arithmetic = arithmetic
        inverse = [x for row in inverse_linear(to_world.matrix) for x in map(arithmetic.ratio, row)]
        self.data = (*arithmetic.vec(to_world.column(3)), *inverse)
        # No distance is longer inside than this many times what it is outside (Frobenius norm).
        self.stretch = math.sqrt(sum(float(x) ** 2 for row in inverse_linear(to_world.matrix) for x in row))
        self._normal = [arithmetic.vec(row) for row in to_world.normal]
        box = primitive.box
        corners = product((box[0], box[3]), (box[1], box[4]), (box[2], box[5]))
        rows = to_world.matrix
        self.box = box_of([tuple(a * x + b * y + c * z + t for a, b, c, t in rows) for x, y, z in corners])

    def inner_ray(self, e: Vec, d: Vec) -> tuple[Vec, Vec, Number]:
        """Return origin, unit direction, and how many times longer than outside distances are inside."""
        tx, ty, tz, a, b, c, p, q, r, u, v, w = self.data
        x, y, z = e[0] - tx, e[1] - ty, e[2] - tz
        dx, dy, dz = d
        lx, ly, lz = a * dx + b * dy + c * dz, p * dx + q * dy + r * dz, u * dx + v * dy + w * dz
        length = self._arithmetic.sqrt(lx * lx + ly * ly + lz * lz)
        origin = (a * x + b * y + c * z, p * x + q * y + r * z, u * x + v * y + w * z)
        return origin, (lx / length, ly / length, lz / length), length

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
        """Ask the primitive inside."""
        e, d, length = self.inner_ray((ex, ey, ez), (dx, dy, dz))
        t = self.primitive.hit(*e, *d, start * length if start > 0 else start, end * length)
        return None if t is None else t / length

    def again(
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
        """Ask the primitive inside, for a ray that leaves it."""
        e, d, length = self.inner_ray((ex, ey, ez), (dx, dy, dz))
        t = self.primitive.again(*e, *d, start * length if start > 0 else start, end * length)
        return None if t is None else t / length

    def normals(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec]:
        """Turn the normals inside by M^-T: what was outward stays so, mirrored or not."""
        n, n_g = self.primitive.normals(*self._inside(e, d, t, p))
        outer = self._outside(n)
        return outer, outer if n_g is n else turned(self._outside(n_g), outer)

    def uv(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Number, Number]:
        """Ask the primitive inside."""
        return self.primitive.uv(*self._inside(e, d, t, p))

    def _inside(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec, Number, Vec]:
        e, d, length = self.inner_ray(e, d)
        t = t * length
        return e, d, t, (e[0] + t * d[0], e[1] + t * d[1], e[2] + t * d[2])

    def _outside(self, n: Vec) -> Vec:
        x, y, z = (dot(row, n) for row in self._normal)
        return unit((x, y, z), self._arithmetic)
