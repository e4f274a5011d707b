"""What a closer look at a cell shows: its centre, or the edge between two paths, found instead of averaged over."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells, Estimate, Kind, Look, norm
from mitsuba_whitted.corners import OF_RANGE
from mitsuba_whitted.crossings import FINEST, belongs, crossings
from mitsuba_whitted.parts import cut
from mitsuba_whitted.places import MORE_CHECKS, of_check
from mitsuba_whitted.water import FROM

# Fitted as told in `antialias`.

BULGE = 1.6
"""Error of a cell, in parts of its contrast, for the height of the bulge between chord and edge, times the chord's
length.
"""

LARGEST_SEARCH = 0.125
"""A bulge need not be known any better than this, in sides of the cell, if it is not searched for at all."""

LARGEST_BULGE = 0.25
"""A bulge beyond this is not one of a single gentle edge."""

CENTROID = 0.5
"""Error, in parts of the contrast and of a part's area, where its colour is taken from corners alone."""

OF_CHANGE = 0.25
"""Error of a part's colour, in parts of the change from its corners' mean to the centroid."""

SIMPSON = 0.3
"""Error of Simpson's rule, in parts of the change that it makes."""

OF_EDGE = 0.3
"""Error of a cell with an edge at least, in parts of the limit."""

SURPRISE = 0.5
"""Error, in parts of what a sample differs from what was expected there."""

_SEARCH, _AT_A, _AT_B, _CENTRE, _CHECK, _OVER = range(6)
"""Phases of a look: for the bulge of the edge, at the centroid of either part, at the centre of the cell, wherever
something may hide; done."""


