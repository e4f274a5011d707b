"""A cell that an edge cuts in two: its parts along the chord, and what their colours are in between."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.cells import Cells
from mitsuba_whitted.crossings import FINEST, sides

TINY = 1e-6
"""Area, in squares of a side, below which a centroid would be noise; float32 knows corners to 6e-8 of a side."""

LEVEL = 1e-6
"""Added to the squares of distances, in sides, that a plane is fitted by: through one corner it is level across, and
where two are near each other it does not rise out of their rounding.
"""


class Parts(NamedTuple):
    """A cell cut in two by the chord of an edge; A holds the first corner. In sides of the cell."""

    area_a: Any
    centroid_a: Any
    centroid_b: Any
    mean_a: Any
    """Mean of the colours at A's corners."""
    mean_b: Any
    path_a: Any
    path_b: Any
    corners: list[Any]
    """Colours of the cell's corners, clockwise from the upper left."""
    in_a: list[Any]
    """Whether they are A's."""
    rise: list[Any]
    """Of each corner: the slope of a plane that is 1 there and 0 at the centroid and the other corners of its part, as
    nearly as it can be."""
    middle: Any
    """Of the chord."""
    length: Any
    away: Any
    """Unit vector across the chord, from A to B."""
    unclear: Any
    """How far off a colour is that was met where a crossing of one of the sides was not found; 0 where all were."""

    def expected(self, is_a: Any, colour_a: Any, colour_b: Any, at: Any) -> Any:
        """Continue the colour of a part from its centroid by the plane that fits it and the part's corners best."""
        colour = dr.select(is_a, colour_a, colour_b)
        out = at - dr.select(is_a, self.centroid_a, self.centroid_b)
        change = mi.Vector4f(0)
        for corner, in_a, rise in zip(self.corners, self.in_a, self.rise, strict=True):
            change += dr.select(in_a == is_a, dr.dot(rise, out), 0) * (corner - colour)
        return colour + change

    def beyond(self, bulge: Any, at: Any) -> Any:
        """How far a point lies beyond the edge, from A to B: a parabola over the chord, `bulge` high towards B.

        Past its ends, where the edge has left the cell, it goes on straight: the parabola would rise far over a short
        chord.
        """
        out = at - self.middle
        along = mi.Vector2f(-self.away.y, self.away.x)
        share = 2 * dr.dot(out, along) * dr.rcp(dr.maximum(self.length, FINEST))
        return dr.dot(out, self.away) - bulge * dr.maximum(1 - share * share, 0)


def cut(here: Cells, crossings: Any, two: Any) -> Parts:
    """Cut cells along the chords of their edges: the outline of A is followed clockwise, and closed by the chord."""
    corners = here.corners()
    colours = [here.colour(sample) for sample in corners]
    paths = [here.path(sample) for sample in corners]
    in_a = [path == paths[0] for path in paths]
    corner_at = [mi.Point2f(0, 0), mi.Point2f(1, 0), mi.Point2f(1, 1), mi.Point2f(0, 1)]
    t = [dr.gather(mi.Float, crossings, side, two) for side in sides(here)]
    crossing_at = [mi.Point2f(t[0], 0), mi.Point2f(1, t[1]), mi.Point2f(t[2], 1), mi.Point2f(0, t[3])]

    unclear = mi.Float(0)
    leaves, enters, moment = mi.Point2f(0), mi.Point2f(0), mi.Point2f(0)
    doubled, count = mi.Float(0), mi.Float(0)  # twice the area; corners
    sum_a, sum_b = mi.Vector4f(0), mi.Vector4f(0)
    for k in range(4):
        m = (k + 1) % 4
        crossed = in_a[k] != in_a[m]
        unclear = dr.maximum(unclear, dr.select(crossed, -t[k], 0))
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

    area_a = 0.5 * doubled
    centroid_a = dr.select(area_a > TINY, moment * dr.rcp(3 * doubled), corner_at[0])
    centroid_b = dr.select(area_a < 1 - TINY, (mi.Point2f(0.5) - area_a * centroid_a) * dr.rcp(1 - area_a), leaves)
    path_b = dr.select(in_a[1], dr.select(in_a[2], paths[3], paths[2]), paths[1])
    chord, middle = enters - leaves, (leaves + enters) * 0.5
    length = dr.norm(chord)
    across = mi.Point2f(-chord.y, chord.x) * dr.rcp(dr.maximum(length, FINEST))
    away = dr.select(dr.dot(centroid_a - middle, across) > 0, -across, across)
    mean_a, mean_b = sum_a * dr.rcp(count), sum_b * dr.rcp(dr.maximum(4 - count, 1))
    rise = _rise(in_a, [corner_at[k] - dr.select(in_a[k], centroid_a, centroid_b) for k in range(4)])
    return Parts(
        area_a, centroid_a, centroid_b, mean_a, mean_b, paths[0], path_b, colours, in_a, rise, middle, length, away,
        unclear,
    )  # fmt: skip


def _rise(in_a: list[Any], out: list[Any]) -> list[Any]:
    """Fit planes through 0 at the centroid to the corners of each part, which are `out` from it, by least squares.

    Where a part has one corner only, the plane is level across the way to it.
    """
    rises = []
    for part in range(2):
        own = [dr.select(a if part == 0 else ~a, o, 0) for a, o in zip(in_a, out, strict=True)]
        xx, yy = (LEVEL + sum(o[axis] * o[axis] for o in own) for axis in range(2))
        xy = sum(o.x * o.y for o in own)
        scale = dr.rcp(xx * yy - xy * xy)
        rises.append([scale * mi.Vector2f(yy * o.x - xy * o.y, xx * o.y - xy * o.x) for o in own])
    return [dr.select(a, of_a, of_b) for a, of_a, of_b in zip(in_a, *rises, strict=True)]
