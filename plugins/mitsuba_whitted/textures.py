"""Textures as tables: where a surface's coordinates lead is computed in double, what colour is there in single.

Mitsuba's own textures do all of it in single: a place in a picture of n texels is then off by some u n texels, and a
bilinear colour by that times the step from one texel to the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.bitmaps import bitmap_of, to_uv_of
from mitsuba_whitted.scene_graph import SceneGraph, Stamp, number
from mitsuba_whitted.tables import double_column, fetch, index_column, stored

LUMINANCE = np.array([[0.212671], [0.715160], [0.072169]], np.float32)
"""Weights by which Mitsuba makes one channel of three (Rec. 709), in single precision as there."""

_MIRROR, _CLAMP, _BILINEAR = 1, 2, 4


class _Row(NamedTuple):
    """One texture: a checkerboard of two others, or a picture."""

    to_uv: NDArray[np.float64]
    """Two rows (a, b, c): the coordinates within the texture are a u + b v + c."""
    squares: tuple[int, int] = (0, 0)
    """Numbers of the two textures of a checkerboard."""
    first: int = 0
    """Number of a picture's first texel."""
    size: tuple[int, int] = (1, 1)
    """Width and height of a picture, in texels."""
    flags: int = 0


_ANYWHERE = np.zeros((2, 3))
"""The to_uv of a single colour."""


def textures_of(graph: SceneGraph, roots: list[mi.Texture]) -> Textures:
    """Give the tables of textures, the same again until one of these is edited."""
    kept: Textures | None = graph.kept.get(tuple(roots))
    if kept is None or not kept.stamp.is_current():
        kept = graph.kept[tuple(roots)] = Textures(graph, roots)
    return kept


def constant(texture: mi.Texture) -> list[float] | None:
    """Colour of a texture that is the same everywhere, a number a channel; None where it is not."""
    if texture.is_spatially_varying():
        return None
    value = texture.eval(dr.zeros(mi.SurfaceInteraction3f))
    return [number(channel) for channel in value]


