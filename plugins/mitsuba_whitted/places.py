"""Where in a cell its checks look: spread evenly, and elsewhere in each pixel; or about what a neighbour's have met."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells

# Fitted as told in `antialias`, but for the first.

PLASTIC = 0.7548776662, 0.5698402910
"""Steps from place to place: 1 / g and 1 / g^2 with g^3 = g + 1; so they are spread most evenly (Roberts 2018)."""

APART = 13, 7
"""Places by which a pixel is ahead of those to its left and above: a strip that the checks of one pixel miss is then
met by those of others, and can be followed from there.
"""

PLACES = 1024
"""Places before they are used again. They lie about 1/32 apart; float32 tells places apart by 2^-14 at the last one."""

NEARBY = 0.5
"""Side of the square, within the cell and nearest to what a neighbour has met, in which its checks lie."""

SIDE = 1024
"""A place is told by column and row of so many: float32 holds its number exactly."""

CENTRE = 1 + SIDE * (SIDE // 2) + SIDE // 2
"""Number of the middle of a cell."""


def numbered(at: Any) -> Any:
    """Tell the number of a place, `at` in parts of the cell's side; from 1."""
    column, row = (mi.UInt32(dr.clip(part * SIDE, 0, SIDE - 1)) for part in at)
    return 1 + SIDE * column + row


def following(number: Any, way: Any) -> Any:
    """Tell by one number what to follow: a place, by its own or 0 for none, and the way (`hidden.largest_around`)."""
    return dr.select(number > 0, 9 * number + way, 0)


def _beside(follow: Any) -> Any:
    """Undo `following`: the place, in sides of this cell from its corner; it lies in one of those around."""
    number, way = follow // 9 - 1, follow % 9
    at = mi.Point2f(mi.Float(number // SIDE), mi.Float(number % SIDE)) * (1 / SIDE)
    return at + mi.Point2f(mi.Float(way // 3), mi.Float(way % 3)) - 1


def of_check(here: Cells, k: Any, follow: Any) -> Any:
    """Find the place of check k, from 1.

    Where there is a place to `follow` (`following`), the nearest one comes first, then others near that: what hides
    goes on nearly straight.
    """
    number = mi.Float((APART[0] * here.i + APART[1] * here.j) % PLACES + k)
    at = mi.Point2f(0.5) + number * mi.Point2f(*PLASTIC)
    at -= dr.floor(at)
    there = _beside(follow)
    about = dr.clip(there, 0.5 * NEARBY, 1 - 0.5 * NEARBY)
    nearby = dr.select(k == 1, dr.clip(there, 0, 1), about + NEARBY * (at - 0.5))
    return dr.select(follow > 0, nearby, at)
