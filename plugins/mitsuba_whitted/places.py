"""Where in a cell its checks look: spread evenly, and elsewhere in each pixel; or about what a neighbour's have met."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells

# Fitted as told in `antialias`, but for the first.

GOLDEN = 0.7548776662, 0.5698402910
"""Steps from place to place: 1 / g and 1 / g^2 with g^3 = g + 1; so they are spread most evenly (Roberts 2018)."""

APART = 13, 7
"""Places by which a pixel is ahead of those to its left and above: a strip that the checks of one pixel miss is then
met by those of others, and can be followed from there.
"""

PLACES = 1024
"""Places before they are used again. They lie about 1/32 apart; float32 tells places apart by 2^-13 at the last one."""

MORE_CHECKS = 12
"""Checks, besides those that a pixel needs anyway, where something was hidden in a neighbour."""

NEARBY = 0.5
"""Side of the square about the same place, within the cell, in which they lie: what hides goes on nearly straight."""


def place(number: Any) -> Any:
    """Find a place in a cell, in parts of its side; number 0 is the centre."""
    at = mi.Point2f(0.5) + mi.Float(number) * mi.Point2f(*GOLDEN)
    return at - dr.floor(at)


def of_check(here: Cells, k: Any, follow: Any) -> tuple[Any, Any]:
    """Find the place of check k, from 1, and its number.

    Where there is a place to `follow`, one more than its number, it comes first, then others near it, which count as
    the same, until there were MORE_CHECKS.
    """
    number = (APART[0] * here.i + APART[1] * here.j) % PLACES + k
    following = (follow > 0) & (k <= MORE_CHECKS)
    there = place(follow - 1)
    about = dr.clip(there, 0.5 * NEARBY, 1 - 0.5 * NEARBY)
    at = place(number)
    nearby = dr.select(k == 1, there, about + NEARBY * (at - 0.5))
    return dr.select(following, nearby, at), dr.select(following, follow - 1, number)
