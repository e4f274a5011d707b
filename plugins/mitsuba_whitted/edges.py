"""What a closer look at a cell shows: its centre, or the edge between two paths, found instead of averaged over."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells, Estimate, Kind, Look, extent, norm
from mitsuba_whitted.corners import OF_RANGE
from mitsuba_whitted.crossings import FINEST, belongs, crossings
from mitsuba_whitted.parts import Parts, cut
from mitsuba_whitted.places import numbered, of_check
from mitsuba_whitted.water import FROM

# Fitted as told in `antialias`.

BULGE = 1.2
"""Error of a cell, in parts of its contrast, for the height of the bulge between chord and edge, times the chord's
length.
"""

LARGEST_SEARCH = 0.125
"""A bulge need not be known any better than this, in sides of the cell, if it is not searched for at all."""

LARGEST_BULGE = 0.12
"""A bulge known to be higher than this, in sides, is not one of a single gentle edge."""

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


class _Task(NamedTuple):
    """Cells to be looked at, and what their corners say."""

    here: Cells
    before: Estimate
    parts: Parts
    of_corners: Any
    """Mean of the colours at the corners."""
    area: Any
    """Share of a pixel."""
    contrast: Any
    """Of the two parts."""
    weight: Any
    """Contrast times area."""
    is_edge: Any
    """Whether it is the edge between two parts that makes the error."""
    bent: Any
    """Whether the colour bends between the corners: the centre is asked, and Simpson's rule taken."""
    of_bulge: Any
    """Error for a bulge, in parts of its height."""
    fine: Any
    """How well the height of the bulge must be known, in sides."""
    ask_a: Any
    """Whether the colour at the centroid of A could matter."""
    ask_b: Any
    checks: Any
    """How many."""
    follow: Any
    """Where to look, if not spread evenly: see `places.following`; or 0."""
    limit: Any
    """Of the error."""
    span: Any
    """Range of the colours at the corners, the root of the mean square over the channels."""

    def phases(self) -> _Phases:
        """Tell what is to be done."""
        after_centroids = dr.select(self.checks > 0, mi.UInt32(_CHECK), _OVER)
        after_a = dr.select(self.ask_b, mi.UInt32(_AT_B), after_centroids)
        after_search = dr.select(self.ask_a, mi.UInt32(_AT_A), after_a)
        of_edge = dr.select(self.fine < LARGEST_SEARCH, mi.UInt32(_SEARCH), after_search)
        of_smooth = dr.select(self.bent, mi.UInt32(_CENTRE), after_centroids)
        return _Phases(dr.select(self.is_edge, of_edge, of_smooth), after_search, after_a, after_centroids)


class _Phases(NamedTuple):
    """Phases of a look, cell by cell: the first, and which comes after others."""

    first: Any
    after_search: Any
    after_a: Any
    after_centroids: Any


class _Seen(NamedTuple):
    """State of the loop: what has been seen so far."""

    phase: Any
    k: Any
    """Checks so far."""
    outward: Any
    """The edge bulges to B if this is 1, to A if it is -1; 0 is not known."""
    low: Any
    """The bulge is higher than this."""
    high: Any
    """And not as high as this; above 1 nothing bounds it yet."""
    colour_a: Any
    """Of part A at its centroid; of a smooth cell in its centre."""
    colour_b: Any
    failed: Any
    """Whether something does not fit."""
    off: Any
    """How far a sample that does not is off, as a colour."""
    surprise: Any
    """See `Estimate`."""

    def bulge(self) -> Any:
        """Height as far as it is known: the middle of what it may be, or the least if nothing bounds it."""
        return self.outward * 0.5 * (self.low + dr.select(self.high > 1, self.low, self.high))


