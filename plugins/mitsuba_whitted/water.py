"""Which cells need a closer look: those above the level to which errors are to be poured (water-filling), about."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.cells import Kind
from mitsuba_whitted.tables import opaque

# Fitted as told in `antialias`; the first three by kind.

FROM = np.array([0.5, 1.0, 1.0])
"""A cell is refined if its error is above this part of the limit: one path takes just a sample, an edge some ten."""

UNTOUCHED = np.array([0.4, 0.45, 0.8])
"""What errors turn out to be, in parts of what is estimated: they stay with the cells that are not refined."""

LEFT = np.array([0.25, 0.4])
"""Error that a cell of one path or an edge is left with where it is refined, in parts of the limit; never more than was
estimated.
"""

LEAST_SAMPLES = 2
"""Of a cell that is averaged over: one for either half."""

FALL = 0.75
"""The error falls with this power of the samples, as long as edges cross the cell at random."""

AVERAGED = 0.64
"""Error of the average of n samples times n^FALL, in parts of what was estimated before.

Straight edges between two uniform colours, the estimate being 0.3 of these, leave 0.34, 0.18, 0.10 and 0.037 with 2, 6,
16 and 64 samples and the corners (`lattices`), where this foresees 0.38, 0.17, 0.08 and 0.028; but then pictures leave
less than is estimated, since seldom all of a cell has the contrast of its corners.
"""

OCTAVES_BELOW, STEPS, BINS = 8, 4, 96
"""Errors are counted from so many octaves below the target, in so many steps an octave."""

Histogram = NDArray[np.float64]
"""Cells of each kind by their error, (3, BINS)."""


def counts(error: Any, kind: Any, active: Any, target: float) -> Any:
    """Count the errors of each kind of cell, flat (3, BINS), not evaluated; those too small to matter are left out.

    Whole numbers: their sum does not depend on the order in which threads come.
    """
    octaves = dr.log2(error / opaque(mi.Float(target))) + OCTAVES_BELOW
    found = dr.zeros(mi.UInt32, 3 * BINS)
    place = mi.UInt32(dr.clip(STEPS * octaves, 0, BINS - 1))
    dr.scatter_add(found, mi.UInt32(1), kind * BINS + place, active & (octaves >= 0))
    return found


def histogram(found: Any) -> Histogram:
    """Fetch what was counted."""
    return np.array(found, dtype=np.float64).reshape(3, BINS)


def levels(target: float) -> NDArray[np.float64]:
    """Errors that the places of a histogram stand for."""
    of_bins: NDArray[np.float64] = target * 2.0 ** ((np.arange(BINS) + 0.5) / STEPS - OCTAVES_BELOW)
    return of_bins


def water_level(errors: Histogram, target: float, budget: float) -> float:
    """Find the limit to which cells are refined, so that all that is left meets the budget.

    The sum grows with the limit, but for a tenth at most from one level to the next where cells of one path cease to be
    refined (FROM): what is found meets the budget, unless the lowest of all does not, though now and then a limit above
    it would too.
    """
    left = np.sum(errors * _SQUARES, axis=(1, 2)) * target**2
    return float(levels(target)[max(int(np.searchsorted(left, budget)) - 1, 0)])


def samples_for(error: NDArray[np.float64], limit: Any) -> NDArray[np.float64]:
    """Tell how many samples cells with this error are averaged over: the error divided by the limit.

    This is between two powers of that quotient: 1 / FALL would leave all cells with the same error; 1 / (FALL + 1/2)
    would bring the sum of squares down with the fewest samples (Lagrange), but leave some pixels far off.
    """
    found: NDArray[np.float64] = np.maximum(LEAST_SAMPLES, error / limit)
    return found


def foreseen(error: Any, samples: Any) -> Any:
    """Tell how far off averages of so many samples are likely to be; `error` was estimated before any was taken.

    Arrays of NumPy or of Dr.Jit, whose samples must be floats.
    """
    return AVERAGED * error * samples**-FALL


def _squares() -> NDArray[np.float64]:
    """Tell what a cell adds to the sum of squares, by limit, kind and error: (BINS, 3, BINS), for a target of 1."""
    error, limit = levels(1), levels(1)[:, None, None]
    clutter = UNTOUCHED[Kind.CLUTTER] * error
    averaged = foreseen(clutter, samples_for(clutter, limit))
    refined = np.concatenate([np.minimum(error, LEFT[:, None] * limit), averaged], axis=1)
    found: NDArray[np.float64] = np.where(error > FROM[:, None] * limit, refined, UNTOUCHED[:, None] * error) ** 2
    return found


_SQUARES = _squares()
