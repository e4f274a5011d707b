"""Pixels to a target error: each is split where it must be, and edges are found instead of averaged over.

A cell, at first a pixel, has samples at its four corners, which it shares with its neighbours. Where their paths are
one (the same objects met, the same squares of checkerboards and the same lights seen at every bounce) and their
colours nearly linear, the mean of the corners is its colour, or Simpson's rule with one sample more in its centre. A
cell of two paths has an edge: where that crosses the sides is found by bisection, how it is bent between by a search
across the chord, and each side of it counts by its area, with the colour at its centroid (`edges`). Whatever does not
bear this out is split in four.

Which cells need more than their corners is decided by the error that is left: cells are refined from the worst down
until the sum of the squares of all that is left meets the target (water-filling), and at every depth anew, with
what was seen until then. A picture full of edges is drawn with a plain grid instead, as fine as it takes.

The target is kept by estimates, not proven; a thing that no sample meets stays unseen. Most such things lie next to
an edge: cells there get a sample in the centre.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted import cells
from mitsuba_whitted.cells import Cells, Estimate, Kind, Look, norm
from mitsuba_whitted.edges import look_closer
from mitsuba_whitted.tables import opaque

DEPTH = 8
"""How often a pixel can be split: to 1/256."""

SPLIT_AT_ONCE = 1 << 17
"""Cells split in one launch. Each depth keeps so many at most, of some 400 bytes with all that hangs on them."""

# What follows, and in `edges`, was fitted on scenes a, b and c of the benchmark with seeds 1 and 2, then left alone.

OF_RANGE = 0.3
"""Error of the mean of the corners where they have several paths, in parts of the colours' range.

