"""What a closer look at a cell shows: its centre, or the edge between two paths, found instead of averaged over."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells, Estimate, Kind, Look, norm
from mitsuba_whitted.corners import OF_RANGE

# Fitted as told in `antialias`.

CROSSING = 0.4
"""Error of a cell, in parts of its contrast, for each part of a side within which the crossing is not known."""

BULGE = 1.6
"""The same for the height of the bulge between chord and edge, times the chord's length."""

LARGEST_SEARCH = 0.125
"""A bulge need not be known any better than this, in sides of the cell, if it is not searched for at all."""

LARGEST_BULGE = 0.25
"""A bulge beyond this is not one of a single gentle edge."""

CENTROID = 0.5
"""Error, in parts of the contrast and of a part's area, where its colour is taken from corners alone."""

ALIKE = 0.1
"""A third path is taken for that of the two whose colour it nearly has: within this part of the contrast."""

ALIKE_ERROR = 1.0
"""And within so many times the limit."""

OF_CHANGE = 0.25
"""Error of a part's colour, in parts of the change from its corners' mean to the centroid."""

SIMPSON = 0.3
"""Error of Simpson's rule, in parts of the change that it makes."""

OF_EDGE = 0.3
"""Error of a cell with an edge at least, in parts of the limit."""

FINEST = 2.0**-10
"""No position is sought finer than this part of a side: edges are not straighter than that."""

SURPRISE = 0.7
"""Error, in parts of what a sample differs from what was expected there."""

GOLDEN = 0.7548776662, 0.5698402910
"""Steps of checks: 1 / g and 1 / g^2 with g^3 = g + 1, for which points are spread most evenly (Roberts 2018)."""

APART = 13, 7
"""Places of checks by which a pixel is ahead of those to its left and above: a strip that the checks of one pixel miss
is then met by those of others, and can be followed from there.
"""

PLACES = 1024
"""Places before they are used again. They lie about 1/32 apart; float32 tells places apart by 2^-13 at the last one."""

MORE_CHECKS = 12
"""Checks, besides those that a pixel needs anyway, where something was hidden in a neighbour."""

NEARBY = 0.5
"""Side of the square about the same place, within the cell, in which they lie: what hides goes on nearly straight."""

_SEARCH, _AT_A, _AT_B, _CENTRE, _CHECK, _OVER = range(6)
"""Phases of a look: for the bulge of the edge, at the centroid of either part, at the centre of the cell, wherever
something may hide; done."""


class _Parts(NamedTuple):
    """A cell cut in two by the chord of an edge; A holds the first corner. In sides of the cell."""

    area_a: Any
    centroid_a: Any
    centroid_b: Any
    mean_a: Any
    """Mean of the colours at A's corners."""
    mean_b: Any
    path_a: Any
    path_b: Any
    middle: Any
    """Of the chord."""
    length: Any
    away: Any
    """Unit vector across the chord, from A to B."""
    unclear: Any
    """Whether a crossing of one of the sides was not found."""