def look_closer(look: Look, cells: Cells, estimate: Estimate, close: Any, checks: Any, follow: Any, limit: Any) -> None:
    """Take samples inside cells of one path, and find the edge in those of two.

    Then it takes so many `checks` of each, spread evenly; before these MORE_CHECKS about the place of a neighbour's
    surprise, where there is one to `follow`. Updates the estimates of the cells `close`; where what is seen does not
    fit, or the error is still above `limit`, the values are left as they are.
    """
    checks = checks + dr.select(follow > 0, mi.UInt32(MORE_CHECKS), 0)
    before = estimate.some(close)
    two, several = before.kind == Kind.EDGE.value, before.kind == Kind.CLUTTER.value
    here = cells.some(close)
    parts = cut(here, crossings(look, cells, close, two, limit), two)
    of_corners = sum(parts.corners) * 0.25
    area = here.step * here.step
    contrast = norm(parts.mean_a - parts.mean_b)
    weight = area * contrast
    # Where both parts have nearly the same colour, and the cell is said to be off, it is by something else.
    is_edge = two & (weight * OF_RANGE > limit)
    bent = several | (~two & (before.error > float(FROM[Kind.SMOOTH]) * limit))
    of_bulge = BULGE * weight * parts.length
    fine = dr.maximum(limit / of_bulge, FINEST)
    ask_a = CENTROID * weight * parts.area_a > limit
    ask_b = CENTROID * weight * (1 - parts.area_a) > limit

    checked = dr.select(checks > 0, mi.UInt32(_CHECK), _OVER)
    after_a = dr.select(ask_b, mi.UInt32(_AT_B), checked)
    after_search = dr.select(ask_a, mi.UInt32(_AT_A), after_a)
    first_of_edge = dr.select(fine < LARGEST_SEARCH, mi.UInt32(_SEARCH), after_search)
    first_of_smooth = dr.select(bent, mi.UInt32(_CENTRE), checked)
    failed = two & dr.select(is_edge, parts.unclear, before.error > limit)
    start = dr.select(failed, mi.UInt32(_OVER), dr.select(is_edge, first_of_edge, first_of_smooth))

    def step(
        phase: Any,
        k: Any,
        outward: Any,
        low: Any,
        high: Any,
        colour_a: Any,
        colour_b: Any,
        failed: Any,
        off: Any,
        surprise: Any,
    ) -> Any:
        """Look once. The bulge lies between `low` and `high`, to B if `outward` is 1, to A if it is -1.

        The colour in the centre of a smooth cell is that of A.
        """
        searching, checking, central = phase == _SEARCH, phase == _CHECK, phase == _CENTRE
        first = outward == 0
        k = dr.select(checking, k + 1, k)
        bulge = dr.select(first, 0, dr.select(high > 1, dr.maximum(fine, 4 * low), 0.5 * (low + high)))
        to_check, number = of_check(here, k, follow)
        at = dr.select(phase == _AT_A, parts.centroid_a, parts.centroid_b)
        at = dr.select(central, mi.Point2f(0.5), dr.select(checking, to_check, at))
        at = dr.select(searching, parts.middle + outward * bulge * parts.away, at)
        colour, path = look(dr.fma(at.x, here.step, here.x), dr.fma(at.y, here.step, here.y), phase != _OVER)
        ends = (parts.mean_a, parts.mean_b), (parts.path_a, parts.path_b)
        is_a, known = belongs(colour, path, *ends, contrast, limit / area)

        further = is_a == (outward > 0)  # the edge is further out than this
        low = dr.select(searching & ~first & further, bulge, low)
        high = dr.select(searching & ~first & ~further, bulge, high)
        outward = dr.select(searching & first, dr.select(is_a, mi.Float(1), -1), outward)
        found = ~first & (high - low <= 1.001 * fine)
        failed |= searching & ((~known & (high - low > 2 * fine)) | (low > LARGEST_BULGE))
        failed |= (phase == _AT_A) & ~(known & is_a)
        failed |= (phase == _AT_B) & ~(known & ~is_a)

        arch = 2 * (at.x * (1 - at.x) + at.y * (1 - at.y))  # 1 in the centre, 0 at the corners
        smooth = _between(parts.corners, at) + arch * (colour_a - of_corners)
        expected = dr.select(is_edge, parts.expected(is_a, colour_a, colour_b, at), smooth)
        distance = norm(colour - expected)
        beyond = parts.beyond(_bulge(outward, low, high), at)
        other_side = (is_a == (beyond > 0)) & (of_bulge * dr.abs(beyond) > 2 * limit)
        # What is off in a part counts by its share of the cell; in the larger half it may be anything.
        share = dr.select(is_edge, 2 * dr.select(is_a, parts.area_a, 1 - parts.area_a), 1)
        unlike = (area * SURPRISE * dr.minimum(share, 1) * distance > limit) | (is_edge & (~known | other_side))
        another = several | ((path != parts.path_a) & (path != parts.path_b))
        failed |= (checking | (central & another)) & unlike
        surprise = dr.select(failed, dr.select(checking, number, 0) + 1, surprise)
        off = dr.maximum(off, dr.select(failed, distance, 0))

        colour_a = dr.select((phase == _AT_A) | central, colour, colour_a)
        colour_b = dr.select(phase == _AT_B, colour, colour_b)
        after_check = dr.select(checking & (k >= checks), mi.UInt32(_OVER), checked)
        after = dr.select(searching, after_search, dr.select(phase == _AT_A, after_a, after_check))
        phase = dr.select(failed, mi.UInt32(_OVER), dr.select(searching & ~found, phase, after))
        return phase, k, outward, low, high, colour_a, colour_b, failed, off, surprise

    number, zero = mi.UInt32(0), mi.Float(0)
    # A smooth cell may have been looked at before: Simpson's rule tells what the centre was, if it was asked at all.
    colour_a = dr.select(is_edge, parts.mean_a, 1.5 * before.value - 0.5 * of_corners)
    state = start, number, zero, zero, mi.Float(2), colour_a, parts.mean_b, failed, zero, number
    looked: Any = dr.while_loop(state, lambda phase, *_: phase != _OVER, step, label="edges")
    _, _, outward, low, high, colour_a, colour_b, failed, off, surprise = looked

    area_a = parts.area_a + (2 / 3) * _bulge(outward, low, high) * parts.length  # Archimedes: a parabola over its chord
    area_a = dr.clip(area_a, 0, 1)
    of_edge = colour_a * area_a + colour_b * (1 - area_a)
    change = norm(colour_a - parts.mean_a) * area_a + norm(colour_b - parts.mean_b) * (1 - area_a)
    edge_error = dr.maximum(area * change * OF_CHANGE, OF_EDGE * dr.minimum(limit, weight))
    failed |= is_edge & (edge_error > limit)  # then an average has to find all of it anew
    of_smooth = (of_corners + 2 * colour_a) * (1 / 3)  # exact for polynomials up to the third degree
    smooth_error = dr.select(bent, area * norm(colour_a - of_corners) * SIMPSON, before.error)
    value, error = dr.select(is_edge, of_edge, of_smooth), dr.select(is_edge, edge_error, smooth_error)
    off = dr.maximum(off, dr.select(two, contrast, 0))
    error = dr.select(failed, dr.maximum(dr.maximum(before.error, OF_RANGE * area * off), 1.001 * limit), error)
    # Here, since each scatter may start a kernel of its own; and nothing may wait for what is written over, or it would
    # be copied.
    dr.eval(value, error, surprise, *before)
    dr.scatter(estimate.value, value, close, (error <= limit) & (is_edge | bent))
    dr.scatter(estimate.error, error, close)
    dr.scatter(estimate.surprise, surprise, close)
    dr.eval(*estimate)


def _bulge(outward: Any, low: Any, high: Any) -> Any:
    """Height of the bulge as far as it is known: the middle of what it may be, or the least if nothing bounds it."""
    return outward * 0.5 * (low + dr.select(high > 1, low, high))


def _between(corners: list[Any], at: Any) -> Any:
    """Interpolate the colours of the corners."""
    upper = dr.lerp(corners[0], corners[1], at.x)
    return dr.lerp(upper, dr.lerp(corners[3], corners[2], at.x), at.y)