Two uniform colours that an edge through a random place parts: 0.29, the standard deviation of a uniform variable.
Below the pixel it also holds for cells of one path: their pixel was split since something is there.
"""


OF_CLUTTER = 0.5
"""The same of cells with more than two: samples that have nothing to do with each other are off by 0.5 of their range,
as neighbours are by the same corners.
"""

OF_BEND = 1 / 12
"""Error of the mean of the corners of a smooth function, in parts of its second differences (the trapezoidal rule)."""

OF_STEP = OF_RANGE / 2
"""The same in parts of third differences: a step inside the cell makes one of twice its height."""

LEFT = np.array([0.8, 0.3, 0.7])
"""Error that a cell of each kind is left with, in parts of the limit to which it is refined."""

NEAR, FAR, FARTHEST, MOST_CHECKS = 1.0, 0.25, 2, 32

FOLLOWED, MORE_CHECKS = 8, 4

AIM = 0.8
"""Aimed at, in parts of the target error, for what is not foreseen."""

LEAST_BUDGET = 0.15
"""Share of the error that the parts of split cells may make at least, should the rest have spent it all."""

SAMPLES, ROW_STEP = 8, 3
"""Of a cell that is averaged over; from each to the next, so many rows down."""

GAIN = SAMPLES**0.75
"""By so much that lowers the error: it falls with this power, as long as edges cross the cell at random."""

OF_HALVES = 0.5
"""Error of such an average, in parts of how much two halves of the samples differ."""

OCTAVES_BELOW, STEPS, BINS = 8, 4, 96
"""Errors are counted from so many octaves below the target, in so many steps an octave."""


class Band(NamedTuple):
    """Rows of the picture, pixel by pixel in an order of their own."""

    x: Any
    """Column in the crop window."""
    y: Any
    inside: Any
    """Whether the lane holds a pixel at all."""
    colour: Any
    """Vector4f: colour and alpha."""


def refined(look: Look, width: int, top: int, bottom: int, target: float) -> Band:
    """Draw rows of the picture with a root mean square error of about `target` at most.

    Parameters
    ----------
    look
        Follows camera rays.
    width, top, bottom : int
        Of the crop window; the first row, and the first that is not drawn.
    target : float
        Linear radiance, over all pixels and channels of these rows.
    """
    target *= AIM
    pixels = cells.pixels(look, width, top, bottom)
    estimate = _from_corners(pixels)
    count = width * (bottom - top)
    histogram = _histogram(estimate, pixels.inside, target)
    checks = _checks(pixels, estimate, histogram, target, count)
    _refine(look, pixels, estimate, checks, target, count * target**2, DEPTH)
    lane = dr.arange(mi.UInt32, dr.width(pixels.inside))
    colour = dr.gather(mi.Vector4f, estimate.value, lane)
    return Band(pixels.i, pixels.j + opaque(mi.UInt32(top)), pixels.inside, colour)


def _checks(pixels: Cells, estimate: Estimate, histogram: NDArray[np.float64], target: float, count: int) -> Any:
    """Say how many samples each pixel needs so that nothing that matters may hide in it."""
    mixed = histogram[Kind.EDGE :]
    contrast = math.sqrt(np.sum(mixed * _levels(target) ** 2) / max(mixed.sum(), 1)) / OF_RANGE
    worst = contrast / (target * math.sqrt(count))
    near, far = (min(share * worst, MOST_CHECKS) for share in (NEAR, FAR))
    every = math.ceil(1 / far) if far * FARTHEST > 1 else 0
    some = (pixels.i + 2 * pixels.j) % opaque(mi.UInt32(max(every, 1))) == 0
    of_far = dr.select(some, opaque(mi.UInt32(math.ceil(far) if every else 0)), 0)
    checks = dr.select(_around(pixels, estimate.kind != Kind.SMOOTH.value), opaque(mi.UInt32(int(near))), of_far)
    dr.eval(checks)
    return checks


def _around(pixels: Cells, some: Any) -> Any:
    """Mark pixels that touch one of these, and those themselves."""
    across, down = pixels.across - 1, pixels.down - 1
    marked = dr.zeros(mi.Bool, pixels.samples)
    dr.scatter(marked, mi.Bool(True), pixels.j * across + pixels.i, some & pixels.inside)
    found = mi.Bool(False)
    for x in range(-1, 2):
        for y in range(-1, 2):
            i, j = mi.Int32(pixels.i) + x, mi.Int32(pixels.j) + y
            there = pixels.inside & (i >= 0) & (j >= 0) & (i < mi.Int32(across)) & (j < mi.Int32(down))
            found |= dr.gather(mi.Bool, marked, mi.UInt32(j) * across + mi.UInt32(i), there)
    return found


def _follow(look: Look, pixels: Cells, estimate: Estimate, expected: Any, checks: Any, limit: float) -> None:
    """Where something was hidden, look for more of it in the pixels around, and around these."""
    for _ in range(FOLLOWED):
        surprised = pixels.inside & (estimate.error > limit) & ~expected
        if not dr.any(surprised):
            break
        expected |= surprised
        around = _around(pixels, surprised) & (estimate.error <= limit)
        _look(look, pixels, estimate, around, checks + MORE_CHECKS, opaque(mi.Float(limit)))


def _average(look: Look, some: Cells, estimate: Estimate, chosen: Any) -> None:
    """Take SAMPLES in each of these cells: a lattice that has one in each of so many columns, and rows.

    How much every other of them differs from the rest tells how far off they are.
    """
    for begin in range(0, dr.width(chosen), SPLIT_AT_ONCE):
        count = min(SPLIT_AT_ONCE, dr.width(chosen) - begin)
        cell = dr.gather(mi.UInt32, chosen, dr.arange(mi.UInt32, count) + opaque(mi.UInt32(begin)))
        lane = dr.arange(mi.UInt32, count * SAMPLES)
        here = some.some(dr.gather(mi.UInt32, cell, lane // SAMPLES))
        k = lane % SAMPLES
        x, y = ((mi.Float(part) + 0.5) * (1 / SAMPLES) for part in (k, ROW_STEP * k % SAMPLES))
        colour, _ = look(dr.fma(x, here.step, here.x), dr.fma(y, here.step, here.y), mi.Bool(True))
        apart = mi.Vector4f(dr.select(k % 2 == 0, colour, -colour))
        dr.eval(colour, apart)  # else each of the sums would trace anew
        mean = mi.Vector4f(*(dr.block_sum(channel, SAMPLES) * (1 / SAMPLES) for channel in colour))
        halves = mi.Vector4f(*(dr.block_sum(channel, SAMPLES) * (2 / SAMPLES) for channel in apart))
        before = dr.gather(mi.Float, estimate.error, cell)
        error = dr.maximum(norm(halves) * (some.step * some.step) * OF_HALVES, before * (0.5 / GAIN))
        dr.eval(mean, error)
        dr.scatter(estimate.value, mean, cell)
        dr.scatter(estimate.error, error, cell)
        dr.eval(*estimate)


def _look(look: Look, some: Cells, estimate: Estimate, closer: Any, checks: Any, limit: Any) -> None:
    """Look closer kind by kind: the lanes of one vector then take about as many steps."""
    by_kind: list[Any] = [dr.compress(closer & (estimate.kind == kind.value)) for kind in Kind]
    by_kind = [numbers for numbers in by_kind if dr.width(numbers)]
    if by_kind:
        close = dr.concat(by_kind)
        look_closer(look, some, estimate, close, dr.gather(mi.UInt32, checks, close), limit)


def _refine(
    look: Look, some: Cells, estimate: Estimate, checks: Any, target: float, budget: float, depth: int
) -> None:
    """Look closer at cells that need it, and split those that need more; updates the estimates.

    `budget` is the sum of the squares of all errors that may be left.
    """
    limit = _water_level(_histogram(estimate, some.inside, target), target, budget)
    seen = opaque(mi.Float(limit))
    expected = (estimate.error > limit) & some.inside
    clutter = estimate.kind == Kind.CLUTTER.value
    closer = dr.select(clutter, ~expected, expected | (checks > 0)) & some.inside
    _look(look, some, estimate, closer, checks, seen)
    if depth == DEPTH:
        _follow(look, some, estimate, expected | clutter, checks, limit)
    wrong = (estimate.error > limit) & some.inside
    averaged = dr.compress(wrong & (estimate.error <= GAIN * limit))
    if dr.width(averaged):
        _average(look, some, estimate, averaged)
        wrong = (estimate.error > limit) & some.inside
    split = dr.compress(wrong)
    count = dr.width(split)
    if count:
        settled = _histogram(estimate, some.inside & ~wrong, target)
        left = max(budget - float(np.sum(settled * _levels(target) ** 2)), LEAST_BUDGET * budget)
    for begin in range(0, count, SPLIT_AT_ONCE):
        size = min(SPLIT_AT_ONCE, count - begin)
        chosen = dr.gather(mi.UInt32, split, dr.arange(mi.UInt32, size) + opaque(mi.UInt32(begin)))
        dr.eval(chosen)
        parts = cells.quarters(look, some, chosen)
        of_parts = _from_corners(parts)
        if depth > 1:
            fewer = dr.gather(mi.UInt32, checks, dr.repeat(chosen, 4)) // 2
            dr.eval(fewer)
            _refine(look, parts, of_parts, fewer, target, left * size / count, depth - 1)
        part = 4 * dr.arange(mi.UInt32, size)
        mean = sum(dr.gather(mi.Vector4f, of_parts.value, part + k) for k in range(4)) * 0.25
        dr.scatter(estimate.value, mean, chosen)
        dr.eval(estimate.value)


def _from_corners(some: Cells) -> Estimate:
    """Estimate each cell from its corners, and what is wrong with that."""
    corners = some.corners()
    colours = [some.colour(sample) for sample in corners]
    paths = [some.path(sample) for sample in corners]
    crossed = sum(dr.select(paths[k] != paths[(k + 1) % 4], mi.UInt32(1), 0) for k in range(4))
    # Two crossed sides part the corners into two groups, each of neighbours: then it is two paths.
    edge_or_clutter = dr.select(crossed == 2, mi.UInt32(Kind.EDGE.value), Kind.CLUTTER.value)
    kind = dr.select(crossed == 0, mi.UInt32(Kind.SMOOTH.value), edge_or_clutter)

    low = dr.minimum(dr.minimum(colours[0], colours[1]), dr.minimum(colours[2], colours[3]))
    high = dr.maximum(dr.maximum(colours[0], colours[1]), dr.maximum(colours[2], colours[3]))
    several = crossed > 3
    for x in range(-1, 3):
        for y in range(-1, 3):
            if not (0 <= x <= 1 and 0 <= y <= 1):
                i, j = mi.Int32(some.i) + x, mi.Int32(some.j) + y
                there = several & (i >= 0) & (j >= 0) & (i < mi.Int32(some.across)) & (j < mi.Int32(some.down))
                sample = mi.UInt32(mi.Int32(some.corner) + x + y * mi.Int32(some.across))
                colour = dr.gather(mi.Vector4f, some.colours, sample, there)
                low, high = dr.select(there, dr.minimum(low, colour), low), dr.select(there, dr.maximum(high, colour), high)
    of_range = dr.select((crossed != 0) | (some.step < 1), mi.Float(OF_RANGE), 0)
    of_range = dr.select(crossed > 2, OF_CLUTTER, of_range)
    error = some.step * some.step * dr.maximum(_bend(some), norm(high - low) * of_range)
    count = dr.width(some.x)
    value = dr.empty(mi.Float, 4 * count)
    dr.scatter(value, (colours[0] + colours[1] + colours[2] + colours[3]) * 0.25, dr.arange(mi.UInt32, count))
    estimate = Estimate(value, error, kind)
    dr.eval(*estimate)
    return estimate


def _bend(some: Cells) -> Any:
    """Estimate the error by differences along the sides: across and down, each by the largest of those that touch it.

    They are taken over edges too: this is how the cells next to an edge come to a sample in the centre.
    """

    def along(at: Any, size: Any, stride: Any, to_other_side: Any) -> Any:
        first = mi.UInt32(dr.clip(mi.Int32(at) - 1, 0, dr.maximum(mi.Int32(size) - 4, 0)))
        bend = mi.Float(0)
        for side in range(2):
            begin = some.corner - at * stride + first * stride + side * to_other_side
            c = [dr.gather(mi.Vector4f, some.colours, begin + n * stride, first + n < size) for n in range(4)]
            bends = [dr.select(first + n + 2 < size, c[n] - 2 * c[n + 1] + c[n + 2], 0) for n in range(2)]
            bend = dr.maximum(bend, OF_BEND * dr.maximum(norm(bends[0]), norm(bends[1])))
            bend = dr.maximum(bend, OF_STEP * dr.select(first + 3 < size, norm(bends[1] - bends[0]), 0))
        return bend

    one = mi.UInt32(1)
    return along(some.i, some.across, one, some.across) + along(some.j, some.down, some.across, one)


def _histogram(estimate: Estimate, active: Any, target: float) -> NDArray[np.float64]:
    """Count the errors of each kind of cell, (3, BINS); those too small to matter are left out.

    Whole numbers: their sum does not depend on the order in which threads come.
    """
    octaves = dr.log2(estimate.error / opaque(mi.Float(target))) + OCTAVES_BELOW
    counts = dr.zeros(mi.UInt32, 3 * BINS)
    place = mi.UInt32(dr.clip(STEPS * octaves, 0, BINS - 1))
    dr.scatter_add(counts, mi.UInt32(1), estimate.kind * BINS + place, active & (octaves >= 0))
    return np.array(counts, dtype=np.float64).reshape(3, BINS)


def _levels(target: float) -> NDArray[np.float64]:
    """Errors that the places of a histogram stand for."""
    levels: NDArray[np.float64] = target * 2.0 ** ((np.arange(BINS) + 0.5) / STEPS - OCTAVES_BELOW)
    return levels


def _water_level(histogram: NDArray[np.float64], target: float, budget: float) -> float:
    """Find the error above which cells are refined, so that all that is left meets the budget."""
    levels = _levels(target)
    left = [np.sum(histogram * np.minimum(levels, LEFT[:, None] * limit) ** 2) for limit in levels]
    return float(levels[max(int(np.searchsorted(left, budget)) - 1, 0)])
