"""Which primitive does a ray meet first? By asking all of them, or a bounding volume hierarchy.

Both give the same answer bit for bit: the hierarchy works in floats whatever the tracer's arithmetic,
and leaves out only what is certain to be missed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from whitted_reference.arithmetic import Arithmetic
from whitted_reference.shapes import Box, Primitive
from whitted_reference.vectors import Number, Vec

LEAF = 4  # primitives in a leaf: a test of one costs about as much as a test of two boxes
FEW = 8  # up to so many primitives are simply all asked: a hierarchy would not pay

# Boxes are widened by this share of the largest coordinate in the scene, the eye's included. A corner's
# distance along the ray and the distance of a hit are each off by a few 2^-53 of that: a factor of 2^7.
PADDING = 2.0**-44
# Where numbers are only known to lie close to a float, boxes are widened more; a ray that is known no
# better than half of that is tried on all primitives.
WIDE_PADDING = 2.0**-36

Found = tuple[Number, int, Primitive]  # distance, place in the scene's order, primitive

# A node is its box, then the axis at which it is split and its two children, or -1 and the primitives.
Node = tuple[float, float, float, float, float, float, int, Any, Any]


class Everything:
    """All primitives, asked one after the other."""

    def __init__(self, primitives: Sequence[Primitive], arithmetic: Arithmetic) -> None:
        self._primitives = tuple(primitives)
        self._stretch = 1 + arithmetic.closeness

    def hits(self, e: Vec, d: Vec, start: Number, end: Number, leaving: Primitive | None) -> list[Found]:
        """Return the first hit in (start, end], and with it all that are as close but for `closeness`.

        Others, farther away, may be among them. A ray that leaves a primitive at e names it in `leaving`.
        """
        ex, ey, ez = e
        dx, dy, dz = d
        stretch = self._stretch
        found: list[Found] = []
        for primitive in self._primitives:
            if primitive is leaving:
                t = primitive.again(ex, ey, ez, dx, dy, dz, start, end)
            else:
                t = primitive.hit(ex, ey, ez, dx, dy, dz, start, end)
            if t is not None:
                found.append((t, primitive.index, primitive))
                if t * stretch < end:
                    end = t * stretch
        return found

    def blocker(self, e: Vec, d: Vec, start: Number, end: Number, leaving: Primitive | None) -> Found | None:
        """Return some primitive at a distance start < t < end, or None.

        Where there is none for certain but one within `closeness` of the end, that one is returned.
        """
        ex, ey, ez = e
        dx, dy, dz = d
        stretch = self._stretch
        limit = end * stretch
        close = None
        for primitive in self._primitives:
            if primitive is leaving:
                t = primitive.again(ex, ey, ez, dx, dy, dz, start, limit)
            else:
                t = primitive.hit(ex, ey, ez, dx, dy, dz, start, limit)
            if t is not None:
                close = (t, primitive.index, primitive)
                if t * stretch < end:
                    break
        return close


class Hierarchy:
    """Boxes within boxes (Rubin and Whitted 1980), split at the median of the longest side."""

    def __init__(self, primitives: Sequence[Primitive], arithmetic: Arithmetic, reach: float) -> None:
        """Build over primitives; `reach` bounds the coordinates of the eyes outside the boxes."""
        self._primitives = tuple(primitives)
        self._approximate = arithmetic.approximate
        self._spread = arithmetic.spread
        self._stretch = 1 + arithmetic.closeness
        whole = _union([p.box for p in primitives])
        self._reach = max(reach, *(abs(x) for x in whole))
        self._slack = slack = (PADDING if arithmetic.spread is None else WIDE_PADDING) * self._reach
        entries = [(p, [p.box[i] + p.box[i + 3] for i in range(3)]) for p in primitives]
        self._root = _split(entries, slack)

    def hits(self, e: Vec, d: Vec, start: Number, end: Number, leaving: Primitive | None) -> list[Found]:
        """Do as `Everything.hits`."""
        ex, ey, ez = e
        dx, dy, dz = d
        approximate, stretch = self._approximate, self._stretch
        found: list[Found] = []
        limit = [approximate(end)]
        for primitive in self._candidates(e, d, limit):
            if primitive is leaving:
                t = primitive.again(ex, ey, ez, dx, dy, dz, start, end)
            else:
                t = primitive.hit(ex, ey, ez, dx, dy, dz, start, end)
            if t is not None:
                found.append((t, primitive.index, primitive))
                if t * stretch < end:
                    end = t * stretch
                    limit[0] = approximate(end)
        return found

    def blocker(self, e: Vec, d: Vec, start: Number, end: Number, leaving: Primitive | None) -> Found | None:
        """Do as `Everything.blocker`, though perhaps with another one of several."""
        ex, ey, ez = e
        dx, dy, dz = d
        stretch = self._stretch
        limit = end * stretch
        close = None
        for primitive in self._candidates(e, d, [self._approximate(limit)]):
            if primitive is leaving:
                t = primitive.again(ex, ey, ez, dx, dy, dz, start, limit)
            else:
                t = primitive.hit(ex, ey, ez, dx, dy, dz, start, limit)
            if t is not None:
                close = (t, primitive.index, primitive)
                if t * stretch < end:
                    break
        return close

    def _candidates(self, e: Vec, d: Vec, limit: list[float]) -> Iterable[Primitive]:
        """Return what the ray can meet; all primitives for a ray that is not known well enough."""
        if self._spread is not None:
            # No point of a box is farther than 4 reach.
            off = max(map(self._spread, e)) + 4.0 * self._reach * max(map(self._spread, d))
            if not off <= 0.5 * self._slack:
                return self._primitives
        return self._near(e, d, limit)

    def _near(self, e: Vec, d: Vec, limit: list[float]) -> Iterator[Primitive]:
        """Yield the primitives of all leaves that the ray meets before limit[0], which may shrink."""
        ox, oy, oz = map(self._approximate, e)
        ix, iy, iz = (_reciprocal(self._approximate(x)) for x in d)
        forward = (ix > 0.0, iy > 0.0, iz > 0.0)
        stack = [self._root]
        while stack:
            x0, y0, z0, x1, y1, z1, axis, left, right = stack.pop()
            if ix > 0.0:
                near, far = (x0 - ox) * ix, (x1 - ox) * ix
            else:
                near, far = (x1 - ox) * ix, (x0 - ox) * ix
            if iy > 0.0:
                low, high = (y0 - oy) * iy, (y1 - oy) * iy
            else:
                low, high = (y1 - oy) * iy, (y0 - oy) * iy
            if low > near:
                near = low
            if high < far:
                far = high
            if near > far:
                continue
            if iz > 0.0:
                low, high = (z0 - oz) * iz, (z1 - oz) * iz
            else:
                low, high = (z1 - oz) * iz, (z0 - oz) * iz
            if low > near:
                near = low
            if high < far:
                far = high
            if near > far or far < 0.0 or near > limit[0]:
                continue
            if axis < 0:
                yield from left
            elif forward[axis]:
                stack += (right, left)
            else:
                stack += (left, right)


def _reciprocal(x: float) -> float:
    return 1.0 / x if x else 1e300  # a ray along a box's side: 0 * 1e300 is 0, and the side counts


def hierarchy_or_everything(
    primitives: Sequence[Primitive], arithmetic: Arithmetic, reach: float, hierarchy: bool
) -> Everything | Hierarchy:
    """Choose by number, unless the hierarchy is not wanted."""
    if hierarchy and len(primitives) > FEW:
        return Hierarchy(primitives, arithmetic, reach)
    return Everything(primitives, arithmetic)


def _split(entries: list[tuple[Primitive, list[float]]], slack: float) -> Node:
    x0, y0, z0, x1, y1, z1 = _union([p.box for p, _ in entries])
    box = (x0 - slack, y0 - slack, z0 - slack, x1 + slack, y1 + slack, z1 + slack)
    if len(entries) <= LEAF:
        return (*box, -1, tuple(p for p, _ in entries), None)
    spans = [max(c[i] for _, c in entries) - min(c[i] for _, c in entries) for i in range(3)]
    axis = spans.index(max(spans))
    entries.sort(key=lambda entry: entry[1][axis])
    middle = len(entries) // 2
    return (*box, axis, _split(entries[:middle], slack), _split(entries[middle:], slack))


def _union(boxes: Sequence[Box]) -> Box:
    least = [min(box[i] for box in boxes) for i in range(3)]
    most = [max(box[i + 3] for box in boxes) for i in range(3)]
    return least[0], least[1], least[2], most[0], most[1], most[2]