def look_closer(look: Look, cells: Cells, estimate: Estimate, close: Any, checks: Any, follow: Any, limit: Any) -> None:
    """Take samples inside cells of one path, and find the edge in those of two.

    Then it takes so many `checks` of each, spread evenly; before these MORE_CHECKS about the place of a neighbour's
    surprise, where there is one to `follow`. Updates the estimates of the cells `close`; where what is seen does not
    fit, or the error is still above `limit`, the values are left as they are.
    """
    checks = checks + dr.select(follow > 0, mi.UInt32(MORE_CHECKS), 0)
    kind = dr.gather(mi.UInt32, estimate.kind, close)
    two, several = kind == Kind.EDGE.value, kind == Kind.CLUTTER.value
    here = cells.some(close)
    parts = _cut(here, _crossings(look, cells, close, two, limit), two)
    area = here.step * here.step
    contrast = norm(parts.mean_a - parts.mean_b)
    weight = area * contrast
    # Where both parts have nearly the same colour, what counts is whether the centre has it too.
    is_edge = two & (weight * OF_RANGE > limit)
    fine = dr.maximum(limit / (BULGE * weight * parts.length), FINEST)
    ask_a = is_edge & (CENTROID * weight * parts.area_a > limit)
    ask_b = is_edge & (CENTROID * weight * (1 - parts.area_a) > limit)

    checked = dr.select(checks > 0, mi.UInt32(_CHECK), _OVER)
    after_a = dr.select(ask_b, mi.UInt32(_AT_B), checked)
    after_search = dr.select(ask_a, mi.UInt32(_AT_A), after_a)
    of_edge = dr.select(fine < LARGEST_SEARCH, mi.UInt32(_SEARCH), after_search)
    failed = is_edge & parts.unclear
    start = dr.select(failed, mi.UInt32(_OVER), dr.select(is_edge, of_edge, mi.UInt32(_CENTRE)))

    there = place(follow - 1)
    about = dr.clip(there, 0.5 * NEARBY, 1 - 0.5 * NEARBY)
    first_place = (APART[0] * here.i + APART[1] * here.j) % PLACES
    corners = [here.colour(sample) for sample in here.corners()]
    along = mi.Vector2f(-parts.away.y, parts.away.x)

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
        """Look once. The bulge lies between `low` and `high`, to B if `outward` is 1, to A if it is -1."""
        first = outward == 0
        bulge = dr.select(first, 0, dr.select(high > 1, dr.maximum(fine, 4 * low), 0.5 * (low + high)))
        at_centroid = dr.select(phase == _AT_A, parts.centroid_a, parts.centroid_b)
        inside = dr.select(phase == _CENTRE, mi.Point2f(0.5), at_centroid)
        checking = phase == _CHECK
        k = dr.select(checking, k + 1, k)
        number = first_place + k
        to_check = place(number)
        nearby = dr.select(k == 1, there, about + NEARBY * (to_check - 0.5))
        following = (follow > 0) & (k <= MORE_CHECKS)
        to_check = dr.select(following, nearby, to_check)
        inside = dr.select(checking, to_check, inside)
        at = dr.select(phase == _SEARCH, parts.middle + outward * bulge * parts.away, inside)
        alive = phase != _OVER
        colour, path = look(dr.fma(at.x, here.step, here.x), dr.fma(at.y, here.step, here.y), alive)
        ends = (parts.mean_a, parts.mean_b), (parts.path_a, parts.path_b)
        is_a, known = _belongs(colour, path, *ends, contrast, limit / area)

        searching = phase == _SEARCH
        further = is_a == (outward > 0)  # the edge is further out than this
        low = dr.select(searching & ~first & further, bulge, low)
        high = dr.select(searching & ~first & ~further, bulge, high)
        outward = dr.select(searching & first, dr.select(is_a, mi.Float(1), -1), outward)
        found = ~first & (high - low <= 1.001 * fine)

        failed |= searching & (~known | (low > LARGEST_BULGE))
        failed |= (phase == _AT_A) & ~(known & is_a)
        failed |= (phase == _AT_B) & ~(known & ~is_a)
        failed |= (phase == _CENTRE) & ~several & (path != parts.path_a) & (path != parts.path_b)

        from_middle = at - parts.middle
        bulge = outward * 0.5 * (low + dr.select(high > 1, low, high))
        share = 2 * dr.dot(from_middle, along) * dr.rcp(dr.maximum(parts.length, FINEST))
        beyond = dr.dot(from_middle, parts.away) - bulge * (1 - share * share)
        other_side = is_a == (beyond > 0)
        expected = dr.select(is_edge, dr.select(is_a, colour_a, colour_b), _between(corners, at))
        distance = norm(colour - expected)
        unlike = area * SURPRISE * distance > limit
        unlike |= is_edge & (~known | (other_side & (BULGE * weight * parts.length * dr.abs(beyond) > 2 * limit)))
        failed |= (checking | (several & (phase == _CENTRE))) & unlike
        met = dr.select(following, follow - 1, number)
        surprise = dr.select(failed, dr.select(checking, met, 0) + 1, surprise)
        off = dr.maximum(off, dr.select(failed, distance, 0))
        colour_a = dr.select((phase == _AT_A) | (phase == _CENTRE), colour, colour_a)
        colour_b = dr.select(phase == _AT_B, colour, colour_b)
        after_check = dr.select(checking & (k >= checks), mi.UInt32(_OVER), checked)
        after = dr.select(searching, after_search, dr.select(phase == _AT_A, after_a, after_check))
        phase = dr.select(failed, mi.UInt32(_OVER), dr.select(searching & ~found, phase, after))
        return phase, k, outward, low, high, colour_a, colour_b, failed, off, surprise

    state = (
        start,
        mi.UInt32(0),
        mi.Float(0),
        mi.Float(0),
        mi.Float(2),
        parts.mean_a,
        parts.mean_b,
        failed,
        mi.Float(0),
        mi.UInt32(0),
    )
    looked: Any = dr.while_loop(state, lambda phase, *_: phase != _OVER, step, label="edges")
    _, _, outward, low, high, colour_a, colour_b, failed, off, surprise = looked

    bulge = outward * 0.5 * (low + dr.select(high > 1, low, high))
    area_a = dr.clip(parts.area_a + (2 / 3) * bulge * parts.length, 0, 1)  # Archimedes: a parabola over its chord
    of_edge = colour_a * area_a + colour_b * (1 - area_a)
    change = norm(colour_a - parts.mean_a) * area_a + norm(colour_b - parts.mean_b) * (1 - area_a)
    edge_error = dr.maximum(area * change * OF_CHANGE, OF_EDGE * dr.minimum(limit, weight))
    of_corners = sum(corners) * 0.25
    of_centre = (of_corners + 2 * colour_a) * (1 / 3)  # exact for polynomials up to the third degree
    value = dr.select(is_edge, of_edge, of_centre)
    error = dr.select(is_edge, edge_error, area * norm(colour_a - of_corners) * SIMPSON)
    off = dr.maximum(off, dr.select(two, contrast, 0))
    before = dr.maximum(dr.gather(mi.Float, estimate.error, close), OF_RANGE * area * off)
    error = dr.select(failed, dr.maximum(before, 1.001 * limit), error)
    dr.eval(value, error, surprise)  # here, since each scatter may start a kernel of its own
    good = error <= limit
    dr.scatter(estimate.value, value, close, good)
    dr.scatter(estimate.error, error, close)
    dr.scatter(estimate.surprise, surprise, close)
    dr.eval(*estimate)


