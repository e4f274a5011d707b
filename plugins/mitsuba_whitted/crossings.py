"""Where edges cross the sides of cells: found by bisection, once for the two cells that share a side."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells, Look, norm

# Fitted as told in `antialias`.

CROSSING = 0.3
"""Error of a cell, in parts of its contrast, for each part of a side within which the crossing is not known."""

ALIKE = 0.1
"""A third path is taken for that of the two whose colour it nearly has: within this part of the contrast."""

ALIKE_ERROR = 4.0
"""And within so many times the limit."""

FINEST = 2.0**-10
"""No position is sought finer than this part of a side: edges are not straighter than that."""


def belongs(colour: Any, path: Any, colours: Any, paths: Any, contrast: Any, limit: Any) -> tuple[Any, Any, Any]:
    """Tell whether a sample belongs to the first of two paths, to one at all, and how far it is off the nearer."""
    to_a, to_b = (norm(colour - end) for end in colours)
    off = dr.minimum(to_a, to_b)
    alike = off <= dr.minimum(ALIKE * contrast, ALIKE_ERROR * limit)
    is_a = (path == paths[0]) | ((path != paths[1]) & alike & (to_a < to_b))
    return is_a, (path == paths[0]) | (path == paths[1]) | alike, off


def sides(cells: Cells) -> list[Any]:
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


def crossings(look: Look, cells: Cells, close: Any, two: Any, limit: Any) -> Any:
    """Find where edges cross the sides of these cells: by number of the side, in parts of it; -1 where it is unclear.

    Nothing here depends on which of its two cells a side is seen from.
    """
    found = dr.zeros(mi.Float, 2 * cells.samples)
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
        return found

    side = _side(cells, close, mine)
    here = side.here
    x = here.x + dr.select(side.k == 1, here.step, 0)
    y = here.y + dr.select(side.k == 2, here.step, 0)
    dx, dy = dr.select(side.down, 0, here.step), dr.select(side.down, here.step, 0)
    colours = cells.colour(side.begin), cells.colour(side.end)
    paths = cells.path(side.begin), cells.path(side.end)
    contrast, area = norm(colours[0] - colours[1]), here.step * here.step

    def negligible(difference: Any) -> Any:
        """Part of a side that does not matter, if colours differ so much there."""
        return dr.maximum(limit / (CROSSING * area * difference), FINEST)

    fine = negligible(contrast)

    def step(low: Any, high: Any, unclear: Any) -> Any:
        middle = 0.5 * (low + high)
        colour, path = look(dr.fma(middle, dx, x), dr.fma(middle, dy, y), mi.Bool(True))
        at_begin, known, off = belongs(colour, path, colours, paths, contrast, limit / area)
        # What lies between fills no more than the step: nothing that matters in the last one, unless it is off by more
        # than half of what the two differ, or up to all of that where the step is narrow.
        unclear |= ~known & (high - low > dr.minimum(2 * fine, negligible(off)))
        return dr.select(at_begin, middle, low), dr.select(at_begin, high, middle), unclear

    def goes_on(low: Any, high: Any, unclear: Any) -> Any:
        return (high - low > fine) & ~unclear

    state = (mi.Float(0), dr.full(mi.Float, 1, dr.width(mine)), mi.Bool(False))
    sought: Any = dr.while_loop(state, goes_on, step, label="crossings")
    low, high, unclear = sought
    dr.scatter(found, dr.select(unclear, -1, 0.5 * (low + high)), side.number)
    dr.eval(found)
    return found
