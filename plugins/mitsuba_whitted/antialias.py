"""Pixels to a target error: each is split where it must be, and edges are found instead of averaged over.

A cell, at first a pixel, has samples at its four corners, which it shares with its neighbours. Where their paths
are one (the same objects met and the same lights seen at every bounce) and their colours nearly linear, the mean of
the corners is its colour, or Simpson's rule with one sample more in its centre. A cell of two paths has an edge: where
that crosses the sides is found by bisection, how it is bent between by a search across the chord, and each side of it
counts by its area, with the colour at its centroid. Whatever does not bear this out is split into 4 x 4 cells.

Which cells need more than their corners is decided by the error that is left: cells are refined from the worst down
until the sum of the squares of all that is left meets the target (water-filling), and at every depth anew, with
what was seen until then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.tables import opaque

Look = Callable[[Any, Any, Any], tuple[Any, Any]]
"""From x, y (Float, pixels from the corner of the crop window) and a mask: colour and alpha, and number of the path.

Colours are Vector4f, paths UInt32: see `trace.Traced`.
"""

SPLIT = 2
"""A cell is split into so many by as many: 21 new samples. A power of two, so that all positions are exact."""

DEPTH = 5
"""How often a pixel can be split: to 1/64."""

BLOCK = 32
"""Pixels are numbered along a Z curve (Morton 1966) in squares of this side: neighbours in a launch are close."""

_NONE = 0xFFFFFFFF

SMOOTH, EDGE, CLUTTER = 0, 1, 2
"""Kinds of cells: one path; two paths with one edge between them; anything else."""


class _Cells(NamedTuple):
    """Cells of one size, and the lattice of samples that they have their corners in."""

    x: Any
    """Upper left corner."""
    y: Any
    corner: Any
    """Number of the sample there."""
    inside: Any
    """Whether the cell is part of the picture."""
    i: Any
    """Column and row in its lattice."""
    j: Any
    across: Any
    """Samples in a row of a lattice, and rows."""
    down: Any
    step: Any
    colours: Any
    paths: Any
    samples: int

    def rows(self, cell: Any) -> _Cells:
        """Only these cells."""
        parts = (dr.gather(type(part), part, cell) for part in self[:6])
        return _Cells(*parts, *self[6:])

    def colour(self, sample: Any) -> Any:
        return dr.gather(mi.Vector4f, self.colours, sample)

    def path(self, sample: Any) -> Any:
        return dr.gather(mi.UInt32, self.paths, sample)

    def corners(self) -> list[Any]:
        """Numbers of the samples at the corners, clockwise from the upper left."""
        return [self.corner, self.corner + 1, self.corner + self.across + 1, self.corner + self.across]


class _Estimate(NamedTuple):
    """What is known of each cell of a level."""

    value: Any
    """Colour and alpha, flat."""
    error: Any
    """What is expected to be wrong with it, times its share of the pixel."""
    kind: Any


def norm(c: Any) -> Any:
    """Root mean square over the colour channels: the picture's error counts them alike."""
    return dr.sqrt((c.x * c.x + c.y * c.y + c.z * c.z) * (1 / 3))


class Band(NamedTuple):
    """Rows of the picture, pixel by pixel in an order of their own."""

    x: Any
    y: Any
    """Column and row in the crop window."""
    inside: Any
    """Whether the lane holds a pixel at all."""
    colour: Any
    """Vector4f: colour and alpha."""


def refined(look: Look, width: int, top: int, bottom: int, target: float) -> Band:
    """Draw rows of the picture with a root mean square error of at most about `target`.

    Parameters
    ----------
    look
        Follows camera rays.
    width, top, bottom : int
        Of the crop window; the first row, and the first that is not drawn.
    target : float
        Linear radiance, over all pixels and channels.
    """
    cells = _pixels(look, width, top, bottom)
    value = _refine(look, cells, target, width * (bottom - top) * target**2, DEPTH)
    lane = dr.arange(mi.UInt32, dr.width(cells.inside))
    return Band(cells.i, cells.j + opaque(mi.UInt32(top)), cells.inside, dr.gather(mi.Vector4f, value, lane))


