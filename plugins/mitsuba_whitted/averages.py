"""Cells that are averaged over: with how many samples, how far off the mean is, and with more where that is too far."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.cells import Cells, Estimate, Look, norm
from mitsuba_whitted.tables import owned
from mitsuba_whitted.water import AVERAGED, FALL, LEAST_SAMPLES

# Fitted as told in `antialias`.

ENOUGH = 1 << 17
"""Samples that take no longer than to split once more would: some launches, however few the cells. Where so many
suffice for all that is left, nothing more is split. Taken again they may be up to 16 times as many.
"""

GOLDEN_RATIO = 0x9E3779B9
"""Less 1, in units of 2^-32. Samples of an average lie at k / n, k g (modulo 1), k from 1/2: evenly spread for any n
(Niederreiter 1992, chapter 3).
"""

OF_HALVES = 0.4
"""Error of such an average, in parts of how much two halves of the samples differ."""

FORESEEN = 0.5
"""Of an error that two halves show, which may be small or large by chance, this part stays as it was foreseen."""

OF_HIDDEN = 2 * LEAST_SAMPLES, 32 * LEAST_SAMPLES
"""Samples where something hides, at least and at most: what one of some checks met is small, and few may miss it again;
how small is not known, and what the most do not settle is split.
"""

TOLERANCE = 1.15
"""Errors measured together may be above those asked for by this factor: the measure is no better."""

MOST_AGAIN = 2
"""So often are averages taken again with more samples."""

MOST_MORE = 4
"""With so many times the samples at most."""


def needed(error: Any, hidden: Any, limit: Any) -> Any:
    """Count the samples whose mean brings an error below the limit: an even number, above ENOUGH at most its double."""
    count = LEAST_SAMPLES * dr.maximum(1, (AVERAGED * error / limit) ** (1 / FALL))
    count = dr.select(hidden, dr.clip(count, *OF_HIDDEN), count)
    return 2 * mi.UInt32(dr.ceil(dr.minimum(0.5 * count, ENOUGH)))


def average(look: Look, some: Cells, estimate: Estimate, chosen: Any, counts: Any, guessed: Any) -> None:
    """Take the mean of so many samples in each of these cells; `counts` are even.

    How much every other of them differs from the rest tells how far off their mean is; `guessed` are the errors that
    were estimated without any.
    """
    ends = dr.cumsum(counts)
    first, width = ends - counts, dr.width(chosen)
    samples = int(ends[width - 1])
    begins = dr.zeros(mi.UInt32, samples)
    dr.scatter(begins, mi.UInt32(1), first, dr.arange(mi.UInt32, width) > 0)
    cell = dr.cumsum(begins)
    here = some.some(dr.gather(mi.UInt32, chosen, cell))
    k = dr.arange(mi.UInt32, samples) - dr.gather(mi.UInt32, first, cell)
    x = (mi.Float(k) + 0.5) / mi.Float(dr.gather(mi.UInt32, counts, cell))
    y = mi.Float((k * GOLDEN_RATIO + GOLDEN_RATIO // 2) >> 8) * 2.0**-24  # whole numbers: k may be a million
    colour, _ = look(dr.fma(x, here.step, here.x), dr.fma(y, here.step, here.y), mi.Bool(True))
    colours = dr.ravel(colour)
    dr.eval(colours)  # else the sums would trace anew

    def add(k: Any, even: Any, odd: Any) -> Any:
        first, second = (mi.Vector4d(dr.gather(mi.Vector4f, colours, k + part)) for part in range(2))
        return k + 2, even + first, odd + second

    state = (first, mi.Vector4d(0), mi.Vector4d(0))  # in double: a million numbers are summed
    summed: Any = dr.while_loop(state, lambda k, *_: k < ends, add, label="average")
    share = dr.rcp(mi.Float(counts))
    even, odd = (mi.Vector4f(total * mi.Float64(share)) for total in summed[1:])
    mean = even + odd
    error = norm(even - odd) * (2 * OF_HALVES) * (some.step * some.step)
    error = dr.maximum(error, FORESEEN * guessed * share**FALL)
    dr.eval(mean, error)
    dr.scatter(estimate.value, mean, chosen)
    dr.scatter(estimate.error, error, chosen)
    dr.eval(*estimate)


def average_to(
    look: Look, some: Cells, estimate: Estimate, chosen: Any, counts: Any, guessed: Any, budget: float
) -> None:
    """Average over these cells until the squares of the errors that this shows come to about the budget."""
    before, samples = np.array(guessed, np.float64), np.array(counts)
    average(look, some, estimate, chosen, counts, guessed)
    for _ in range(MOST_AGAIN):
        measured = np.array(dr.gather(mi.Float, estimate.error, chosen), np.float64)
        sound = np.isfinite(before) & np.isfinite(measured)  # no samples mend the others
        error = _steadied(np.where(sound, measured, 0), np.where(sound, before, 0) * samples**-FALL)
        if np.sum(error**2) <= TOLERANCE**2 * budget:
            break
        limit = _level(error, budget)
        again = np.flatnonzero(error > limit)
        more = np.minimum((error[again] / limit) ** (1 / FALL), MOST_MORE)
        samples[again] = 2 * np.ceil(0.5 * samples[again] * more)
        lanes = owned(again.astype(np.uint32))
        worst, of_worst = dr.gather(mi.UInt32, chosen, lanes), dr.gather(mi.Float, guessed, lanes)
        average(look, some, estimate, worst, owned(samples[again]), of_worst)


def _steadied(measured: NDArray[np.float64], foreseen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Let the squares of errors measured by two halves each be in part as they were foreseen.

    These are brought to the same sum of squares, which is what the measured ones are good for.
    """
    squares, of_foreseen = measured**2, foreseen**2
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