def place(number: Any) -> Any:
    """Find the place of a check in a cell, in parts of its side; number 0 is the centre."""
    at = mi.Point2f(0.5) + mi.Float(number) * mi.Point2f(*GOLDEN)
    return at - dr.floor(at)


def _between(corners: list[Any], at: Any) -> Any:
    """Interpolate the colours of the corners."""
    upper = dr.lerp(corners[0], corners[1], at.x)
    return dr.lerp(upper, dr.lerp(corners[3], corners[2], at.x), at.y)


def _belongs(colour: Any, path: Any, colours: Any, paths: Any, contrast: Any, limit: Any) -> tuple[Any, Any]:
    """Tell whether a sample belongs to the first of two paths, and whether to one of them at all."""
    to_a, to_b = (norm(colour - end) for end in colours)
    alike = dr.minimum(to_a, to_b) <= dr.minimum(ALIKE * contrast, ALIKE_ERROR * limit)
    is_a = (path == paths[0]) | ((path != paths[1]) & alike & (to_a < to_b))
    return is_a, (path == paths[0]) | (path == paths[1]) | alike


def _cut(here: Cells, crossings: Any, two: Any) -> _Parts:
    """Cut cells along the chords of their edges: the outline of A is followed clockwise, and closed by the chord."""
    corners = here.corners()
    colours = [here.colour(sample) for sample in corners]
    paths = [here.path(sample) for sample in corners]
    in_a = [path == paths[0] for path in paths]
    corner_at = [mi.Point2f(0, 0), mi.Point2f(1, 0), mi.Point2f(1, 1), mi.Point2f(0, 1)]
    t = [dr.gather(mi.Float, crossings, side, two) for side in _sides(here)]
    crossing_at = [mi.Point2f(t[0], 0), mi.Point2f(1, t[1]), mi.Point2f(t[2], 1), mi.Point2f(0, t[3])]

    unclear = mi.Bool(False)
    leaves, enters, moment = mi.Point2f(0), mi.Point2f(0), mi.Point2f(0)
    doubled, count = mi.Float(0), mi.Float(0)  # twice the area; corners
    sum_a, sum_b = mi.Vector4f(0), mi.Vector4f(0)
    for k in range(4):
        m = (k + 1) % 4
        crossed = in_a[k] != in_a[m]
        unclear |= crossed & (t[k] < 0)
        leaves = dr.select(crossed & in_a[k], crossing_at[k], leaves)
        enters = dr.select(crossed & in_a[m], crossing_at[k], enters)
        p = dr.select(in_a[k], corner_at[k], crossing_at[k])
        q = dr.select(in_a[m], corner_at[m], crossing_at[k])
        turn = dr.select(in_a[k] | in_a[m], p.x * q.y - p.y * q.x, 0)
        doubled += turn
        moment += (p + q) * turn
        count += dr.select(in_a[k], mi.Float(1), 0)
        sum_a += dr.select(in_a[k], colours[k], 0)
        sum_b += dr.select(in_a[k], 0, colours[k])
    turn = leaves.x * enters.y - leaves.y * enters.x
    doubled += turn
    moment += (leaves + enters) * turn

    tiny = 1e-6  # below, a centroid would be noise
    area_a = 0.5 * doubled
    centroid_a = dr.select(area_a > tiny, moment * dr.rcp(3 * doubled), corner_at[0])
    centroid_b = dr.select(area_a < 1 - tiny, (mi.Point2f(0.5) - area_a * centroid_a) * dr.rcp(1 - area_a), leaves)
    path_b = dr.select(in_a[1], dr.select(in_a[2], paths[3], paths[2]), paths[1])
    chord, middle = enters - leaves, (leaves + enters) * 0.5
    length = dr.norm(chord)
    across = mi.Point2f(-chord.y, chord.x) * dr.rcp(dr.maximum(length, tiny))
    away = dr.select(dr.dot(centroid_a - middle, across) > 0, -across, across)
    mean_a, mean_b = sum_a * dr.rcp(count), sum_b * dr.rcp(dr.maximum(4 - count, 1))
    return _Parts(
        area_a, centroid_a, centroid_b, mean_a, mean_b, paths[0], path_b, middle, length, away, unclear
    )  # fmt: skip