def _refine(look: Look, cells: _Cells, target: float, budget: float, depth: int) -> Any:
    """Estimate all cells, look closer at those that need it, and split those that need more."""
    estimate = _from_corners(cells)
    if not depth:
        return estimate.value
    tau = _water_level(_histogram(estimate, cells.inside, target), target, budget)
    wrong = (estimate.error > tau) & cells.inside
    # Kind by kind: the lanes of one vector then take about as many steps.
    close = [dr.compress(wrong & (estimate.kind == kind)) for kind in (SMOOTH, EDGE)]
    close = [cells_of_kind for cells_of_kind in close if dr.width(cells_of_kind)]
    if close:
        _look_closer(look, cells, estimate, dr.concat(close), tau)
        wrong = (estimate.error > tau) & cells.inside
    split = dr.compress(wrong)
    if dr.width(split):
        settled = _histogram(estimate, cells.inside & ~wrong, target)
        left = max(budget - float(np.sum(settled * _levels(target) ** 2)), LEAST_BUDGET * budget)
        parts = _parts(look, cells, split)
        values = _refine(look, parts, target, left, depth - 1)
        _roll_up(estimate.value, split, values)
    return estimate.value


def _pixels(look: Look, width: int, top: int, bottom: int) -> _Cells:
    """Sample all corners of pixels of a band."""
    height = bottom - top
    size = opaque(mi.Vector3u(width, height, top))
    across, down = size.x + 1, size.y + 1
    dr.make_opaque(across, down)

    i, j = _along_z_curve(width + 1, height + 1)
    held = (i < across) & (j < down)
    colour, path = look(mi.Float(i), mi.Float(j + size.z), held)
    samples = (width + 1) * (height + 1)
    colours, paths = dr.empty(mi.Float, 4 * samples), dr.empty(mi.UInt32, samples)
    dr.scatter(colours, colour, j * across + i, held)
    dr.scatter(paths, path, j * across + i, held)

    i, j = _along_z_curve(width, height)
    inside = (i < size.x) & (j < size.y)
    i, j = dr.minimum(i, size.x - 1), dr.minimum(j, size.y - 1)
    cells = _Cells(
        mi.Float(i), mi.Float(j + size.z), j * across + i, inside, i, j, across, down, opaque(mi.Float(1)),
        colours, paths, samples,
    )  # fmt: skip
    dr.eval(cells)
    return cells


