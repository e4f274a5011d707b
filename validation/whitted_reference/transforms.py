"""Transforms of the scene file: composed in double precision, rounded once to single.

A transform carries its matrix M and the inverse transpose M^-T side by side, as Mitsuba does: each
elementary transform knows both exactly, and a product multiplies both. Later elements of a
`<transform>` multiply from the left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from whitted_reference import float32

Row3 = tuple[float, float, float]
Row4 = tuple[float, float, float, float]
Fma = Callable[[float, float, float], float]


@dataclass(frozen=True)
class Affine:
    """Points to M p, normals to M^-T n.

    Attributes
    ----------
    matrix : three rows (m0, m1, m2, translation)
    normal : three rows of M^-T, the linear part only
    """

    matrix: tuple[Row4, Row4, Row4]
    normal: tuple[Row3, Row3, Row3]

    def column(self, j: int) -> Row3:
        """Return M e_j for j = 0, 1, 2 and the translation for j = 3."""
        return self.matrix[0][j], self.matrix[1][j], self.matrix[2][j]

    def normal_column(self, j: int) -> Row3:
        """Return M^-T e_j."""
        return self.normal[0][j], self.normal[1][j], self.normal[2][j]

    def rounded(self) -> Affine:
        """Round every number to binary32."""
        near = float32.nearest
        return Affine(
            tuple(tuple(near(x) for x in row) for row in self.matrix),  # type: ignore[arg-type]
            tuple(tuple(near(x) for x in row) for row in self.normal),  # type: ignore[arg-type]
        )

    def is_finite(self) -> bool:
        """Tell whether no number is infinite or undefined."""
        return all(math.isfinite(x) for row in (*self.matrix, *self.normal) for x in row)

    def determinant(self) -> Fraction:
        """Return the determinant of the linear part, exactly."""
        (a, b, c, _), (d, e, f, _), (g, h, i, _) = (tuple(map(Fraction, row)) for row in self.matrix)
        return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)

    def point32(self, p: Row3) -> Row3:
        """Transform a binary32 point in binary32: ((t + m0 x) + m1 y) + m2 z, each step fused."""
        fma = float32.fma
        x, y, z = p
        a, b, c = (fma(m2, z, fma(m1, y, fma(m0, x, t))) for m0, m1, m2, t in self.matrix)
        return a, b, c


def product(a: Affine, b: Affine, fma: Fma = float32.fma64) -> Affine:
    """Return a b: first b, then a. `fma` sets the precision: `float32.fma64` or `float32.fma`."""

    def chain(row: tuple[float, ...], column: Row3, start: float) -> float:
        for m, x in zip(row, column, strict=False):
            start = fma(m, x, start)
        return start

    columns = [b.column(j) for j in range(4)]
    normals = [b.normal_column(j) for j in range(3)]
    matrix = tuple(tuple(chain(row, columns[j], row[3] if j == 3 else 0.0) for j in range(4)) for row in a.matrix)
    normal = tuple(tuple(chain(row, normals[j], 0.0) for j in range(3)) for row in a.normal)
    return Affine(matrix, normal)  # type: ignore[arg-type]


def from_columns(x: Row3, y: Row3, z: Row3, origin: Row3, normal: tuple[Row3, Row3, Row3]) -> Affine:
    """Build from the images of the axes and of the origin; `normal` holds the columns of M^-T."""
    a, b, c = normal
    return Affine(
        tuple((x[i], y[i], z[i], origin[i]) for i in range(3)),  # type: ignore[arg-type]
        tuple((a[i], b[i], c[i]) for i in range(3)),  # type: ignore[arg-type]
    )


_X, _Y, _Z, _O = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
IDENTITY = from_columns(_X, _Y, _Z, _O, (_X, _Y, _Z))


def translation(v: Row3) -> Affine:
    """Move by v."""
    return from_columns(_X, _Y, _Z, v, (_X, _Y, _Z))


def scaling(v: Row3) -> Affine:
    """Scale along the axes; a zero factor leaves an infinity in M^-T."""
    x, y, z = (1.0 / s if s else math.inf for s in v)
    return from_columns(
        (v[0], 0.0, 0.0),
        (0.0, v[1], 0.0),
        (0.0, 0.0, v[2]),
        _O,
        ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)),
    )


def rotation(axis: Row3, degrees: float) -> Affine:
    """Turn about a unit axis (Rodrigues); M^-T = M."""
    angle = degrees * (math.pi / 180.0)
    s, c = math.sin(angle), math.cos(angle)
    rest = 1.0 - c
    fma = float32.fma64

    def diagonal(i: int) -> float:
        return fma(axis[i] * axis[i], rest, c)

    def above(i: int) -> float:  # row i + 1, column i
        j, k = (i + 1) % 3, (i + 2) % 3
        return fma(axis[i] * axis[j], rest, axis[k] * s)

    def below(i: int) -> float:  # row i + 2, column i
        j, k = (i + 1) % 3, (i + 2) % 3
        return fma(axis[i] * axis[k], rest, -(axis[j] * s))

    columns = (
        (diagonal(0), above(0), below(0)),
        (below(1), diagonal(1), above(1)),
        (above(2), below(2), diagonal(2)),
    )
    return from_columns(*columns, _O, columns)


def look_at(origin: Row3, target: Row3, up: Row3) -> Affine:
    """Put the origin at `origin` and +z towards `target`; +x = up x z. NaN where up is parallel to z."""
    z = _unit64((target[0] - origin[0], target[1] - origin[1], target[2] - origin[2]))
    x = _unit64(_cross64(up, z))
    y = _cross64(z, x)
    return from_columns(x, y, z, origin, (x, y, z))


def from_matrix(rows: tuple[Row4, Row4, Row4]) -> Affine:
    """Take a matrix as it stands and find its inverse transpose by cofactors."""
    linear = [row[:3] for row in rows]
    cofactors = [_cross64(linear[(i + 1) % 3], linear[(i + 2) % 3]) for i in range(3)]
    a, b = linear[0], cofactors[0]
    det = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    scale = 1.0 / det if det else math.inf
    return Affine(rows, tuple((x * scale, y * scale, z * scale) for x, y, z in cofactors))  # type: ignore[arg-type]


def inverse_linear(rows: tuple[Row4, Row4, Row4]) -> list[list[Fraction]]:
    """Return the inverse of the linear part of a matrix, exactly."""
    m = [[Fraction(x) for x in row[:3]] for row in rows]

    def cofactor(i: int, j: int) -> Fraction:
        a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        return m[a][c] * m[b][d] - m[a][d] * m[b][c]

    det = sum((m[0][j] * cofactor(0, j) for j in range(3)), Fraction(0))
    return [[cofactor(j, i) / det for j in range(3)] for i in range(3)]


def _unit64(v: Row3) -> Row3:
    squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    scale = 1.0 / math.sqrt(squared) if squared else math.nan
    return v[0] * scale, v[1] * scale, v[2] * scale


def _cross64(a: Row3, b: Row3) -> Row3:
    fma = float32.fma64
    return (
        fma(a[1], b[2], -(a[2] * b[1])),
        fma(a[2], b[0], -(a[0] * b[2])),
        fma(a[0], b[1], -(a[1] * b[0])),
    )