def look_closer(look: Look, cells: Cells, estimate: Estimate, close: Any, checks: Any, follow: Any, limit: Any) -> None:
    """Take samples inside cells of one path, or of two that look alike, and find the edge in all others of two.

    Then it takes so many `checks` of each, less those samples: spread evenly, or about the place of a neighbour's
    surprise, where there is one to `follow`. Updates the estimates of the cells `close`; where what is seen does not
    fit, or the error is still above `limit`, the values are left as they are.
    """
    before = estimate.some(close)
    two, several = before.kind == Kind.EDGE.value, before.kind == Kind.CLUTTER.value
    here = cells.some(close)
    parts = cut(here, crossings(look, cells, close, two, limit), two)
    area = here.step * here.step
    contrast = norm(parts.mean_a - parts.mean_b)
    weight = area * contrast
    # Where both parts have nearly the same colour, and the cell is said to be off, it is by something else.
    is_edge = two & (weight * OF_RANGE > limit)
    bent = several | (~is_edge & (before.error > float(FROM[Kind.SMOOTH]) * limit))
    of_bulge = BULGE * weight * parts.length
    fine = dr.maximum(limit / of_bulge, FINEST)
    of_corners = sum(parts.corners) * 0.25
    low, high = extent(parts.corners)
    ask_a, ask_b = (CENTROID * weight * part > limit for part in (parts.area_a, 1 - parts.area_a))
    # What is asked anyway, at centroids or in the centre, counts as checks.
    asked = sum(dr.select(each, mi.UInt32(1), 0) for each in (is_edge & ask_a, is_edge & ask_b, bent))
    checks = dr.maximum(checks, asked) - asked
    task = _Task(
        here, before, parts, of_corners, area, contrast, weight, is_edge, bent, of_bulge, fine, ask_a, ask_b, checks,
        follow, limit, norm(high - low),
    )  # fmt: skip
    phases = task.phases()
    failed = is_edge & (parts.unclear > 0)

    # A smooth cell may have been looked at before: Simpson's rule tells what the centre was, if it was asked at all.
    colour_a = dr.select(is_edge, parts.mean_a, 1.5 * before.value - 0.5 * of_corners)
    state = _Seen(
        phase=dr.select(failed, mi.UInt32(_OVER), phases.first),
        k=mi.UInt32(0),
        outward=mi.Float(0),
        low=mi.Float(0),
        high=mi.Float(2),
        colour_a=colour_a,
        colour_b=parts.mean_b,
        failed=failed,
        off=dr.select(failed, parts.unclear, 0),
        surprise=mi.UInt32(0),
    )
    looked: Any = dr.while_loop(
        tuple(state),
        lambda phase, *_: phase != _OVER,
        lambda *seen: tuple(_look_once(look, task, phases, _Seen(*seen))),
        label="edges",
    )
    seen = _Seen(*looked)
    value, error, failed = _concluded(task, seen)
    off = dr.maximum(seen.off, dr.select(two, contrast, 0))
    error = dr.select(failed, dr.maximum(dr.maximum(before.error, OF_RANGE * area * off), 1.001 * limit), error)
    fits = (error <= limit) & (is_edge | bent)
    # All of it here, since each scatter may start a kernel of its own, which would compute anew what it needs; and
    # nothing may wait for what is written over, or it would be copied.
    dr.eval(value, error, fits, seen.surprise, *before)
    dr.scatter(estimate.value, value, close, fits)
    dr.scatter(estimate.error, error, close)
    dr.scatter(estimate.surprise, seen.surprise, close)
    dr.eval(*estimate)


def _look_once(look: Look, task: _Task, phases: _Phases, seen: _Seen) -> _Seen:
    """Take the sample that the phase asks for, and say what it shows."""
    here, parts, limit, fine = task.here, task.parts, task.limit, task.fine
    searching, checking, central = seen.phase == _SEARCH, seen.phase == _CHECK, seen.phase == _CENTRE
    first = seen.outward == 0
    k = dr.select(checking, seen.k + 1, seen.k)
    further_out = dr.select(seen.high > 1, dr.maximum(fine, 4 * seen.low), 0.5 * (seen.low + seen.high))
    bulge = dr.select(first, 0, further_out)
    to_check = of_check(here, k, task.follow)
    at = dr.select(seen.phase == _AT_A, parts.centroid_a, parts.centroid_b)
    at = dr.select(central, mi.Point2f(0.5), dr.select(checking, to_check, at))
    at = dr.select(searching, parts.middle + seen.outward * bulge * parts.away, at)
    active = seen.phase != _OVER
    colour, path = look(dr.fma(at.x, here.step, here.x), dr.fma(at.y, here.step, here.y), active)
    ends = (parts.mean_a, parts.mean_b), (parts.path_a, parts.path_b)
    is_a, known, _ = belongs(colour, path, *ends, task.contrast, limit / task.area)

    further = is_a == (seen.outward > 0)  # the edge is further out than this
    low = dr.select(searching & ~first & further, bulge, seen.low)
    high = dr.select(searching & ~first & ~further, bulge, seen.high)
    outward = dr.select(searching & first, dr.select(is_a, mi.Float(1), -1), seen.outward)
    found = ~first & (high - low <= 1.001 * fine)
    failed = seen.failed | (searching & ((~known & (high - low > 2 * fine)) | (low > LARGEST_BULGE)))
    failed |= (seen.phase == _AT_A) & ~(known & is_a)
    failed |= (seen.phase == _AT_B) & ~(known & ~is_a)

    seen = seen._replace(k=k, outward=outward, low=low, high=high)
    unlike, distance, astray = _unlike(task, seen, at, colour, is_a, known)
    another = (task.before.kind == Kind.CLUTTER.value) | ((path != parts.path_a) & (path != parts.path_b))
    failed |= (checking | (central & another)) & unlike
    one_path = task.before.kind == Kind.SMOOTH.value
    hides = dr.select(one_path, another | (distance > task.span), checking & astray)
    after_check = dr.select(checking & (k >= task.checks), mi.UInt32(_OVER), phases.after_centroids)
    after = dr.select(seen.phase == _AT_A, phases.after_a, after_check)
    after = dr.select(searching, dr.select(found, phases.after_search, seen.phase), after)
    return seen._replace(
        phase=dr.select(failed, mi.UInt32(_OVER), after),
        colour_a=dr.select((seen.phase == _AT_A) | central, colour, seen.colour_a),
        colour_b=dr.select(seen.phase == _AT_B, colour, seen.colour_b),
        failed=failed,
        off=dr.maximum(seen.off, dr.select(failed, distance, 0)),
        surprise=dr.select(failed, Estimate.met(numbered(at), hides), seen.surprise),
    )


