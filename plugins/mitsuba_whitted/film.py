"""From samples to the picture: sub-pixels, reconstruction filter, and Mitsuba's film."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.tables import opaque

TILE = 4
"""Pixels are traced in squares of this side: the 16 lanes of a vector then follow neighbouring rays."""

SAMPLES_AT_ONCE = 1 << 24
"""Samples traced in one launch, unless one row has more: four floats each are kept until averaged."""

SAMPLES_BETWEEN_REPORTS = 1 << 20
"""The same where somebody watches the progress."""

Draw = Callable[[Any, Any, Any], tuple[Any, Any]]
"""From x, y (Float, pixels from the corner of the crop window) and a mask: colour, and whether anything was hit."""

Progress = Callable[[int, int], None]
"""Called with the number of rows done and of all rows."""


def expose(film: mi.Film, n: int, draw: Draw, progress: Progress | None = None) -> mi.TensorXf:
    """Draw the crop window of `film` with n x n samples a pixel, and leave the picture in the film too.

    With one sample a pixel, a box filter and nobody watching, nothing is evaluated here: tracing and storage
    become one kernel, run when somebody looks at the picture. The bytes are the same in any number of bands.

    Returns
    -------
    TensorXf
        (height, width, channels) of the crop window; the channels are the film's.
    """
    width, height = (int(size) for size in film.crop_size())
    box = _is_box(film.rfilter())
    canvas = _Canvas(film)
    at_once = SAMPLES_BETWEEN_REPORTS if progress else SAMPLES_AT_ONCE
    rows = min(height, TILE * max(1, at_once // (TILE * width * n * n)))
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        if box and n == 1 and dr.is_jit_v(mi.Float):
            pixel, x, y, inside = _tiles(width, top, bottom)
            canvas.put(top * width + pixel, *draw(x + 0.5, y + 0.5, inside), inside)
        elif box:
            canvas.put_rows(top, _means(_samples(width, top, bottom, n, draw), n))
        else:
            margin = math.ceil(float(film.rfilter().radius()) - 0.5)
            above, below = max(0, top - margin), min(height, bottom + margin)
            samples = _samples(width, above, below, n, draw)
            filtered = _filtered(np.array(samples).reshape(-1, below - above, width, n, n), film.rfilter())
            canvas.put_rows(top, filtered[:, top - above : bottom - above])
        if rows < height:
            canvas.evaluate()
        if progress:
            progress(bottom, height)
    return canvas.finish()


def _is_box(rfilter: mi.ReconstructionFilter) -> bool:
    """Whether a pixel is the plain mean of its own samples."""
    return rfilter.class_name() == "BoxFilter" and float(rfilter.radius()) == 0.5


def _tiles(width: int, top: int, bottom: int) -> tuple[Any, Any, Any, Any]:
    """Number, x and y of the pixels of a band, tile by tile, and whether they are inside it.

    The size of the band is data, so that no other size needs another kernel.
    """
    across, down = -(-width // TILE), -(-(bottom - top) // TILE)
    lane = dr.arange(mi.UInt32, across * down * TILE * TILE)
    size = opaque(mi.Vector4u(width, bottom - top, across, top))
    tile, inner = lane // (TILE * TILE), lane % (TILE * TILE)
    x = tile % size.z * TILE + inner % TILE
    y = tile // size.z * TILE + inner // TILE
    return y * size.x + x, mi.Float(x), mi.Float(y + size.w), (x < size.x) & (y < size.y)


def _samples(width: int, top: int, bottom: int, n: int, draw: Draw) -> Any:
    """Draw n x n samples of each pixel: flat (channels, pixel, n, n), the last channel 1 where something was hit."""
    count = width * (bottom - top) * n * n
    if not dr.is_jit_v(mi.Float):
        return np.concatenate(list(_one_by_one(width, top, bottom, n, draw))).reshape(count, -1).T
    size = opaque(mi.Vector3u(width, top, n))
    lane = dr.arange(mi.UInt32, count)
    # All samples of a pixel stand side by side, which keeps a vector's rays closer than tiles would.
    pixel, part = lane // (size.z * size.z), lane % (size.z * size.z)
    x = mi.Float(pixel % size.x) + (mi.Float(part % size.z) + 0.5) / mi.Float(size.z)
    y = mi.Float(pixel // size.x + size.y) + (mi.Float(part // size.z) + 0.5) / mi.Float(size.z)
    colour, hit = draw(x, y, mi.Bool(True))
    planes = [*colour, dr.select(hit, mi.Float(1), mi.Float(0))]
    samples = dr.empty(mi.Float, len(planes) * count)
    for i, plane in enumerate(planes):
        dr.scatter(samples, plane, lane + i * count, mode=dr.ReduceMode.Permute)
    dr.eval(samples)
    return samples


def _one_by_one(width: int, top: int, bottom: int, n: int, draw: Draw) -> Iterator[NDArray[np.float32]]:
    """Draw the samples in a variant without Dr.Jit, where a kernel is called like any function."""
    for y in range(top, bottom):
        for x in range(width):
            for part in range(n * n):
                colour, hit = draw(x + (part % n + 0.5) / n, y + (part // n + 0.5) / n, True)
                yield np.array([*colour, float(hit)], np.float32)


def _means(samples: Any, n: int) -> Any:
    """Average the samples of each pixel."""
    if dr.is_jit_v(mi.Float):
        return dr.block_sum(samples, n * n) * (1 / (n * n)) if n > 1 else samples
    return samples.reshape(len(samples), -1, n * n).mean(axis=2)


def _filtered(samples: NDArray[np.float32], rfilter: mi.ReconstructionFilter) -> NDArray[np.float32]:
    """Apply a separable filter to samples (channels, rows, columns, n, n).

    Every pixel is the mean of all samples in the filter's reach, weighted by the filter and by nothing else:
    summed in a fixed order, unlike Mitsuba's own splats, so that any filter gives the same bytes again.
    """
    n = samples.shape[-1]
    reach = math.ceil(float(rfilter.radius()) - 0.5)
    away = np.arange(-reach, reach + 1)[:, None] + (np.arange(n) + 0.5) / n - 0.5
    weights = np.array([[_weight(rfilter, float(x)) for x in row] for row in away])
    rows = np.einsum("cyxij,ti->ctyxj", samples, weights)
    rows = _gathered(rows, 2, reach)
    columns = _gathered(np.einsum("cyxj,tj->ctyx", rows, weights), 3, reach)
    ones = [_gathered(np.repeat(weights.sum(axis=1)[None, :, None], size, 2), 2, reach)[0] for size in samples.shape[1:3]]
    return (columns / (ones[0][:, None] * ones[1])).astype(np.float32)


def _gathered(parts: NDArray[np.float64], axis: int, reach: int) -> NDArray[np.float64]:
    """Add to each pixel what its neighbours along `axis` hold for it; axis 1 of `parts` counts the neighbours."""
    total = np.zeros_like(parts[:, 0])
    size = parts.shape[axis]
    for i in range(2 * reach + 1):
        step = i - reach  # the part of the neighbour `step` pixels further on
        to = [slice(None)] * total.ndim
        of = [slice(None)] * total.ndim
        to[axis - 1] = slice(max(0, -step), size - max(0, step))
        of[axis - 1] = slice(max(0, step), size - max(0, -step))
        total[tuple(to)] += parts[:, i][tuple(of)]
    return total


def _weight(rfilter: mi.ReconstructionFilter, x: float) -> float:
    value = rfilter.eval(mi.Float(x))
    return float(value[0]) if dr.is_jit_v(value) else float(value)


class _Canvas:
    """The picture under work, in the film's own layout (colour, alpha, weight) and in the user's."""

    def __init__(self, film: mi.Film) -> None:
        self._film = film
        self._width, self._height = (int(size) for size in film.crop_size())
        self._alpha = bool(film.flags() & +mi.FilmFlags.Alpha)
        self._channels = int(film.base_channels_count())
        colours = dr.size_v(mi.Spectrum)
        # XYZ, and the luminance of a colour picture, are for the film to compute.
        self._as_drawn = self._channels == colours + self._alpha and "pixel_format = xyz" not in str(film)
        pixels = self._width * self._height
        self._stored = dr.zeros(mi.TensorXf, (self._height, self._width, 4 + self._alpha)).array
        self._picture = dr.zeros(mi.TensorXf, (self._height, self._width, colours + self._alpha)).array
        self._pixels = pixels

    def put(self, pixel: Any, colour: Any, hit: Any, active: Any) -> None:
        """Store the colour of the pixels with these numbers, and whether anything was hit there."""
        alpha = [dr.select(hit, mi.Float(1), mi.Float(0))] if self._alpha else []
        self._scatter(pixel, [*colour], alpha, active)

    def put_rows(self, top: int, planes: Any) -> None:
        """Store whole rows from `top` on, given as (channels, pixel), the last channel the alpha."""
        channels = dr.size_v(mi.Spectrum) + 1
        if not dr.is_jit_v(mi.Float):
            planes = np.array(planes).reshape(channels, -1)
            first = top * self._width
            colour = planes[:-1]
            for buffer, parts in (
                (self._picture, [*colour, *planes[-1:][: self._alpha]]),
                (self._stored, [*np.broadcast_to(colour, (3, colour.shape[1])), *planes[-1:][: self._alpha], 1.0]),
            ):
                view = np.array(buffer).reshape(self._pixels, -1)
                for i, part in enumerate(parts):
                    view[first : first + planes.shape[1], i] = part
                buffer[:] = view.ravel()
            return
        flat = mi.Float(np.ascontiguousarray(planes).ravel()) if isinstance(planes, np.ndarray) else planes
        count = dr.width(flat) // channels
        lane = dr.arange(mi.UInt32, count)
        parts = [dr.gather(mi.Float, flat, lane + i * count) for i in range(channels)]
        self._scatter(lane + top * self._width, parts[:-1], parts[-1:] if self._alpha else [], mi.Bool(True))

    def evaluate(self) -> None:
        """Run what has been put so far."""
        dr.eval(self._stored, self._picture)

    def finish(self) -> mi.TensorXf:
        """Hand the picture to the film, and return it."""
        shape = (self._height, self._width, -1)
        block = mi.ImageBlock(self._film.crop_size(), self._film.crop_offset(), 4 + self._alpha, border=False)
        tensor = block.tensor()
        tensor += mi.TensorXf(self._stored, (self._height, self._width, 4 + self._alpha))
        self._film.prepare([])
        self._film.put_block(block)
        del shape
        if not self._as_drawn:
            return self._film.develop()
        return mi.TensorXf(self._picture, (self._height, self._width, self._channels))

    def _scatter(self, pixel: Any, colour: list[Any], alpha: list[Any], active: Any) -> None:
        rgb = colour * 3 if len(colour) == 1 else colour
        for buffer, parts in ((self._picture, [*colour, *alpha]), (self._stored, [*rgb, *alpha, mi.Float(1)])):
            for i, part in enumerate(parts):
                dr.scatter(buffer, part, pixel * len(parts) + i, active, mode=dr.ReduceMode.Permute)
