"""Where to look for things that no corner meets: thin bodies, their shadows, highlights, a strip between two rows."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted.cells import Cells, Estimate, Kind
from mitsuba_whitted.corners import OF_RANGE
from mitsuba_whitted.tables import opaque
from mitsuba_whitted.water import Histogram, levels

# Fitted as told in `antialias`.

NEAR = 1.0
"""Checks of a pixel next to one of several paths, where what hides there with the contrast of the edges around it
makes as much as the whole target.
"""

ANYWHERE = 0.5
"""The same with the contrast that edges have in the mean: something else may hide there."""

FAR = 0.25
"""The same of all other pixels, of which most show nothing."""

LEAST_FAR = 0.6
"""With fewer than this, none of those is checked; below 1, those of every other column are."""

LEAST_FOLLOWING = 24
"""Checks where something was hidden in a neighbour, at least."""

MOST_CHECKS = 128


def checks(pixels: Cells, estimate: Estimate, errors: Histogram, target: float, count: int) -> Any:
    """Say how many samples more each pixel needs, so that what matters is not likely to hide there.

    A hidden thing has the contrast of the edges around it, or that of edges seen elsewhere: the mean of these.
    """
    mixed = errors[Kind.EDGE :]
    of_contrast = _of_contrast(count * target**2)
    typical = math.sqrt(np.sum(mixed * levels(target) ** 2) / max(mixed.sum(), 1))
    far = min(FAR * of_contrast * typical, MOST_CHECKS)
    every = math.ceil(1 / far) if far > LEAST_FAR else 0
    # Below one check even next to the edge of most contrast.
    if NEAR * of_contrast * np.max(levels(target) * mixed.any(axis=0)) < 1 and not every:
        return opaque(dr.zeros(mi.UInt32, dr.width(pixels.inside)))
    some = (pixels.i + 2 * pixels.j) % opaque(mi.UInt32(max(every, 1))) == 0
    of_far = dr.select(some, opaque(mi.UInt32(math.ceil(far) if every else 0)), 0)
    seen = (estimate.kind != Kind.SMOOTH.value) & (estimate.error > 0)  # which NaN is not
    most, _ = largest_around(pixels, dr.select(seen, estimate.error, 0))
    near = dr.maximum(NEAR * most, dr.select(most > 0, opaque(mi.Float(ANYWHERE * typical)), 0))
    of_near = mi.UInt32(dr.minimum(opaque(mi.Float(of_contrast)) * near, MOST_CHECKS))
    of_each = dr.maximum(of_near, of_far)
    dr.eval(of_each)
    return of_each


def enough(around: Any, budget: float) -> Any:
    """Say how many checks a pixel needs next to one where something hid that makes such an error."""
    of_contrast = opaque(mi.Float(_of_contrast(budget)))
    return mi.UInt32(dr.clip(NEAR * of_contrast * around, LEAST_FOLLOWING, MOST_CHECKS))


def _of_contrast(budget: float) -> float:
    """Tell the checks for an error that an edge of some contrast is estimated to make: what hides may have the same.

    Unseen by k samples it fills about 1/k of a pixel, and adds (contrast / k)^2 to the sum of all squares, which may be
    the budget.
    """
    return 1 / (OF_RANGE * math.sqrt(budget))


def largest_around(pixels: Cells, values: Any) -> tuple[Any, Any]:
    """Find the largest value of each pixel and those that touch it, and the way there; none is below 0, or NaN.

    Ways are numbered from 0, the upper left, down and then to the right; 4 is the pixel itself.
    """
    across, down = pixels.across - 1, pixels.down - 1
    held = dr.zeros(mi.Float, pixels.samples)
    dr.scatter(held, values, pixels.j * across + pixels.i, pixels.inside)
    found, way = mi.Float(0), mi.UInt32(4)
    for x in range(-1, 2):
        for y in range(-1, 2):
            i, j = mi.Int32(pixels.i) + x, mi.Int32(pixels.j) + y
            there = pixels.inside & (i >= 0) & (j >= 0) & (i < mi.Int32(across)) & (j < mi.Int32(down))
            value = dr.gather(mi.Float, held, mi.UInt32(j) * across + mi.UInt32(i), there)
            way = dr.select(value > found, mi.UInt32(3 * (x + 1) + y + 1), way)
            found = dr.maximum(found, value)
    return found, way