def _sides(cells: Cells) -> list[Any]:
    """Numbers of the four sides, clockwise from the top: two for each sample, to the right and down."""
    upper_left, upper_right, _, lower_left = cells.corners()
    return [2 * upper_left, 2 * upper_right + 1, 2 * lower_left, 2 * upper_left + 1]


class _Side(NamedTuple):
    """Sides of cells: the samples at their ends."""

    here: Cells
    """The cell that each is of."""
    begin: Any
    """Upper or left sample."""
    end: Any
    down: Any
    """Whether it goes down, or to the right."""
    number: Any
    k: Any
    """Which side of the cell."""


def _side(cells: Cells, close: Any, lane: Any) -> _Side:
    """Side number ``lane % 4`` of cell ``close[lane // 4]``, clockwise from the top."""
    here, k = cells.some(dr.gather(mi.UInt32, close, lane // 4)), lane % 4
    down = (k & 1) != 0
    begin = here.corner + dr.select(k == 1, mi.UInt32(1), dr.select(k == 2, here.across, 0))
    end = begin + dr.select(down, here.across, 1)
    return _Side(here, begin, end, down, 2 * begin + dr.select(down, mi.UInt32(1), 0), k)


def _crossings(look: Look, cells: Cells, close: Any, two: Any, limit: Any) -> Any:
    """Find where edges cross the sides of these cells: by number of the side, in parts of it; -1 where it is unclear.

    Nothing here depends on which of its two cells a side is seen from.
    """
    crossings = dr.zeros(mi.Float, 2 * cells.samples)
    marked = dr.zeros(mi.Bool, cells.samples)
    dr.scatter(marked, mi.Bool(True), dr.gather(mi.UInt32, cells.corner, close), two)
    lane = dr.arange(mi.UInt32, 4 * dr.width(close))
    side = _side(cells, close, lane)
    here = side.here
    crossed = dr.gather(mi.Bool, two, lane // 4) & (cells.path(side.begin) != cells.path(side.end))
    # A side that two cells share is sought by the upper or left one of them.
    above, left = (side.k == 0) & (here.j > 0), (side.k == 3) & (here.i > 0)
    other = here.corner - dr.select(above, here.across, 1)
    crossed &= ~dr.gather(mi.Bool, marked, other, above | left)
    mine = dr.compress(crossed)
    if not dr.width(mine):
        return crossings

    side = _side(cells, close, mine)
    here = side.here
    x = here.x + dr.select(side.k == 1, here.step, 0)
    y = here.y + dr.select(side.k == 2, here.step, 0)
    dx, dy = dr.select(side.down, 0, here.step), dr.select(side.down, here.step, 0)
    colours = cells.colour(side.begin), cells.colour(side.end)
    paths = cells.path(side.begin), cells.path(side.end)
    contrast, area = norm(colours[0] - colours[1]), here.step * here.step
    fine = dr.maximum(limit / (CROSSING * area * contrast), FINEST)

    def step(low: Any, high: Any, unclear: Any) -> Any:
        middle = 0.5 * (low + high)
        colour, path = look(dr.fma(middle, dx, x), dr.fma(middle, dy, y), mi.Bool(True))
        at_begin, known = _belongs(colour, path, colours, paths, contrast, limit / area)
        return dr.select(at_begin, middle, low), dr.select(at_begin, high, middle), unclear | ~known

    def goes_on(low: Any, high: Any, unclear: Any) -> Any:
        return (high - low > fine) & ~unclear

    state = (mi.Float(0), dr.full(mi.Float, 1, dr.width(mine)), mi.Bool(False))
    found: Any = dr.while_loop(state, goes_on, step, label="crossings")
    low, high, unclear = found
    dr.scatter(crossings, dr.select(unclear, -1, 0.5 * (low + high)), side.number)
    dr.eval(crossings)
    return crossings
