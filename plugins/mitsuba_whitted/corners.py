"""What the samples at the corners say of a cell: its colour, how many paths it has, and how far off that may be."""

from __future__ import annotations

import itertools
from typing import Any

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells, Estimate, Kind, extent, norm, square
from mitsuba_whitted.tables import opaque
from mitsuba_whitted.water import Histogram, counts, histogram

# Fitted as told in `antialias`.

OF_RANGE = 0.3
"""Error of the mean of the corners where they have several paths, in parts of the colours' range.

Two uniform colours that an edge through a random place parts: 0.29, the standard deviation of a uniform variable.
Below the pixel it also holds for cells of one path: their pixel was split since something is there.
"""

OF_BEND = 1 / 12
"""Error of the mean of the corners of a smooth function, in parts of its second differences (the trapezoidal rule)."""

OF_STEP = OF_RANGE / 2
"""The same in parts of third differences: a step inside the cell makes one of twice its height."""


def from_corners(some: Cells, target: float) -> tuple[Estimate, Histogram]:
    """Estimate each cell from its corners, and what is wrong with that; count these errors."""
    corners = some.corners()
    colours = [some.colour(sample) for sample in corners]
    paths = [some.path(sample) for sample in corners]
    crossed = sum(dr.select(paths[k] != paths[(k + 1) % 4], mi.UInt32(1), 0) for k in range(4))
    # Two crossed sides part the corners into two groups, each of neighbours: then it is two paths.
    edge_or_clutter = dr.select(crossed == 2, mi.UInt32(Kind.EDGE.value), Kind.CLUTTER.value)
    kind = dr.select(crossed == 0, mi.UInt32(Kind.SMOOTH.value), edge_or_clutter)

    low, high = _range_around(some, crossed > 3, *extent(colours))
    of_range = dr.select((crossed != 0) | (some.step < 1), mi.Float(OF_RANGE), 0)
    error = some.step * some.step * dr.maximum(_bend(some, colours), norm(high - low) * of_range)
    count = dr.width(some.x)
    value = dr.empty(mi.Float, 4 * count)
    dr.scatter(value, (colours[0] + colours[1] + colours[2] + colours[3]) * 0.25, dr.arange(mi.UInt32, count))
    estimate = Estimate(value, error, kind, opaque(dr.zeros(mi.UInt32, count)))
    errors = counts(error, kind, some.inside, target)
    arrays = [part for part in some if dr.is_array_v(part)]
    dr.eval(*arrays, *estimate, errors)  # together: one kernel
    return estimate, histogram(errors)


def _range_around(some: Cells, where: Any, low: Any, high: Any) -> tuple[Any, Any]:
    """Widen a range by all samples of the lattice next to the corners: in fine texture those are alike by chance."""

    def widened() -> tuple[Any, Any]:
        # Beyond the lattice its own border is looked at again.
        columns = [mi.UInt32(dr.clip(mi.Int32(some.i) + x, 0, mi.Int32(some.across) - 1)) for x in range(-1, 3)]
        rows = [mi.UInt32(dr.clip(mi.Int32(some.j) + y, 0, mi.Int32(some.down) - 1)) for y in range(-1, 3)]
        first = some.corner - some.j * some.across - some.i
        wide_low, wide_high = low, high
        for x, y in itertools.product(range(4), repeat=2):
            if x in (1, 2) and y in (1, 2):
                continue
            colour = some.colour(first + rows[y] * some.across + columns[x])
            wide_low, wide_high = dr.minimum(wide_low, colour), dr.maximum(wide_high, colour)
        return wide_low, wide_high

    def same() -> tuple[Any, Any]:
        return low, high

    around: tuple[Any, Any] = dr.if_stmt((), where, widened, same, label="range")  # a branch: it is seldom needed
    return around


def _bend(some: Cells, colours: list[Any]) -> Any:
    """Estimate the error by differences along the sides: across and down, each by the largest of those that touch it.

    They are taken over edges too: this is how the cells next to an edge come to a sample in the centre. Where the
    lattice ends, at the border of a band of rows or of a split cell, one of the two second differences at a side is
    missing, and the third, which is that of both: a step shows less there.
    """
    corners = some.corners()

    def along(at: Any, size: Any, stride: Any, sides: tuple[tuple[int, int], ...]) -> Any:
        before, after = at > 0, at + 2 < size
        bend, step = mi.Float(0), mi.Float(0)  # largest squares
        for begin, end in sides:
            first = some.colour(corners[begin] - stride, before) - 2 * colours[begin] + colours[end]
            second = colours[begin] - 2 * colours[end] + some.colour(corners[end] + stride, after)
            bend = dr.maximum(bend, dr.select(before, square(first), 0))
            bend = dr.maximum(bend, dr.select(after, square(second), 0))
            step = dr.maximum(step, dr.select(before & after, square(second - first), 0))
        return dr.sqrt(dr.maximum(OF_BEND**2 * bend, OF_STEP**2 * step))

    across = along(some.i, some.across, 1, ((0, 1), (3, 2)))
    return across + along(some.j, some.down, some.across, ((0, 3), (1, 2)))
