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

NEAR = 0.7
"""Checks of a pixel next to one of several paths, where what one pixel may hide is as much as the whole target."""

FAR = 0.25
"""The same of all others, of which most show nothing."""

LEAST_FAR = 1.2
"""With fewer than this, those are not checked at all."""

MOST_CHECKS = 128


def checks(pixels: Cells, estimate: Estimate, errors: Histogram, target: float, count: int) -> Any:
    """Say how many samples more each pixel needs, so that what matters is not likely to hide there.

    A hidden thing has the contrast of the edges that are seen. Unseen by k samples it fills about 1/k of a pixel,
    and adds (contrast / k)^2 to the sum of all squares, which may be count * target^2.
    """
    mixed = errors[Kind.EDGE :]
    contrast = math.sqrt(np.sum(mixed * levels(target) ** 2) / max(mixed.sum(), 1)) / OF_RANGE
    worst = contrast / (target * math.sqrt(count))
    near, far = (min(share * worst, MOST_CHECKS) for share in (NEAR, FAR))
    every = math.ceil(1 / far) if far > LEAST_FAR else 0
    if near < 1 and not every:
        return opaque(dr.zeros(mi.UInt32, dr.width(pixels.inside)))
    some = (pixels.i + 2 * pixels.j) % opaque(mi.UInt32(max(every, 1))) == 0
    of_far = dr.select(some, opaque(mi.UInt32(math.ceil(far) if every else 0)), 0)
    of_each = dr.select(around(pixels, estimate.kind != Kind.SMOOTH.value), opaque(mi.UInt32(int(near))), of_far)
    dr.eval(of_each)
    return of_each


def around(pixels: Cells, some: Any) -> Any:
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