def _along_z_curve(width: int, height: int) -> tuple[Any, Any]:
    """Columns and rows of a rectangle, and more beyond its edges: square by square, and in each along a Z curve."""
    blocks_across, blocks_down = -(-width // BLOCK), -(-height // BLOCK)
    lane = dr.arange(mi.UInt32, blocks_across * blocks_down * BLOCK * BLOCK)
    block, inner = lane // (BLOCK * BLOCK), lane % (BLOCK * BLOCK)
    across = opaque(mi.UInt32(blocks_across))
    return block % across * BLOCK + _even_bits(inner), block // across * BLOCK + _even_bits(inner >> 1)


def _even_bits(x: Any) -> Any:
    """Gather bits 0, 2, 4, 6 and 8."""
    x = x & 0x155
    x = (x | (x >> 1)) & 0x133
    x = (x | (x >> 2)) & 0x10F
    return (x | (x >> 4)) & 0x1F


def _parts(look: Look, cells: _Cells, split: Any) -> _Cells:
    """Split these cells, and take the samples that their parts need."""
    count, side = dr.width(split), SPLIT + 1
    colours, paths = dr.empty(mi.Float, 4 * count * side**2), dr.empty(mi.UInt32, count * side**2)
    step = opaque(cells.step / SPLIT)

    # Corners are known; the other samples, rows from top to bottom.
    lane = dr.arange(mi.UInt32, 4 * count)
    parent, k = lane // 4, lane % 4
    parents = cells.rows(dr.gather(mi.UInt32, split, parent))
    known = parents.corner + dr.select((k & 1) != 0, mi.UInt32(1), 0) + dr.select(k >= 2, cells.across, 0)
    at = parent * side**2 + dr.select((k & 1) != 0, mi.UInt32(SPLIT), 0) + dr.select(k >= 2, mi.UInt32(SPLIT * side), 0)
    dr.scatter(colours, cells.colour(known), at)
    dr.scatter(paths, cells.path(known), at)

    new = side**2 - 4
    lane = dr.arange(mi.UInt32, new * count)
    parent, k = lane // new, lane % new
    k += dr.select(k < SPLIT - 1, mi.UInt32(1), dr.select(k < new - (SPLIT - 1), mi.UInt32(2), 3))
    i, j = k % side, k // side
    parents = cells.rows(dr.gather(mi.UInt32, split, parent))
    colour, path = look(dr.fma(mi.Float(i), step, parents.x), dr.fma(mi.Float(j), step, parents.y), mi.Bool(True))
    dr.scatter(colours, colour, parent * side**2 + k)
    dr.scatter(paths, path, parent * side**2 + k)

    lane = dr.arange(mi.UInt32, SPLIT**2 * count)
    parent, k = lane // SPLIT**2, lane % SPLIT**2
    i, j = k % SPLIT, k // SPLIT
    parents = cells.rows(dr.gather(mi.UInt32, split, parent))
    across = opaque(mi.UInt32(side))
    parts = _Cells(
        dr.fma(mi.Float(i), step, parents.x), dr.fma(mi.Float(j), step, parents.y),
        parent * side**2 + j * across + i, dr.full(mi.Bool, True, SPLIT**2 * count),
        i, j, across, across, step, colours, paths, count * side**2,
    )  # fmt: skip
    dr.eval(parts)
    return parts


def _from_corners(cells: _Cells) -> _Estimate:
    """Estimate each cell from its corners, and what is wrong with that."""
    corners = cells.corners()
    colours = [cells.colour(sample) for sample in corners]
    paths = [cells.path(sample) for sample in corners]
    changes = [paths[k] != paths[(k + 1) % 4] for k in range(4)]
    crossed = sum(dr.select(change, mi.UInt32(1), 0) for change in changes)
    # Two crossed sides part the corners into two groups, each of neighbours: then it is two paths.
    kind = dr.select(crossed == 0, mi.UInt32(SMOOTH), dr.select(crossed == 2, mi.UInt32(EDGE), mi.UInt32(CLUTTER)))

    mean = (colours[0] + colours[1] + colours[2] + colours[3]) * 0.25
    low = dr.minimum(dr.minimum(colours[0], colours[1]), dr.minimum(colours[2], colours[3]))
    high = dr.maximum(dr.maximum(colours[0], colours[1]), dr.maximum(colours[2], colours[3]))
    area = cells.step * cells.step
    bent = _bend(cells) * (1 / 12)
    error = area * dr.maximum(
        bent, norm(high - low) * dr.select(kind == SMOOTH, dr.select(cells.step < 1, STEP, 0), MIXED)
    )
    count = dr.width(cells.x)
    value = dr.empty(mi.Float, 4 * count)
    dr.scatter(value, mean, dr.arange(mi.UInt32, count))
    estimate = _Estimate(value, error, kind)
    dr.eval(estimate)
    return estimate


def _bend(cells: _Cells) -> Any:
    """Second differences of the colour along the four sides: of each four samples in a row, both.

    They are taken across edges too, so that cells next to an edge, where small things are often missed, get a
    sample in the centre.
    """

    def along(at: Any, size: Any, stride: Any, from_other: Any, other_stride: Any) -> Any:
        first = mi.UInt32(dr.clip(mi.Int32(at) - 1, 0, dr.maximum(mi.Int32(size) - 4, 0)))
        bend = mi.Float(0)
        for side in range(2):
            start = cells.corner - at * stride + first * stride + side * other_stride
            c = [dr.gather(mi.Vector4f, cells.colours, start + n * stride, first + n < size) for n in range(4)]
            for n in range(2):
                whole = first + n + 2 < size
                bend = dr.maximum(bend, dr.select(whole, norm(c[n] - 2 * c[n + 1] + c[n + 2]), 0))
        return bend

    one = mi.UInt32(1)
    return along(cells.i, cells.across, one, cells.j, cells.across) + along(
        cells.j, cells.down, cells.across, cells.i, one
    )


def _histogram(estimate: _Estimate, active: Any, target: float) -> NDArray[np.float64]:
    """Count the errors of each kind of cell in quarters of an octave: (3, BINS).

    Whole numbers: their sum does not depend on the order in which threads come.
    """
    place = mi.Int32(dr.floor(4 * (dr.log2(estimate.error / opaque(mi.Float(target))) + OCTAVES_BELOW)))
    counts = dr.zeros(mi.UInt32, 3 * BINS)
    dr.scatter_add(
        counts, mi.UInt32(1), estimate.kind * BINS + mi.UInt32(dr.clip(place, 0, BINS - 1)), active & (place >= 0)
    )
    return np.array(counts, dtype=np.float64).reshape(3, BINS)


def _levels(target: float) -> NDArray[np.float64]:
    """Errors that the places of a histogram stand for."""
    levels: NDArray[np.float64] = target * 2.0 ** ((np.arange(BINS) + 0.5) / 4 - OCTAVES_BELOW)
    return levels


def _water_level(histogram: NDArray[np.float64], target: float, budget: float) -> float:
    """Find the error above which cells are refined, so that all that is left meets the budget."""
    levels = _levels(target)
    left = [np.sum(histogram * np.minimum(levels, LEFT[:, None] * tau) ** 2) for tau in levels]
    return float(levels[max(np.searchsorted(left, budget) - 1, 0)])


def _roll_up(value: Any, split: Any, values: Any) -> None:
    """Give each split cell the mean of its parts."""
    count = dr.width(split)
    lane = dr.arange(mi.UInt32, count) * SPLIT**2
    total = mi.Vector4f(0)
    for k in range(SPLIT**2):
        total += dr.gather(mi.Vector4f, values, lane + k)
    dr.scatter(value, total * (1 / SPLIT**2), split)
    dr.eval(value)


def _look_closer(look: Look, cells: _Cells, estimate: _Estimate, close: Any, tau: float) -> None:
    """Take samples inside cells of one path, and find the edge in those of two."""
    limit = opaque(mi.Float(tau))
    crossings = _crossings(look, cells, estimate, close, limit)
    here = cells.rows(close)
    corners = here.corners()
    colours = [here.colour(sample) for sample in corners]
    paths = [here.path(sample) for sample in corners]
    two = dr.gather(mi.UInt32, estimate.kind, close) == EDGE
    area = here.step * here.step

    in_a = [paths[k] == paths[0] for k in range(4)]
    corner_at = [mi.Point2f(0, 0), mi.Point2f(1, 0), mi.Point2f(1, 1), mi.Point2f(0, 1)]
    t = [dr.gather(mi.Float, crossings, side, two) for side in _sides(here)]
    crossing_at = [mi.Point2f(t[0], 0), mi.Point2f(1, t[1]), mi.Point2f(t[2], 1), mi.Point2f(0, t[3])]
    failed = mi.Bool(False)
    leave, enter = mi.Point2f(0), mi.Point2f(0)  # where the outline of A meets the edge
    doubled, moment = mi.Float(0), mi.Point2f(0)
    n_a = mi.Float(0)
    sum_a, sum_b = mi.Vector4f(0), mi.Vector4f(0)
    for k in range(4):
        m = (k + 1) % 4
        n_a += dr.select(in_a[k], 1.0, 0.0)
        sum_a += dr.select(in_a[k], colours[k], 0)
        sum_b += dr.select(in_a[k], 0, colours[k])
        crossed = in_a[k] != in_a[m]
        failed |= crossed & (t[k] < 0)
        leave = dr.select(in_a[k] & crossed, crossing_at[k], leave)
        enter = dr.select(in_a[m] & crossed, crossing_at[k], enter)
        p = dr.select(in_a[k], corner_at[k], crossing_at[k])
        q = dr.select(in_a[m], corner_at[m], crossing_at[k])
        part = dr.select(in_a[k] | in_a[m], p.x * q.y - p.y * q.x, 0)
        doubled += part
        moment += (p + q) * part
    part = leave.x * enter.y - leave.y * enter.x
    doubled += part
    moment += (leave + enter) * part
    area_a = doubled * 0.5
    centroid_a = dr.select(area_a > 1e-6, moment / (3 * doubled), corner_at[0])
    centroid_b = dr.select(area_a < 1 - 1e-6, (mi.Point2f(0.5) - area_a * centroid_a) / (1 - area_a), leave)

    mean_a, mean_b = sum_a / n_a, sum_b / dr.maximum(4 - n_a, 1)
    path_a, path_b = paths[0], dr.select(in_a[1], dr.select(in_a[2], paths[3], paths[2]), paths[1])
    contrast = norm(mean_a - mean_b)
    # Where both sides of an edge have nearly the same colour, what counts is whether the centre has it too.
    is_edge = two & (area * contrast * MIXED > limit)
    failed &= is_edge
    chord = enter - leave
    length = dr.norm(chord)
    middle = (leave + enter) * 0.5
    across = mi.Point2f(-chord.y, chord.x) / dr.maximum(length, 1e-6)
    across = dr.select(dr.dot(centroid_a - middle, across) > 0, -across, across)  # away from A
    weight = area * contrast
    # Bounds of the area between chord and edge, and of what a sample at a centroid can change.
    fine = limit / (BENT * weight * length)
    fine = dr.maximum(fine, 2.0**-10)
    searches = is_edge & (fine < SEARCH_BELOW)
    ask_a = is_edge & (area_a * weight * ASK > limit)
    ask_b = is_edge & ((1 - area_a) * weight * ASK > limit)

    SEARCHING, AT_A, AT_B, IN_CENTRE, OVER = range(5)

    def following(phase: Any, asked_a: Any, asked_b: Any) -> Any:
        after_a = dr.select(asked_b, mi.UInt32(AT_B), OVER)
        after_search = dr.select(asked_a, mi.UInt32(AT_A), after_a)
        return dr.select(phase == SEARCHING, after_search, dr.select(phase == AT_A, after_a, OVER))

    start = dr.select(
        is_edge,
        dr.select(searches, mi.UInt32(SEARCHING), following(mi.UInt32(SEARCHING), ask_a, ask_b)),
        mi.UInt32(IN_CENTRE),
    )
    start = dr.select(failed, mi.UInt32(OVER), start)

    def step(phase: Any, direction: Any, low: Any, high: Any, colour_a: Any, colour_b: Any, failed: Any) -> Any:
        first = direction == 0
        open_end = high > 1
        bulge = dr.select(first, 0, dr.select(open_end, dr.maximum(fine, 4 * low), 0.5 * (low + high)))
        at = dr.select(
            phase == SEARCHING,
            middle + direction * bulge * across,
            dr.select(phase == AT_A, centroid_a, dr.select(phase == AT_B, centroid_b, mi.Point2f(0.5))),
        )
        alive = phase != OVER
        colour, path = look(dr.fma(at.x, here.step, here.x), dr.fma(at.y, here.step, here.y), alive)
        to_a, to_b = norm(colour - mean_a), norm(colour - mean_b)
        like = dr.minimum(to_a, to_b) * area <= dr.minimum(ALIKE * weight, UNLIKE * limit)
        is_a = (path == path_a) | ((path != path_b) & like & (to_a < to_b))
        known = (path == path_a) | (path == path_b) | like

        searching = phase == SEARCHING
        turn = dr.select(is_a, mi.Float(1), -1)
        beyond = is_a == (direction > 0)  # the edge is still further out
        low_next = dr.select(searching & ~first & beyond, bulge, low)
        high_next = dr.select(searching & ~first & ~beyond, bulge, high)
        found = ~first & (high_next - low_next <= fine * 1.001)
        failed = failed | (searching & (~known | (low_next > 0.25)))
        failed |= (phase == AT_A) & ~(known & is_a)
        failed |= (phase == AT_B) & ~(known & ~is_a)
        failed |= (phase == IN_CENTRE) & (path != path_a) & (path != path_b)
        colour_a = dr.select((phase == AT_A) | (phase == IN_CENTRE), colour, colour_a)
        colour_b = dr.select(phase == AT_B, colour, colour_b)
        next_phase = dr.select(searching & ~found, phase, following(phase, ask_a, ask_b))
        next_phase = dr.select(failed | ~alive, mi.UInt32(OVER), next_phase)
        direction = dr.select(searching & first, turn, direction)
        return next_phase, direction, low_next, high_next, colour_a, colour_b, failed

    state = (start, mi.Float(0), mi.Float(0), mi.Float(2), mi.Vector4f(mean_a), mi.Vector4f(mean_b), failed)
    _, direction, low, high, colour_a, colour_b, failed = dr.while_loop(
        state, lambda phase, *_: phase != OVER, step, label="edges"
    )

    bulge = direction * 0.5 * (low + dr.select(high > 1, low, high))
    area_a = dr.clip(area_a + bulge * length * (2 / 3), 0, 1)
    edge_value = colour_a * area_a + colour_b * (1 - area_a)
    off = norm(colour_a - mean_a) * area_a + norm(colour_b - mean_b) * (1 - area_a)
    mean = (sum_a + sum_b) * 0.25
    centre_value = (mean + 2 * colour_a) * (1 / 3)  # Simpson's rule where the colour is a quadratic function
    value = dr.select(is_edge, edge_value, centre_value)
    error = area * dr.select(is_edge, off * OFF, norm(colour_a - mean) * SIMPSON)
    error = dr.select(is_edge, dr.maximum(error, 0.5 * dr.minimum(limit, weight)), error)
    error = dr.select(failed, dr.inf, error)
    dr.eval(value, error)  # here, since every scatter may start a kernel of its own
    good = error <= limit
    dr.scatter(estimate.value, value, close, good)
    dr.scatter(estimate.error, error, close, good)
    dr.eval(estimate)


def _sides(cells: _Cells) -> list[Any]:
    """Numbers of the four sides, clockwise from the top: two for each sample, to the right and down."""
    upper_left, upper_right, _, lower_left = cells.corners()
    return [2 * upper_left, 2 * upper_right + 1, 2 * lower_left, 2 * upper_left + 1]


def _crossings(look: Look, cells: _Cells, estimate: _Estimate, close: Any, limit: Any) -> Any:
    """Where edges cross the sides of these cells: by number of the side, in parts of it; -1 where it is unclear."""
    crossings = dr.zeros(mi.Float, 2 * cells.samples)
    lane = dr.arange(mi.UInt32, 4 * dr.width(close))
    cell, k = dr.gather(mi.UInt32, close, lane // 4), lane % 4
    here = cells.rows(cell)
    right, below = here.corner + 1, here.corner + here.across
    horizontal = (k & 1) == 0
    begin = dr.select(k == 1, right, dr.select(k == 2, below, here.corner))
    end = begin + dr.select(horizontal, mi.UInt32(1), here.across)
    crossed = (dr.gather(mi.UInt32, estimate.kind, cell) == EDGE) & (here.path(begin) != here.path(end))
    side = 2 * begin + dr.select(horizontal, mi.UInt32(0), 1)
    # A side belongs to two cells: the first of them sees to it.
    owner = dr.full(mi.UInt32, _NONE, 2 * cells.samples)
    dr.scatter_reduce(dr.ReduceOp.Min, owner, lane, side, crossed)
    mine = dr.compress(crossed & (dr.gather(mi.UInt32, owner, side) == lane))
    if not dr.width(mine):
        return crossings

    cell, k = dr.gather(mi.UInt32, close, mine // 4), mine % 4
    here = cells.rows(cell)
    right, below = here.corner + 1, here.corner + here.across
    horizontal = (k & 1) == 0
    begin = dr.select(k == 1, right, dr.select(k == 2, below, here.corner))
    end = begin + dr.select(horizontal, mi.UInt32(1), here.across)
    x = here.x + dr.select(k == 1, here.step, 0)
    y = here.y + dr.select(k == 2, here.step, 0)
    dx, dy = dr.select(horizontal, here.step, 0), dr.select(horizontal, 0, here.step)
    colour_0, colour_1, path_0, path_1 = here.colour(begin), here.colour(end), here.path(begin), here.path(end)
    contrast = norm(colour_0 - colour_1)
    width = limit / (here.step * here.step * contrast * CROSSING)

    def step(low: Any, high: Any, unclear: Any) -> Any:
        middle = 0.5 * (low + high)
        colour, path = look(dr.fma(middle, dx, x), dr.fma(middle, dy, y), mi.Bool(True))
        to_0, to_1 = norm(colour - colour_0), norm(colour - colour_1)
        like = dr.minimum(to_0, to_1) * here.step * here.step <= dr.minimum(
            ALIKE * contrast * here.step * here.step, UNLIKE * limit
        )
        at_0 = (path == path_0) | ((path != path_1) & like & (to_0 < to_1))
        unclear = unclear | ~((path == path_0) | (path == path_1) | like)
        return dr.select(at_0, middle, low), dr.select(at_0, high, middle), unclear

    low, high, unclear = dr.while_loop(
        (mi.Float(0), dr.full(mi.Float, 1, dr.width(mine)), mi.Bool(False)),
        lambda low, high, unclear: (high - low > dr.maximum(width, 2.0**-10)) & ~unclear,
        step,
        label="crossings",
    )
    side = 2 * begin + dr.select(horizontal, mi.UInt32(0), 1)
    dr.scatter(crossings, dr.select(unclear, -1, 0.5 * (low + high)), side)
    dr.eval(crossings)
    return crossings


MIXED = 0.3
STEP = 0.1
LEFT = np.array([0.4, 0.5, 1.2])
LEAST_BUDGET = 0.05
OCTAVES_BELOW, BINS = 8, 96
CROSSING = 0.4
BENT = 1.6
SEARCH_BELOW = 0.125
ASK = 0.5
ALIKE = 0.1
UNLIKE = 1.0
OFF = 0.25
SIMPSON = 0.15
