"""Pixels to a target error: each is split where it must be, and edges are found instead of averaged over.

A cell, at first a pixel, has samples at its four corners, which it shares with its neighbours. Where their paths are
one (the same objects met, on them the same squares of checkerboards and texels of bitmaps, and the same lights seen
at every bounce) and their colours nearly linear, the mean of the corners is its colour, or Simpson's rule with one
sample more in its centre. A cell of two paths has an edge: where that crosses the sides is found by bisection, how it
is bent between by a search across the chord, and each side of it counts by its area, with the colour at its centroid
(`edges`). What does not bear this out is averaged over a few samples where these suffice, or else split in four.

Which cells need more than their corners is decided by the error that is left: cells are refined from the worst down
until the sum of the squares of all that is left meets the target (`water`), and at every depth anew, with what was
seen until then. How far off a cell is, is guessed from its corners (`corners`) or from the samples that look closer.

Things that no corner meets show no error. So pixels next to an edge, and some or all others, are checked by samples
more, the more of them the fewer pixels there are to share the target (`hidden`). Where one finds another colour than
was expected the pixel is split, and the pixels around are checked as well, and those around these.

The target is kept by estimates, not proven; a thing that no sample meets stays unseen.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted import cells
from mitsuba_whitted.cells import Cells, Estimate, Kind, Look, norm
from mitsuba_whitted.corners import from_corners
from mitsuba_whitted.edges import look_closer
from mitsuba_whitted.hidden import around, checks
from mitsuba_whitted.tables import opaque
from mitsuba_whitted.water import Histogram, histogram, levels, water_level

DEPTH = 8
"""How often a pixel can be split: to 1/256."""

SPLIT_AT_ONCE = 1 << 17
"""Cells split in one launch. Each depth keeps so many at most, of some 400 bytes with all that hangs on them."""

# What follows, and in `corners`, `water`, `hidden` and `edges`, was fitted on scenes a, b and c of the benchmark with
# seeds 1 and 2 and on the random scenes 1000 to 1039, then left alone.

FOLLOWED = 8
"""What was hidden is followed over so many pixels."""

MORE_CHECKS = 4
"""Checks there, besides those that a pixel needs anyway."""

AIM = 0.7
"""Aimed at, in parts of the target error, for what is not foreseen."""

LEAST_BUDGET = 0.15
"""Share of the error that the parts of split cells may make at least, should the rest have spent it all."""

SAMPLES, ROW_STEP = 8, 3
"""Of a cell that is averaged over; from each to the next, so many rows down."""

GAIN = SAMPLES**0.75
"""By so much that lowers the error: it falls with this power, as long as edges cross the cell at random."""

OF_HALVES = 0.5
"""Error of such an average, in parts of how much two halves of the samples differ."""


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
    estimate = from_corners(pixels)
    count = width * (bottom - top)
    errors = histogram(estimate, pixels.inside, target)
    of_each = checks(pixels, estimate, errors, target, count)
    _refine(look, pixels, estimate, errors, of_each, target, count * target**2, DEPTH)
    lane = dr.arange(mi.UInt32, dr.width(pixels.inside))
    colour = dr.gather(mi.Vector4f, estimate.value, lane)
    return Band(pixels.i, pixels.j + opaque(mi.UInt32(top)), pixels.inside, colour)


def _follow(look: Look, pixels: Cells, estimate: Estimate, expected: Any, checks: Any, limit: float) -> None:
    """Where something was hidden, look for more of it in the pixels around, and around these."""
    for _ in range(FOLLOWED):
        surprised = pixels.inside & (estimate.error > limit) & ~expected
        if not dr.any(surprised):
            break
        expected |= surprised
        more = around(pixels, surprised) & (estimate.error <= limit)
        _look(look, pixels, estimate, more, checks + MORE_CHECKS, opaque(mi.Float(limit)))


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
        colours = dr.ravel(colour)
        dr.eval(colours)  # else each of the sums would trace anew
        of_cell = SAMPLES * dr.arange(mi.UInt32, count)
        c = [dr.gather(mi.Vector4f, colours, of_cell + k) for k in range(SAMPLES)]
        even, odd = ((c[k] + c[k + 4]) + (c[k + 2] + c[k + 6]) for k in range(2))
        mean = (even + odd) * (1 / SAMPLES)
        before = dr.gather(mi.Float, estimate.error, cell)
        error = norm((even - odd) * (2 / SAMPLES)) * (some.step * some.step) * OF_HALVES
        error = dr.maximum(error, before * (0.5 / GAIN))
        dr.eval(mean, error)
        dr.scatter(estimate.value, mean, cell)
        dr.scatter(estimate.error, error, cell)
        dr.eval(*estimate)


def _look(look: Look, some: Cells, estimate: Estimate, closer: Any, checks: Any, limit: Any) -> None:
    """Look closer kind by kind: the lanes of one vector then take about as many steps."""
    close = dr.compress(closer)
    if dr.width(close):
        kind = dr.gather(mi.UInt32, estimate.kind, close)
        dr.eval(kind)
        order = dr.detail.block_mkperm(kind, dr.width(kind), 4)  # `dr.argsort` would take three passes of this
        close = dr.gather(mi.UInt32, close, order)
        look_closer(look, some, estimate, close, dr.gather(mi.UInt32, checks, close), limit)


def _refine(
    look: Look,
    some: Cells,
    estimate: Estimate,
    errors: Histogram,
    checks: Any,
    target: float,
    budget: float,
    depth: int,
) -> None:
    """Look closer at cells that need it, and split those that need more; updates the estimates.

    `budget` is the sum of the squares of all errors that may be left.
    """
    limit = water_level(errors, target, budget)
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
        settled = histogram(estimate, some.inside & ~wrong, target)
        left = max(budget - float(np.sum(settled * levels(target) ** 2)), LEAST_BUDGET * budget)
    for begin in range(0, count, SPLIT_AT_ONCE):
        size = min(SPLIT_AT_ONCE, count - begin)
        chosen = dr.gather(mi.UInt32, split, dr.arange(mi.UInt32, size) + opaque(mi.UInt32(begin)))
        dr.eval(chosen)
        parts = cells.quarters(look, some, chosen)
        of_parts = from_corners(parts)
        if depth > 1:
            fewer = dr.gather(mi.UInt32, checks, dr.repeat(chosen, 4)) // 2
            dr.eval(fewer)
            of_errors = histogram(of_parts, parts.inside, target)
            _refine(look, parts, of_parts, of_errors, fewer, target, left * size / count, depth - 1)
        part = 4 * dr.arange(mi.UInt32, size)
        mean = sum(dr.gather(mi.Vector4f, of_parts.value, part + k) for k in range(4)) * 0.25
        dr.scatter(estimate.value, mean, chosen)
        dr.eval(estimate.value)
