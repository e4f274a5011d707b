"""Pixels to a target error: each is split where it must be, and edges are found instead of averaged over.

A cell, at first a pixel, has samples at its four corners, which it shares with its neighbours. Where their paths are
one (the same objects met on the same side, on them the same squares of checkerboards and texels of bitmaps, and the
same lights seen at every bounce) and their colours nearly linear, the mean of the corners is its colour, or Simpson's
rule with one sample more in its centre. A cell of two paths has an edge: where that crosses the sides is found by
bisection (`crossings`), how it is bent between by a search across the chord, and each side of it counts by its area,
with the colour at its centroid (`parts`, `edges`). What does not bear this out is averaged over its corners and a few
samples where these suffice, or else split in four. Once so little is left that all of it can be averaged over in the
time that another split would take, it is.

Which cells need more than their corners is decided by the error that is left: cells are refined from the worst down
until the sum of the squares of all that is left meets the target (`water`), and at every depth anew, with what was
seen until then. How far off a cell is, is guessed from its corners (`corners`) or from the samples that look closer.

An average shows by two halves of its samples how far off it is: where that is too much, it is taken again with more,
or the cell is split, whichever takes less (`averages`), unless something hides there.

Things that no corner meets show no error. So pixels next to an edge, and some or all others, are checked by samples
more, the more of them the fewer pixels there are to share the target (`hidden`). Where one finds another colour than
was expected in a pixel of one path, the pixels around are checked next to that place, and those around these
(`places`). Something hides there (`Estimate.met`): the pixel is averaged over and never split, since its parts may miss
it. What does not hide is split like anything else; each part gets half of its pixel's checks.

The target is kept by estimates, not proven; a thing that no sample meets stays unseen.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted import cells
from mitsuba_whitted.averages import IN_PARTS, OF_KIND, average, average_to, fitted, needed, suffice
from mitsuba_whitted.cells import Cells, Estimate, Kind, Look
from mitsuba_whitted.corners import from_corners
from mitsuba_whitted.edges import look_closer
from mitsuba_whitted.hidden import checks, enough, largest_around
from mitsuba_whitted.places import CENTRE, following
from mitsuba_whitted.tables import opaque
from mitsuba_whitted.water import FROM, LEAST_SAMPLES, UNTOUCHED, Histogram, water_level

DEPTH = 8
"""How often a pixel can be split: to 1/256."""

SPLIT_AT_ONCE = 1 << 17
"""Cells split in one launch. Each depth keeps so many at most, of some 400 bytes with all that hangs on them."""

# What follows, and in `averages`, `corners`, `crossings`, `edges`, `hidden`, `places` and `water`, was fitted on scenes
# a, b and c of the benchmark with seeds 1, 2, 11, 12, 13, 5001 to 5007, 370324, 74491549, 213369292, 365176546 to
# 365176548, 512702197 to 512702199, 1067804698, 1067804699, 1341771531 to 1341771539, 1609383547 to 1609383549,
# 1623437828, 2492251788 to 2492251790, 3152881891, 3152881893, 3495634084, 3495634085, 3703242033 and 4079497358 to
# 4079497366, and on the random scenes 1000 to 1039, 7000 to 7031, 845204831 to 845204862, 1192772526 to 1192772557,
# 1478252036 to 1478252067, 2319633131 to 2319633160, 2544530961 to 2544530992, 2648890011 to 2648890040, 2914742474 to
# 2914742505, 3373375790 to 3373375821, 4161697205 to 4161697236 and 4180968911 to 4180968942, then left alone.

EVERY = 5
"""Of clutter that seems to be within the limit, such as a texture that is alike at the corners by its period, one pixel
in so many is checked: every other one touches such a pixel, and is followed from there. Below, it is one part of four.
"""

FOLLOWED = 8
"""What was hidden is followed over so many pixels."""

WORTH_FOLLOWING = 10.0
"""As long as the squares of the errors that it made in the last ones come to more than so many times the budget: in the
next it is likely to make as much. They are guessed as if an edge went through a random place, and what no corner has
met is much smaller.
"""

AIM = 0.6
"""Aimed at, in parts of the target error, for what is not foreseen."""

SMALLEST, LARGEST = 2.0**-100, 2.0**100
"""Targets beyond ask for the same, all or nothing; their squares and quotients would leave the range of numbers."""

LEAST_BUDGET = 0.15
"""Share of the error that the parts of split cells may make at least, should the rest have spent it all."""


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
    target = min(max(target * AIM, SMALLEST), LARGEST)
    pixels = cells.pixels(look, width, top, bottom)
    estimate, errors = from_corners(pixels, target)
    count = width * (bottom - top)
    of_each = checks(pixels, estimate, errors, target, count)
    _refine(look, pixels, estimate, errors, of_each, target, count * target**2, DEPTH)
    lane = dr.arange(mi.UInt32, dr.width(pixels.inside))
    colour = dr.gather(mi.Vector4f, estimate.value, lane)
    return Band(pixels.i, pixels.j + opaque(mi.UInt32(top)), pixels.inside, colour)


def _follow(look: Look, pixels: Cells, estimate: Estimate, known: Any, limit: Any, budget: float) -> None:
    """Where something was hidden, and not `known`, look for more of it in the pixels around, and around these."""
    for _ in range(FOLLOWED):
        new = pixels.inside & (estimate.error > limit) & ~known
        found = dr.select(new, estimate.error, 0)
        if not float(dr.sum(found * found)[0]) > WORTH_FOLLOWING * budget:
            break
        known |= new
        places = dr.select(estimate.surprise > 0, estimate.place(), CENTRE)
        most, way = largest_around(pixels, mi.Float(dr.select(new, places, 0)))
        follow = dr.select(estimate.error <= limit, following(mi.UInt32(most), way), 0)
        checks = enough(largest_around(pixels, found)[0], budget)
        dr.eval(known, follow, checks)  # else every round would be another kernel
        _look(look, pixels, estimate, follow > 0, checks, follow, limit)


def _look(look: Look, some: Cells, estimate: Estimate, closer: Any, checks: Any, follow: Any, limit: Any) -> None:
    """Look closer at the cells that need it, if there are any."""
    close = cells.picked(closer, estimate.kind == Kind.EDGE.value)
    if dr.width(close):
        checks, follow = dr.gather(mi.UInt32, checks, close), dr.gather(mi.UInt32, follow, close)
        look_closer(look, some, estimate, close, checks, follow, limit)


def _left(estimate: Estimate, done: Any, share: Any, budget: float) -> float:
    """Tell what of the budget is left by the cells that are done, each with its `share` of what is estimated."""
    settled = dr.select(done & dr.isfinite(estimate.error), estimate.error * share, 0)
    return max(budget - float(dr.sum(settled * settled)[0]), LEAST_BUDGET * budget)


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
    """Look closer at cells that need it, and average over or split those that need more; updates the estimates.

    `budget` is the sum of the squares of all errors that may be left.
    """
    level = water_level(errors, target, budget)
    limit = opaque(mi.Float(level))  # as data: each picture has another
    smooth, clutter = (estimate.kind == kind.value for kind in (Kind.SMOOTH, Kind.CLUTTER))
    expected = (estimate.error > dr.select(smooth, FROM[Kind.SMOOTH] * limit, limit)) & some.inside
    checked = (checks > 0) | (clutter & ((some.i + 2 * some.j) % EVERY == 0))
    closer = (expected | checked) & ~(clutter & expected) & some.inside
    _look(look, some, estimate, closer, checks, opaque(dr.zeros(mi.UInt32, dr.width(checks))), limit)
    if depth == DEPTH:  # an edge that was not found is no surprise, even where it hides more; what one path hides is
        known = expected & ~estimate.surprised()
        _follow(look, some, estimate, known, limit, budget)
    unfit = (estimate.error > limit) & some.inside
    wrong = dr.compress(unfit)
    if not dr.width(wrong):
        return
    untouched = dr.select(smooth, mi.Float(UNTOUCHED[Kind.SMOOTH]), UNTOUCHED[Kind.EDGE])  # clutter in full
    share = dr.select(expected | clutter | unfit, 1, untouched)
    left = _left(estimate, some.inside & ~unfit, share, budget)
    of_wrong = estimate.some(wrong)
    parts = wrong, of_wrong.error, of_wrong.kind, of_wrong.hides()
    dr.eval(parts)  # together: one kernel
    numbers, guessed, kinds, hides = map(np.array, parts)
    del of_wrong, parts  # or what they are picked from would be copied where it is written over
    guessed *= OF_KIND[kinds]
    if depth < DEPTH:
        guessed *= IN_PARTS
    samples = fitted(needed(guessed, hides, level), guessed, left)
    if suffice(samples):
        above = average_to(look, some, estimate, numbers, samples, guessed, hides, left)
        if above is None:
            return
    else:
        few = (samples <= LEAST_SAMPLES) | hides  # what hides at any cost: parts of a cell may miss it
        average(look, some, estimate, numbers[few], samples[few], guessed[few])
        above = level
    unfit &= (estimate.error > opaque(mi.Float(above))) & ~estimate.hides()
    split = dr.compress(unfit)
    count, left = dr.width(split), _left(estimate, some.inside & ~unfit, share, budget)
    for begin in range(0, count, SPLIT_AT_ONCE):
        chosen = dr.arange(mi.UInt32, min(SPLIT_AT_ONCE, count - begin)) + opaque(mi.UInt32(begin))
        chosen = dr.gather(mi.UInt32, split, chosen)
        dr.eval(chosen)
        _split(look, some, estimate, chosen, checks, target, left * dr.width(chosen) / count, depth)


def _split(
    look: Look, some: Cells, estimate: Estimate, chosen: Any, checks: Any, target: float, budget: float, depth: int
) -> None:
    """Draw the parts of these cells instead."""
    parts = cells.quarters(look, some, chosen)
    of_parts, errors = from_corners(parts, target)
    if depth > 1:
        fewer = dr.gather(mi.UInt32, checks, dr.repeat(chosen, 4)) // 2
        dr.eval(fewer)
        _refine(look, parts, of_parts, errors, fewer, target, budget, depth - 1)
    part = 4 * dr.arange(mi.UInt32, dr.width(chosen))
    mean = sum(dr.gather(mi.Vector4f, of_parts.value, part + k) for k in range(4)) * 0.25
    dr.eval(mean)  # else all of what is written over would be copied
    dr.scatter(estimate.value, mean, chosen)
    dr.eval(estimate.value)
