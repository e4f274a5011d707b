"""Cells that are averaged over: with how many samples, how far off the mean is, and with more where that is too far."""

from __future__ import annotations

import itertools
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.cells import Cells, Estimate, Kind, Look, norm
from mitsuba_whitted.lattices import of_corners, point
from mitsuba_whitted.tables import owned
from mitsuba_whitted.water import FALL, LEAST_SAMPLES, UNTOUCHED, foreseen, samples_for

# Fitted as told in `antialias`.

OF_LAUNCHES = 1 << 15
"""So many samples are taken rather than that cells are split, however few these are. The launches of a split take as
long as more, where few shapes are tried one by one, but rays count too.
"""

OF_PARTS = 30
"""Samples that a cell takes when it is split: five for its parts, the others inside them."""

AT_ONCE = 1 << 20
"""Samples of averages in one launch, of some 100 bytes each; it may be MOST_SAMPLES more, since no cell is divided."""

MOST_SAMPLES = 1 << 18
"""Of a cell, whatever its error."""

OF_HALVES = 0.4
"""Error of such an average, in parts of how much the means of two halves of the samples differ; of straight edges it is
0.3 (`lattices`), but halves may also agree by chance.
"""

FORESEEN = 0.5
"""Of an error that two halves show, which may be small or large by chance, this part stays as it was foreseen: of the
error at least, of its square in the mean.
"""

UNSEEN = 2.0
"""Where the corners have one path averages are further off by this factor: what is in between, a step or something that
hides, is mostly small, and samples miss it.
"""

OF_KIND = np.array([UNSEEN, 1.0, UNTOUCHED[Kind.CLUTTER]], np.float32)
"""What errors of averages are foreseen from, in parts of what is estimated at the corners; by kind."""

IN_PARTS = 1.5
"""In parts of pixels averages are further off by this factor, since pixels are split where something is finer than
their corners tell; in fine texture by less. Where they have one path, by both factors; the water level knows of
neither.
"""

OF_HIDDEN = 16
"""Samples where something hides at least, before all are fitted, be it to fewer: what one of some checks met is small,
and few may miss it again.
"""

TOLERANCE = 1.3
"""Errors measured together may be above those asked for by this factor: the measure is no better."""

MOST_AGAIN = 2
"""So often are averages taken again with more samples."""

MOST_MORE = 4
"""With so many times the samples at most."""


def needed(errors: NDArray[np.float32], hides: NDArray[np.bool_], limit: float) -> NDArray[np.uint32]:
    """Count the samples that cells with these errors are averaged over at this limit; for each an even number.

    Where the error is not finite no number of them is right: most are counted, so that the cell is rather split; where
    something hides, which is never split, the least.
    """
    counts = samples_for(errors.astype(float), limit)
    of_hidden = np.where(np.isfinite(errors), np.maximum(counts, OF_HIDDEN), OF_HIDDEN)
    return _even(np.where(hides, of_hidden, counts))


def fitted(counts: NDArray[np.uint32], errors: NDArray[np.float32], budget: float) -> NDArray[np.uint32]:
    """Take more samples or fewer, all by one factor, so that the squares of the errors foreseen come to the budget.

    Where the error is not finite the count stays.
    """
    left = foreseen(errors.astype(float), counts.astype(float))
    finite = np.isfinite(left)
    factor = (float(np.sum(left[finite] ** 2)) / budget) ** (0.5 / FALL)
    return _even(np.maximum(LEAST_SAMPLES, np.where(finite, counts * factor, counts)))


def _even(counts: NDArray[Any]) -> NDArray[np.uint32]:
    found: NDArray[np.uint32] = 2 * np.ceil(0.5 * np.minimum(counts, MOST_SAMPLES)).astype(np.uint32)
    return found


def suffice(counts: NDArray[np.uint32]) -> bool:
    """Tell whether averages of so many samples are rather taken than the cells split."""
    return int(counts.sum(dtype=np.int64)) <= OF_LAUNCHES + OF_PARTS * len(counts)


def average(
    look: Look,
    some: Cells,
    estimate: Estimate,
    chosen: NDArray[np.uint32],
    counts: NDArray[np.uint32],
    guessed: NDArray[np.float32],
) -> None:
    """Take the mean of so many samples in each of these cells; `counts` are even.

    How much every other of them differs from the rest tells how far off their mean is; `guessed` are the errors that
    were estimated without any.
    """
    ends = np.cumsum(counts, dtype=np.int64)
    begins = np.searchsorted(ends, np.arange(0, counts.sum(dtype=np.int64), AT_ONCE), side="right")
    begins = np.unique(begins)  # a cell of more than AT_ONCE is found again and again
    for begin, end in itertools.pairwise([*begins.tolist(), len(counts)]):
        batch = slice(begin, end)
        _average(look, some, estimate, owned(chosen[batch]), owned(counts[batch]), owned(guessed[batch]))


