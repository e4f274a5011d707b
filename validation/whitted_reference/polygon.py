"""A plane polygon of any number of rings, by the textbook's crossing test (Shirley et al. 2009, 4.4.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

from whitted_reference import float32, scene
from whitted_reference.arithmetic import FLOAT, Arithmetic
from whitted_reference.errors import SceneError
from whitted_reference.shapes import Primitive, box_of, unit
from whitted_reference.vectors import Number, Vec, add, cross, dot, negated, scaled, sub

FLATNESS = 1e-5  # of the diagonal of the bounding box (model, section 5)
BOW_TIE = 1e-6  # of the squared perimeter: Newell's vector below this is taken to cancel (model, section 5)


class Polygon(Primitive):
    """The part of THE plane whose crossing number over all rings is odd.

    THE plane passes through the mean of the first ring's vertices and is normal to n; the vertices
    themselves only count in projection along the largest component of n.
    """

    __slots__ = ("_flat", "_n", "_sides")

    def __init__(self, shape: scene.Polygon, arithmetic: Arithmetic) -> None:
        rings: list[list[Vec]] = [[arithmetic.vec(v) for v in ring] for ring in shape.rings]
        n, centre = plane(shape, arithmetic)
        size = [abs(x) for x in plane(shape, FLOAT)[0]]
        along = 0 if size[0] >= size[1] and size[0] >= size[2] else 1 if size[1] >= size[2] else 2
        i, j = [axis for axis in range(3) if axis != along]
        self.data = (*centre, *n, i, j)
        self._sides = [side for ring in rings for side in zip(ring, [*ring[1:], ring[0]], strict=True)]
        self._flat = [(a[i], a[j], b[i], b[j]) for a, b in self._sides]  # in projection
        self._n = negated(n) if shape.flip else n
        slack = tolerance(shape.rings)
        points = [v for ring in shape.rings for v in ring]
        self.box = box_of([tuple(x + s * slack for x in v) for v in points for s in (-1, 1)])

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
        """Meet THE plane, then count the sides that a line to the right crosses."""
        cx, cy, cz, nx, ny, nz, i, j = self.data
        slope = dx * nx + dy * ny + dz * nz
        if slope == 0:
            return None
        t = ((cx - ex) * nx + (cy - ey) * ny + (cz - ez) * nz) / slope
        if not start < t <= end:
            return None
        p = (ex + t * dx, ey + t * dy, ez + t * dz)
        return t if self.contains(p[i], p[j]) else None

    def sides(self) -> list[tuple[Vec, Vec]]:
        """Return the two ends of each side of each ring."""
        return self._sides

    def contains(self, x: Number, y: Number) -> bool:
        """Tell whether a projected point is inside: crossings summed over all rings are odd."""
        inside = False
        for ax, ay, bx, by in self._flat:
            if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
                inside = not inside
        return inside

    def normals(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec]:
        """Return n (reversed if flipped) twice."""
        return self._n, self._n


def plane(shape: scene.Polygon, arithmetic: Arithmetic) -> tuple[Vec, Vec]:
    """Return the unit normal n, before any flip, and the mean of the first ring's vertices."""
    ring: list[Vec] = [arithmetic.vec(v) for v in shape.rings[0]]
    centre = scaled(_total(ring), 1 / arithmetic.of(len(ring)))
    if shape.normal is not None:
        given = arithmetic.vec(shape.normal)
        x, y, z = (dot(arithmetic.vec(row), given) for row in shape.to_world.normal)
        return unit((x, y, z), arithmetic), centre
    newell = newell_vector(shape.rings[0])
    if newell is not None:
        around = zip(ring, [*ring[1:], ring[0]], strict=True)
        return unit(_total([cross(sub(a, centre), sub(b, centre)) for a, b in around]), arithmetic), centre
    a, b, c = (arithmetic.vec(v) for v in _first_corner(shape.rings[0]))
    return unit(cross(sub(b, a), sub(c, a)), arithmetic), centre


def newell_vector(ring: Sequence[scene.Floats3]) -> Vec | None:
    """Return Newell's vector (twice the area, along the normal), or None where it cancels."""
    a = ring[0]
    around = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    total = _total([cross(sub(b, a), sub(c, a)) for b, c in around])
    perimeter = sum(math.dist(b, c) for b, c in around)
    return total if math.sqrt(dot(total, total)) >= BOW_TIE * perimeter * perimeter > 0.0 else None


def _first_corner(ring: Sequence[scene.Floats3]) -> tuple[scene.Floats3, scene.Floats3, scene.Floats3]:
    """Return the first three vertices that are not collinear."""
    for a, b, c in combinations(ring, 3):
        if any(cross(sub(b, a), sub(c, a))):
            return a, b, c
    raise SceneError("all vertices of the first ring are collinear")


def tolerance(rings: Sequence[Sequence[scene.Floats3]]) -> float:
    """Return how far a vertex may lie from THE plane: 1e-5 diagonals and 2 ulp of the largest coordinate."""
    points = [v for ring in rings for v in ring]
    x0, y0, z0, x1, y1, z1 = box_of(list(points))
    largest = max(abs(x) for v in points for x in v)
    ulp = 2.0 * float32.ROUNDOFF * 2.0 ** (math.frexp(largest)[1] - 1)
    return FLATNESS * math.dist((x0, y0, z0), (x1, y1, z1)) + 2.0 * ulp


def check(shape: scene.Polygon) -> None:
    """Refuse a polygon that has no plane or leaves it.

    Raises
    ------
    SceneError
        With what is wrong, but not yet where.
    """
    n, centre = plane(shape, FLOAT)
    if not all(map(math.isfinite, n)):
        raise SceneError("the normal is not finite")
    allowed = tolerance(shape.rings)
    for ring in shape.rings:
        for v in ring:
            off = abs(dot(sub(v, centre), n))
            if not off <= allowed:
                raise SceneError(f"vertex {v} is {off:.3g} off the polygon's plane; allowed: {allowed:.3g}")


def _total(vectors: Sequence[Vec]) -> Vec:
    total = vectors[0]
    for v in vectors[1:]:
        total = add(total, v)
    return total
