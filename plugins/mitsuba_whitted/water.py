"""Which cells need a closer look: those above the level to which errors are to be poured (water-filling)."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.cells import Estimate
from mitsuba_whitted.tables import opaque

LEFT = np.array([0.8, 0.3, 0.7])
"""Error that a cell of each kind is left with, in parts of the limit to which it is refined."""

OCTAVES_BELOW, STEPS, BINS = 8, 4, 96
"""Errors are counted from so many octaves below the target, in so many steps an octave."""

Histogram = NDArray[np.float64]
"""Cells of each kind by their error, (3, BINS)."""


def histogram(estimate: Estimate, active: Any, target: float) -> Histogram:
    """Count the errors of each kind of cell, (3, BINS); those too small to matter are left out.

    Whole numbers: their sum does not depend on the order in which threads come.
    """
    octaves = dr.log2(estimate.error / opaque(mi.Float(target))) + OCTAVES_BELOW
    counts = dr.zeros(mi.UInt32, 3 * BINS)
    place = mi.UInt32(dr.clip(STEPS * octaves, 0, BINS - 1))
    dr.scatter_add(counts, mi.UInt32(1), estimate.kind * BINS + place, active & (octaves >= 0))
    return np.array(counts, dtype=np.float64).reshape(3, BINS)


def levels(target: float) -> NDArray[np.float64]:
    """Errors that the places of a histogram stand for."""
    of_bins: NDArray[np.float64] = target * 2.0 ** ((np.arange(BINS) + 0.5) / STEPS - OCTAVES_BELOW)
    return of_bins


def water_level(counts: Histogram, target: float, budget: float) -> float:
    """Find the error above which cells are refined, so that all that is left meets the budget."""
    left = np.sum(counts * _SQUARES, axis=(1, 2)) * target**2
    return float(levels(target)[max(int(np.searchsorted(left, budget)) - 1, 0)])


_SQUARES = np.minimum(levels(1), LEFT[:, None] * levels(1)[:, None, None]) ** 2
"""What a cell adds to the sum of squares, by limit, kind and error: (BINS, 3, BINS), for a target of 1."""