def _average(look: Look, some: Cells, estimate: Estimate, chosen: Any, counts: Any, guessed: Any) -> None:
    """Do so in one launch."""
    ends = dr.cumsum(counts)
    first, width = ends - counts, dr.width(chosen)
    samples = int(ends[width - 1])
    begins = dr.zeros(mi.UInt32, samples)
    dr.scatter(begins, mi.UInt32(1), first, dr.arange(mi.UInt32, width) > 0)
    cell = dr.cumsum(begins)
    here = some.some(dr.gather(mi.UInt32, chosen, cell))
    k = dr.arange(mi.UInt32, samples) - dr.gather(mi.UInt32, first, cell)
    at = point(k, dr.gather(mi.UInt32, counts, cell))
    colour, _ = look(dr.fma(at.x, here.step, here.x), dr.fma(at.y, here.step, here.y), mi.Bool(True))
    colours = dr.ravel(colour)
    dr.eval(colours)  # else the sums would trace anew

    def add(k: Any, even: Any, odd: Any) -> Any:
        first, second = (mi.Vector4d(dr.gather(mi.Vector4f, colours, k + part)) for part in range(2))
        return k + 2, even + first, odd + second

    state = (first, mi.Vector4d(0), mi.Vector4d(0))  # in double: very many numbers are summed
    summed: Any = dr.while_loop(state, lambda k, *_: k < ends, add, label="average")
    count = mi.Float(counts)
    corners = of_corners(count)
    even, odd = (mi.Vector4f(total * mi.Float64((1 - corners) * dr.rcp(count))) for total in summed[1:])
    known = sum(some.colour(sample) for sample in some.some(chosen).corners())
    mean = even + odd + known * (0.25 * corners)
    error = norm(even - odd) * (2 * OF_HALVES) * (some.step * some.step)
    error = dr.maximum(error, FORESEEN * foreseen(guessed, count))
    dr.eval(mean, error)
    dr.scatter(estimate.value, mean, chosen)
    dr.scatter(estimate.error, error, chosen)
    dr.eval(*estimate)


def average_to(
    look: Look,
    some: Cells,
    estimate: Estimate,
    chosen: NDArray[np.uint32],
    counts: NDArray[np.uint32],
    guessed: NDArray[np.float32],
    hides: NDArray[np.bool_],
    budget: float,
) -> float | None:
    """Average over these cells until the squares of the errors that this shows come to about the budget.

    Those where something `hides` take what that asks for in any case: they are never split.

    Returns
    -------
    float or None
        If it takes less to split the worst of the others than to bring them there: the error above which they are, as
        estimated from all of them together, which then stands for what was measured of each. None if they are done.
    """
    samples, lanes = counts.copy(), owned(chosen)
    average(look, some, estimate, chosen, counts, guessed)
    for _ in range(MOST_AGAIN):
        measured = np.array(dr.gather(mi.Float, estimate.error, lanes), np.float64)
        sound = np.isfinite(guessed) & np.isfinite(measured)  # no samples mend the others
        expected = foreseen(np.where(sound, guessed, 0.0), samples.astype(float))
        error = _steadied(np.where(sound, measured, 0), expected)
        if np.sum(error**2) <= TOLERANCE**2 * budget:
            break
        limit = _level(error, TOLERANCE**2 * budget)
        again = np.flatnonzero((error > limit) & (samples < MOST_SAMPLES))
        samples[again] = _even(samples[again] * np.minimum((error[again] / limit) ** (1 / FALL), MOST_MORE))
        if not suffice(samples[again[~hides[again]]]):
            dr.scatter(estimate.error, owned(error.astype(np.float32)), lanes)
            again = again[hides[again]]
            average(look, some, estimate, chosen[again], samples[again], guessed[again])
            return limit
        average(look, some, estimate, chosen[again], samples[again], guessed[again])
    return None


def _steadied(measured: NDArray[np.float64], expected: NDArray[np.float64]) -> NDArray[np.float64]:
    """Let the squares of errors measured by two halves each be in part as they were foreseen.

    These are brought to the same sum of squares, which is what the measured ones are good for.
    """
    squares, of_foreseen = measured**2, expected**2
    scale = np.sum(squares) / max(np.sum(of_foreseen), np.finfo(float).tiny)
    found: NDArray[np.float64] = np.sqrt((1 - FORESEEN) * squares + FORESEEN * scale * of_foreseen)
    return found


def _level(errors: NDArray[np.float64], budget: float) -> float:
    """Find the limit such that the squares of the errors, none of them above it, come to the budget."""
    rising = np.sort(errors) ** 2
    below = np.cumsum(rising) - rising
    above = np.arange(len(rising), 0, -1)
    k = int(np.searchsorted(below + above * rising, budget))  # the first that is above the limit
    return float(np.sqrt((budget - below[k]) / above[k]))
