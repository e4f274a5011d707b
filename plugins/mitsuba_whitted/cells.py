"""Cells that pixels are split into, and the lattices of samples at their corners."""

from __future__ import annotations

import functools
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.tables import opaque

Look = Callable[[Any, Any, Any], tuple[Any, Any]]
"""From x, y (Float, pixels from the corner of the crop window) and a mask: colour and alpha, and number of the path.

Colours are Vector4f, paths UInt32: see `trace.Traced`.
"""

BLOCK = 32
"""Pixels are numbered along a Z curve (Morton 1966) in squares of this side: neighbours in a launch are close."""


class Kind(IntEnum):
    """What the samples at the corners of a cell say of it."""

    SMOOTH = 0
    """One path."""
    EDGE = 1
    """Two paths, and one edge between them."""
    CLUTTER = 2
    """Anything else."""


class Estimate(NamedTuple):
    """What is known of each cell so far."""

    value: Any
    """Colour and alpha, four numbers a cell; of `some` cells a Vector4f."""
    error: Any
    """What is expected to be wrong with the colour, times the cell's share of the pixel."""
    kind: Any
    surprise: Any
    """What a sample met that was not expected: see `met`; 0 where none did. A look ends with the first such sample."""

    def some(self, cell: Any) -> Estimate:
        """Pick what is known of the cells with these numbers."""
        kinds = mi.Vector4f, mi.Float, mi.UInt32, mi.UInt32
        return Estimate(*(dr.gather(kind, part, cell) for kind, part in zip(kinds, self, strict=True)))

    @staticmethod
    def met(place: Any, hides: Any) -> Any:
        """Tell by one number the place (`places.numbered`) of a sample that did not fit, and whether something hides.

        Where the corners have one path it does if the sample has another, or its colour is further off than theirs
        range: else it is mostly a bend. Where an edge parts them, it does if it is of the part beyond the edge, too far
        from that for a bulge, as of a strip that a corner has met: else it is mostly another edge.
        """
        return 2 * place + dr.select(hides, mi.UInt32(1), 0)

    def place(self) -> Any:
        """Tell the number of the place where a sample did not fit; 0 where all did."""
        return self.surprise // 2

    def surprised(self) -> Any:
        """Tell the cells of one path with a sample that did not fit."""
        return (self.kind == Kind.SMOOTH.value) & (self.surprise > 0)

    def hides(self) -> Any:
        """Tell the cells where something hides that parts of them may miss."""
        return self.surprise % 2 == 1


class Cells(NamedTuple):
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
    """Side of a cell, in pixels."""
    colours: Any
    paths: Any
    samples: int
    """Of all lattices together."""

    def some(self, cell: Any) -> Cells:
        """Pick the cells with these numbers."""
        x, y, corner, inside, i, j = (dr.gather(type(part), part, cell) for part in self[:6])
        return self._replace(x=x, y=y, corner=corner, inside=inside, i=i, j=j)

    def colour(self, sample: Any, active: Any = True) -> Any:
        """Colour and alpha of samples, by number; 0 where not `active`."""
        return dr.gather(mi.Vector4f, self.colours, sample, active)

    def path(self, sample: Any) -> Any:
        """Numbers of their paths."""
        return dr.gather(mi.UInt32, self.paths, sample)

    def corners(self) -> list[Any]:
        """Numbers of the samples at the corners, clockwise from the upper left."""
        return [self.corner, self.corner + 1, self.corner + self.across + 1, self.corner + self.across]


def extent(colours: list[Any]) -> tuple[Any, Any]:
    """Least and greatest of each channel."""
    return functools.reduce(dr.minimum, colours), functools.reduce(dr.maximum, colours)


def square(c: Any) -> Any:
    """Mean square over the colour channels: the picture's error counts them alike."""
    return (c.x * c.x + c.y * c.y + c.z * c.z) * (1 / 3)


def norm(c: Any) -> Any:
    """Root mean square over the colour channels."""
    return dr.sqrt(square(c))


