"""Where edges cross the sides of cells: found by bisection, once for the two cells that share a side."""

from __future__ import annotations

from typing import Any

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


def _sought(cells: Cells, close: Any, two: Any) -> Any:
    """Tell which sides are to be sought of the cells `close`, if they have `two` paths: four a cell, as in `sides`.

    A side that two such cells share is sought by the upper or left one of them.
    """
    here = cells.some(close)
    marked = dr.zeros(mi.Bool, cells.samples)
    dr.scatter(marked, mi.Bool(True), here.corner, two)
    paths = [cells.path(sample) for sample in here.corners()]
    above = dr.gather(mi.Bool, marked, here.corner - here.across, two & (here.j > 0))
    left = dr.gather(mi.Bool, marked, here.corner - 1, two & (here.i > 0))
    sought = dr.empty(mi.Bool, 4 * dr.width(close))
    for k, elsewhere in enumerate((above, mi.Bool(False), mi.Bool(False), left)):
        crossed = two & (paths[k] != paths[(k + 1) % 4]) & ~elsewhere
        dr.scatter(sought, crossed, 4 * dr.arange(mi.UInt32, dr.width(close)) + k, mode=dr.ReduceMode.Permute)
    return sought


def crossings(look: Look, cells: Cells, close: Any, two: Any, limit: Any) -> Any:
    """Find where edges cross the sides of these cells: by number of the side, in parts of it.

    Where that is unclear a colour was met that is off, and the number is below 0 by how far. Nothing here depends on
    which of its two cells a side is seen from.
    """
    found = dr.zeros(mi.Float, 2 * cells.samples)
    mine: Any = dr.compress(_sought(cells, close, two))
    if not dr.width(mine):
        return found

    here, k = cells.some(dr.gather(mi.UInt32, close, mine // 4)), mine % 4
    top, right, bottom, left = sides(here)
    number = dr.select(k == 0, top, dr.select(k == 1, right, dr.select(k == 2, bottom, left)))
    begin, down = number // 2, number % 2 == 1
    end = begin + dr.select(down, here.across, 1)
    x, y = here.x + dr.select(k == 1, here.step, 0), here.y + dr.select(k == 2, here.step, 0)
    dx, dy = dr.select(down, 0, here.step), dr.select(down, here.step, 0)
    colours, paths = (cells.colour(begin), cells.colour(end)), (cells.path(begin), cells.path(end))
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
        matters = ~known & ~(high - low <= dr.minimum(2 * fine, negligible(off)))  # so does NaN, by any number
        unclear = dr.select(matters, dr.select(off > 0, off, 1), 0)
        return dr.select(at_begin, middle, low), dr.select(at_begin, high, middle), unclear

    def goes_on(low: Any, high: Any, unclear: Any) -> Any:
        return (high - low > fine) & (unclear == 0)

    state = (mi.Float(0), dr.full(mi.Float, 1, dr.width(mine)), mi.Float(0))
    bisected: Any = dr.while_loop(state, goes_on, step, label="crossings")
    low, high, unclear = bisected
    dr.scatter(found, dr.select(unclear > 0, -unclear, 0.5 * (low + high)), number)
    dr.eval(found)
    return found