class Textures:
    """Some checkerboards and bitmaps, with those inside them.

    Parameters
    ----------
    graph : SceneGraph
        Knows the textures inside textures.
    roots : list of Texture
        ``roots[i]`` becomes number ``numbers[i]``; number 0 is none.
    """

    def __init__(self, graph: SceneGraph, roots: list[mi.Texture]) -> None:
        self._graph = graph
        self._channels = dr.size_v(mi.Spectrum)
        self._rows = [_Row(_ANYWHERE)]
        self._texels = [np.zeros((1, self._channels), np.float32)]
        self._known: dict[mi.Texture, int] = {}
        self.numbers = [self._number_of(texture) for texture in roots]
        self.stamp: Stamp = graph.stamp(self._known)

        rows = self._rows
        self._across = double_column([*row.to_uv[0], row.size[0]] for row in rows)
        self._up = double_column([*row.to_uv[1], row.size[1]] for row in rows)
        self._what = index_column([*row.squares, row.first, row.flags] for row in rows)
        self._colours = stored(np.concatenate(self._texels))
        self._texels.clear()
        # What no texture has is left out of kernels.
        self._nesting = max(self._depth(number) for number in self.numbers)
        self._pictures = any(row.size != (1, 1) for row in rows)
        self._bilinear = any(row.flags & _BILINEAR for row in rows)

    def at(self, number: Any, uv: Any, active: Any) -> Any:
        """Colour of texture `number` at the surface coordinates `uv`, in double."""
        if active is False:
            return mi.Spectrum(0)  # in scalar variants; coordinates of what was not hit need not be numbers
        for _ in range(self._nesting):
            what = fetch(mi.Vector4u, self._what, number, active)
            (x, _width), (y, _height) = self._place(number, uv, active)
            same = (x - dr.floor(x) > 0.5) == (y - dr.floor(y) > 0.5)
            number = dr.select(what.x != 0, dr.select(same, what.x, what.y), number)
        what = fetch(mi.Vector4u, self._what, number, active)
        first, flags = what.z, what.w
        if not self._pictures:
            return fetch(mi.Spectrum, self._colours, first, active)

        (x, width), (y, height) = self._place(number, uv, active)
        bilinear = (flags & _BILINEAR) != 0
        half = dr.select(bilinear, mi.Float64(0.5), mi.Float64(0))
        x, y = dr.fma(x, width, -half), dr.fma(y, height, -half)
        i, j = dr.floor(x), dr.floor(y)

        def texel(i: Any, j: Any, active: Any) -> Any:
            column, row = _wrapped(i, width, flags), _wrapped(j, height, flags)
            return fetch(mi.Spectrum, self._colours, first + row * mi.UInt32(width) + column, active)

        colour = texel(i, j, active)
        if not self._bilinear:
            return colour
        others = active & bilinear
        right, above, both = texel(i + 1, j, others), texel(i, j + 1, others), texel(i + 1, j + 1, others)
        x, y = mi.Float(x - i), mi.Float(y - j)
        return dr.select(bilinear, _between(_between(colour, right, x), _between(above, both, x), y), colour)

    def squares(self, number: Any, uv: Any, active: Any) -> Iterator[Any]:
        """Tell the squares of a checkerboard and the texels of a bitmap apart: the column and the row of that at `uv`.

        Texels are counted by halves: a bitmap steps where they meet, or bends in the middle of each.
        """
        for x, size in self._place(number, uv, active):
            yield mi.UInt32(mi.Int32(dr.floor(2 * size * x)))

    def _place(self, number: Any, uv: Any, active: Any) -> Iterator[tuple[Any, Any]]:
        """Give both coordinates within a texture, and its sizes."""
        for table in (self._across, self._up):
            row = fetch(mi.Vector4d, table, number, active)
            yield dr.fma(uv.x, row.x, dr.fma(uv.y, row.y, row.z)), row.w

    def _number_of(self, texture: mi.Texture) -> int:
        if texture not in self._known:
            row = self._row_of(texture)
            self._known[texture] = len(self._rows)
            self._rows.append(row)
        return self._known[texture]

    def _row_of(self, texture: mi.Texture) -> _Row:
        colour = constant(texture)
        first = sum(map(len, self._texels))
        if colour is not None:
            self._texels.append(np.array([(colour * self._channels)[: self._channels]], np.float32))
            return _Row(_ANYWHERE, first=first)
        graph = self._graph
        to_uv = to_uv_of(graph, texture)[:2]
        if is_checkerboard(texture):
            one, other = (self._number_of(graph.child(texture, name)) for name in ("color0", "color1"))
            return _Row(to_uv, squares=(one, other))
        bitmap = bitmap_of(graph, texture)
        height, width, channels = bitmap.stored.shape
        colours = bitmap.colours()
        if channels > self._channels:
            colours = (colours.astype(float) @ LUMINANCE).astype(np.float32)
        self._texels.append(np.broadcast_to(colours, (len(colours), self._channels)))
        flags = _BILINEAR * bitmap.bilinear + _MIRROR * (bitmap.wrap == "mirror") + _CLAMP * (bitmap.wrap == "clamp")
        return _Row(to_uv, first=first, size=(width, height), flags=flags)

    def _depth(self, number: int) -> int:
        squares = self._rows[number].squares
        return 1 + max(map(self._depth, squares)) if any(squares) else 0


def is_checkerboard(texture: mi.Texture) -> bool:
    """Whether a texture that varies is a checkerboard, and no bitmap."""
    return bool(texture.class_name().startswith("Checkerboard"))


def _wrapped(i: Any, size: Any, flags: Any) -> Any:
    """Tell which texel stands at place `i` of a row of `size` texels that goes on for ever."""
    period = dr.select((flags & _MIRROR) != 0, 2 * size, size)
    inside = i - period * dr.floor(i / period)
    inside = dr.minimum(inside, 2 * size - 1 - inside)  # the way back of a mirrored picture
    inside = dr.select((flags & _CLAMP) != 0, dr.clip(i, 0, size - 1), inside)
    # As unsigned numbers: a place that is none, or beyond what doubles count, is in the picture too.
    return dr.minimum(mi.UInt32(mi.Int32(inside)), mi.UInt32(size) - 1)


def _between(a: Any, b: Any, weight: Any) -> Any:
    return dr.fma(b - a, weight, a)