def pixels(look: Look, width: int, top: int, bottom: int) -> Cells:
    """Sample all corners of the pixels of rows `top` to `bottom`, and make a cell of each; not evaluated."""
    height = bottom - top
    size = opaque(mi.Vector3u(width, height, top))
    across, down = size.x + 1, size.y + 1
    dr.make_opaque(across, down)

    # In the order of the pixels, then the right border from the top to the corner, then the lower one.
    count = _lanes(width, height)
    lane, lanes = dr.arange(mi.UInt32, count + width + height + 1), opaque(mi.UInt32(count))
    i, j = _along_z_curve(lane, width)
    beyond = lane - lanes
    border, right = lane >= lanes, beyond < down
    i = dr.select(border, dr.select(right, size.x, beyond - down), i)
    j = dr.select(border, dr.select(right, beyond, size.y), j)
    held = border | ((i < size.x) & (j < size.y))
    colour, path = look(mi.Float(i), mi.Float(j + size.z), held)
    samples = (width + 1) * (height + 1)
    colours, paths = dr.empty(mi.Float, 4 * samples), dr.empty(mi.UInt32, samples)
    dr.scatter(colours, colour, j * across + i, held)
    dr.scatter(paths, path, j * across + i, held)

    i, j = _along_z_curve(dr.arange(mi.UInt32, count), width)
    inside = (i < size.x) & (j < size.y)
    i, j = dr.minimum(i, size.x - 1), dr.minimum(j, size.y - 1)
    x, y, step = mi.Float(i), mi.Float(j + size.z), opaque(mi.Float(1))
    return Cells(x, y, j * across + i, inside, i, j, across, down, step, colours, paths, samples)


def _lanes(width: int, height: int) -> int:
    """Count the lanes that hold a rectangle square by square, and more beyond its edges."""
    return -(-width // BLOCK) * -(-height // BLOCK) * BLOCK * BLOCK


def _along_z_curve(lane: Any, width: int) -> tuple[Any, Any]:
    """Columns and rows of a rectangle, and more beyond its edges: square by square, and in each along a Z curve."""
    block, inner = lane // (BLOCK * BLOCK), lane % (BLOCK * BLOCK)
    across = opaque(mi.UInt32(-(-width // BLOCK)))
    return block % across * BLOCK + _even_bits(inner), block // across * BLOCK + _even_bits(inner >> 1)


def _even_bits(x: Any) -> Any:
    """Gather bits 0, 2, 4, 6 and 8."""
    x = x & 0x155  # not in place: the lane is used again
    x = (x | (x >> 1)) & 0x133
    x = (x | (x >> 2)) & 0x10F
    return (x | (x >> 4)) & 0x1F


def picked(wanted: Any, edge: Any) -> Any:
    """Numbers of the wanted cells: in each run of so many, of pixels a square, those with an edge come first.

    They take more samples than others, and a vector as many as the longest of its lanes; yet its rays must stay close.
    """
    run, count = BLOCK * BLOCK, dr.width(wanted)
    turn = dr.select(wanted, dr.select(edge, mi.UInt32(1), 2), 0)
    lane = dr.arange(mi.UInt32, 2 * run * -(-count // run))  # each run twice: for edges, then for the others
    cell, other = lane // (2 * run) * run + lane % run, lane // run % 2
    of_cell = dr.gather(mi.UInt32, turn, cell, cell < opaque(mi.UInt32(count)))
    place = dr.compress(of_cell == other + 1)
    if not dr.width(place):  # Dr.Jit divides no array of none by a number
        return place
    return place // (2 * run) * run + place % run


def quarters(look: Look, cells: Cells, split: Any) -> Cells:
    """Split the cells with these numbers into four each, row by row, and take the five samples that those lack.

    They are not evaluated yet.
    """
    count, samples = dr.width(split), 9 * dr.width(split)
    colours, paths = dr.empty(mi.Float, 4 * samples), dr.empty(mi.UInt32, samples)
    step = opaque(cells.step / 2)

    lane = dr.arange(mi.UInt32, 4 * count)
    parent, k = lane // 4, lane % 4
    parents = cells.some(dr.gather(mi.UInt32, split, parent))
    i, j = k & 1, k >> 1
    x, y = dr.fma(mi.Float(i), step, parents.x), dr.fma(mi.Float(j), step, parents.y)
    known = parents.corner + i + j * cells.across
    at = 9 * parent + 2 * i + 6 * j
    dr.scatter(colours, cells.colour(known), at)
    dr.scatter(paths, cells.path(known), at)
    side = opaque(mi.UInt32(3))
    whole = dr.full(mi.Bool, True, 4 * count)
    parts = Cells(x, y, 9 * parent + i + 3 * j, whole, i, j, side, side, step, colours, paths, samples)

    lane = dr.arange(mi.UInt32, 5 * count)
    parent, k = lane // 5, lane % 5
    k += dr.select(k == 0, mi.UInt32(1), dr.select(k < 4, mi.UInt32(2), 3))  # 1, 3, 4, 5, 7 of a lattice of 3 x 3
    parents = cells.some(dr.gather(mi.UInt32, split, parent))
    x, y = dr.fma(mi.Float(k % 3), step, parents.x), dr.fma(mi.Float(k // 3), step, parents.y)
    colour, path = look(x, y, mi.Bool(True))
    dr.scatter(colours, colour, 9 * parent + k)
    dr.scatter(paths, path, 9 * parent + k)
    return parts