def _unlike(task: _Task, seen: _Seen, at: Any, colour: Any, is_a: Any, known: Any) -> tuple[Any, Any, Any]:
    """Tell whether a sample is not what was expected, by more than may be left; and how far off its colour is.

    And whether it is of the part beyond the edge, too far from that for a bulge: as of a strip that a corner has met.
    """
    parts, limit = task.parts, task.limit
    arch = 2 * (at.x * (1 - at.x) + at.y * (1 - at.y))  # 1 in the centre, 0 at the corners
    smooth = _between(parts.corners, at) + arch * (seen.colour_a - task.of_corners)
    expected = dr.select(task.is_edge, parts.expected(is_a, seen.colour_a, seen.colour_b, at), smooth)
    distance = norm(colour - expected)
    beyond = parts.beyond(seen.bulge(), at)
    other_side = (is_a == (beyond > 0)) & (task.of_bulge * dr.abs(beyond) > 2 * limit)
    # What is off in a part counts by its share of the cell; in the larger half it may be anything.
    share = dr.select(task.is_edge, 2 * dr.select(is_a, parts.area_a, 1 - parts.area_a), 1)
    too_far = task.area * SURPRISE * dr.minimum(share, 1) * distance > limit
    astray = task.is_edge & known & other_side & (dr.abs(beyond) > LARGEST_BULGE)
    return too_far | (task.is_edge & (~known | other_side)), distance, astray


def _concluded(task: _Task, seen: _Seen) -> tuple[Any, Any, Any]:
    """Tell the colours of the cells, how far off they are, and where something did not fit."""
    parts, area, limit = task.parts, task.area, task.limit
    area_a = parts.area_a + (2 / 3) * seen.bulge() * parts.length  # Archimedes: a parabola over its chord
    area_a = dr.clip(area_a, 0, 1)
    of_edge = seen.colour_a * area_a + seen.colour_b * (1 - area_a)
    change = norm(seen.colour_a - parts.mean_a) * area_a + norm(seen.colour_b - parts.mean_b) * (1 - area_a)
    edge_error = dr.maximum(area * change * OF_CHANGE, OF_EDGE * dr.minimum(limit, task.weight))
    failed = seen.failed | (task.is_edge & (edge_error > limit))  # then an average has to find all of it anew
    of_smooth = (task.of_corners + 2 * seen.colour_a) * (1 / 3)  # exact for polynomials up to the third degree
    bend = area * norm(seen.colour_a - task.of_corners) * SIMPSON
    # What is more than may be left is no bend but a step: an edge within one path, as of a mesh before itself.
    height = mi.Float(0)
    for corner in parts.corners:
        height = dr.maximum(height, norm(corner - seen.colour_a))
    bend = dr.select(bend > limit, dr.maximum(bend, OF_RANGE * area * height), bend)
    smooth_error = dr.select(task.bent, bend, task.before.error)
    value = dr.select(task.is_edge, of_edge, of_smooth)
    return value, dr.select(task.is_edge, edge_error, smooth_error), failed


def _between(corners: list[Any], at: Any) -> Any:
    """Interpolate the colours of the corners."""
    upper = dr.lerp(corners[0], corners[1], at.x)
    return dr.lerp(upper, dr.lerp(corners[3], corners[2], at.x), at.y)
