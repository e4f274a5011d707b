"""From samples to the picture: sub-pixels, reconstruction filter, and Mitsuba's film."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted import antialias
from mitsuba_whitted.cells import Look
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.precise import rcp
from mitsuba_whitted.scene_graph import number
from mitsuba_whitted.tables import opaque

TILE = 4
"""Pixels are traced in squares of this side: the 16 lanes of a vector then follow neighbouring rays."""

SAMPLES_AT_ONCE = 1 << 24
"""Samples traced in one launch, unless one row has more: four floats each are kept until averaged."""

SAMPLES_BETWEEN_REPORTS = 1 << 20
"""The same where somebody watches the progress."""

PIXELS_REFINED_AT_ONCE = 1 << 18
"""Pixels refined in one band. A pixel in clutter may hold a thousand cells, of some 40 bytes each."""

Draw = Callable[[Any, Any, Any], tuple[Any, Any]]
"""From x, y (Float, pixels from the corner of the crop window) and a mask: colour, and whether anything was hit."""

Progress = Callable[[int, int], None]
"""Called with the number of rows done and of all rows."""


def expose(film: mi.Film, n: int, draw: Draw, progress: Progress | None = None) -> mi.TensorXf:
    """Draw the crop window of `film` with n x n samples a pixel, and leave the picture in the film too.

    With one sample a pixel, a box filter and nobody watching, tracing and storage are one kernel. It is started
    here and not waited for: put off any longer, it might run when the scene is gone, whose shapes Embree asks.
    The bytes are the same in any number of bands.

    Returns
    -------
    TensorXf
        (height, width, channels) of the crop window; the channels are the film's.
    """
    height = int(film.crop_size()[1])
    canvas = _Canvas(film, 0, height)
    for top, bottom in _bands(film, n, SAMPLES_BETWEEN_REPORTS if progress else SAMPLES_AT_ONCE):
        _draw_band(canvas, film, n, draw, top, bottom)
        canvas.start()
        if progress:
            progress(bottom, height)
    return canvas.finish()


def expose_to(film: mi.Film, target: float, look: Look, progress: Progress | None = None) -> mi.TensorXf:
    """Draw the crop window of `film` with a root mean square error of about `target` at most.

    Returns
    -------
    TensorXf
        As from `expose`.

    Raises
    ------
    SceneError
        If the film has another filter than a box of one pixel, or the variant no vectors.
    """
    if not _is_box(film.rfilter()):
        raise SceneError(
            f"film `{film.id()}`: target_error needs the filter `box` of radius 0.5, for a pixel is then the mean over "
            f"its square; here it is {film.rfilter().class_name()}"
        )
    if not dr.is_jit_v(mi.Float):
        raise SceneError(f"target_error needs a variant that begins with llvm or cuda; {mi.variant()} is none")
    width, height = (int(size) for size in film.crop_size())
    canvas = _Canvas(film, 0, height)
    for top, bottom in _bands(film, 1, PIXELS_REFINED_AT_ONCE):
        band = antialias.refined(look, width, top, bottom, target)
        red, green, blue, alpha = band.colour
        colour = [red, green, blue][: dr.size_v(mi.Spectrum)]
        canvas.put(band.y * opaque(mi.UInt32(width)) + band.x, [*colour, alpha], band.inside)
        canvas.start()
        if progress:
            progress(bottom, height)
    return canvas.finish()


def expose_in_bands(film: mi.Film, n: int, draw: Draw) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Draw the same bytes band by band, top down: number of the first row, and rows (n, width, channels).

    The film gets nothing, and no more than a band is held.
    """
    for top, bottom in _bands(film, n, SAMPLES_BETWEEN_REPORTS):
        canvas = _Canvas(film, top, bottom)
        _draw_band(canvas, film, n, draw, top, bottom)
        yield top, np.array(canvas.picture())


def _bands(film: mi.Film, n: int, samples: int) -> Iterator[tuple[int, int]]:
    """First row of each band of about so many samples, and the row after its last."""
    width, height = (int(size) for size in film.crop_size())
    rows = _rows_at_once(width, height, n, samples)
    for top in range(0, height, rows):
        yield top, min(top + rows, height)


def _draw_band(canvas: _Canvas, film: mi.Film, n: int, draw: Draw, top: int, bottom: int) -> None:
    """Draw some rows onto a canvas that has them."""
    width, height = (int(size) for size in film.crop_size())
    box = _is_box(film.rfilter())
    if box and n == 1 and dr.is_jit_v(mi.Float):
        pixel, x, y, inside = _tiles(width, top, bottom)
        canvas.put(pixel, _planes(*draw(x + 0.5, y + 0.5, inside)), inside)
    elif box:
        canvas.put_rows(top, means(_samples(width, top, bottom, n, draw), n))
    else:
        margin = math.ceil(float(film.rfilter().radius()) - 0.5)
        above, below = max(0, top - margin), min(height, bottom + margin)
        samples = _samples(width, above, below, n, draw)
        filtered = _filtered(np.array(samples).reshape(-1, below - above, width, n, n), film.rfilter())
        canvas.put_rows(top, filtered[:, top - above : bottom - above])


def totals(film: mi.Film, n: int, count: Callable[[Any, Any, Any], tuple[Any, ...]]) -> list[int]:
    """Sum up what `count` finds for each sample of the crop window: UInt32 numbers for x, y and a mask."""
    width = int(film.crop_size()[0])
    sums: list[int] = []
    for top, bottom in _bands(film, n, SAMPLES_AT_ONCE):
        if dr.is_jit_v(mi.Float):
            found = count(*_sub_pixels(width, top, bottom, n), mi.Bool(True))
            dr.eval(found)
            batches: list[Any] = [[np.sum(np.array(part), dtype=np.uint64) for part in found]]
        else:
            batches = [count(x, y, True) for x, y in _positions(width, top, bottom, n)]
        for batch in batches:
            sums = [a + int(b) for a, b in zip(sums or [0] * len(batch), batch, strict=True)]
    return sums


def _rows_at_once(width: int, height: int, n: int, samples: int) -> int:
    """Rows of the picture that one launch takes: whole tiles, or single rows where those alone are many samples."""
    rows = samples // (width * n * n)
    return min(height, max(1, rows // TILE * TILE or rows))


def _is_box(rfilter: mi.ReconstructionFilter) -> bool:
    """Whether a pixel is the plain mean of its own samples."""
    return rfilter.class_name() == "BoxFilter" and float(rfilter.radius()) == 0.5


def _tiles(width: int, top: int, bottom: int) -> tuple[Any, Any, Any, Any]:
    """List a band's pixels tile by tile: number in the picture, x, y, and whether they are inside the band.

    The size of the band is data, so that no other size needs another kernel.
    """
    across, down = -(-width // TILE), -(-(bottom - top) // TILE)
    lane = dr.arange(mi.UInt32, across * down * TILE * TILE)
    size = opaque(mi.Vector4u(width, bottom - top, across, top))
    tile, inner = lane // (TILE * TILE), lane % (TILE * TILE)
    tile_y, tile_x = _divided(tile, size.z)
    x = tile_x * TILE + inner % TILE
    y = tile_y * TILE + inner // TILE
    inside = (x < size.x) & (y < size.y)
    return (y + size.w) * size.x + x, mi.Float(x), mi.Float(y + size.w), inside


def _divided(a: Any, b: Any) -> tuple[Any, Any]:
    """Quotient and remainder of integers below 2^24, which no processor divides sixteen at a time.

    The quotient of the floats, whose rounding is at most one off once it is cut to an integer, is put right.
    """
    quotient = mi.UInt32(mi.Float(a) * dr.rcp(mi.Float(b)))
    quotient = dr.select(quotient * b > a, quotient - 1, quotient)
    quotient = dr.select(a - quotient * b >= b, quotient + 1, quotient)
    return quotient, a - quotient * b


def _samples(width: int, top: int, bottom: int, n: int, draw: Draw) -> Any:
    """Draw n x n samples of each pixel: flat (channels, pixel, n, n), the last channel 1 where something was hit."""
    count = width * (bottom - top) * n * n
    if not dr.is_jit_v(mi.Float):
        samples = [_planes(*draw(x, y, True)) for x, y in _positions(width, top, bottom, n)]
        return np.array(samples, np.float32).T
    planes = _planes(*draw(*_sub_pixels(width, top, bottom, n), mi.Bool(True)))
    samples = dr.empty(mi.Float, len(planes) * count)
    lane = dr.arange(mi.UInt32, count)
    for i, plane in enumerate(planes):
        dr.scatter(samples, plane, lane + opaque(mi.UInt32(i * count)), mode=dr.ReduceMode.Permute)
    dr.eval(samples)
    return samples


def _sub_pixels(width: int, top: int, bottom: int, n: int) -> tuple[Any, Any]:
    """Make x and y of all samples of a band: those of a pixel side by side, so that a vector's rays stay close."""
    size = opaque(mi.Vector3u(width, top, n))
    lane = dr.arange(mi.UInt32, width * (bottom - top) * n * n)
    pixel, part = lane // (size.z * size.z), lane % (size.z * size.z)
    return sub_pixel(pixel % size.x, pixel // size.x + size.y, part, size.z)


def sub_pixel(x: Any, y: Any, part: Any, n: Any) -> tuple[Any, Any]:
    """Position, in double, of sample number `part` of the n x n of pixel (x, y), row by row; UInt32 or int."""
    i, j, size = mi.Float64(part % n), mi.Float64(part // n), rcp(mi.Float64(n))
    return mi.Float64(x) + (i + 0.5) * size, mi.Float64(y) + (j + 0.5) * size


def _positions(width: int, top: int, bottom: int, n: int) -> Iterator[tuple[float, float]]:
    """List the same positions one by one, for a variant without Dr.Jit, whose kernel is called like any function."""
    for y in range(top, bottom):
        for x in range(width):
            for part in range(n * n):
                yield sub_pixel(x, y, part, n)


def _planes(colour: Any, hit: Any) -> list[Any]:
    """Channels of a sample: its colour, and the alpha."""
    return [*colour, dr.select(hit, mi.Float(1), mi.Float(0))]


def means(samples: Any, n: int) -> Any:
    """Average the samples of each pixel, given flat as (channels, pixel, n, n)."""
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
    along = weights.sum(axis=1)[None, :, None]
    total_y, total_x = (_gathered(np.repeat(along, size, 2), 2, reach)[0] for size in samples.shape[1:3])
    filtered: NDArray[np.float32] = (columns / (total_y[:, None] * total_x)).astype(np.float32)
    return filtered


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
    return number(rfilter.eval(mi.Float(x)))


class _Canvas:
    """The picture under work, or the rows of it from `top` to before `bottom`."""

    def __init__(self, film: mi.Film, top: int, bottom: int) -> None:
        self._film = film
        self._width, self._height = int(film.crop_size()[0]), bottom - top
        self._top = top
        self._first = opaque(mi.UInt32(top * self._width))
        self._alpha = bool(film.flags() & +mi.FilmFlags.Alpha)
        self._colours = dr.size_v(mi.Spectrum)
        self._channels = self._colours + self._alpha
        count = self._width * self._height
        self._buffer: Any = (
            dr.empty(mi.Float, count * self._channels)
            if dr.is_jit_v(mi.Float)
            else np.empty((count, self._channels), np.float32)
        )

    def put(self, pixel: Any, planes: list[Any], active: Any) -> None:
        """Store the channels of the pixels with these numbers."""
        for i, plane in enumerate(planes[: self._channels]):
            to = (pixel - self._first) * self._channels + i
            dr.scatter(self._buffer, mi.Float(plane), to, active, mode=dr.ReduceMode.Permute)

    def put_rows(self, top: int, planes: Any) -> None:
        """Store whole rows from `top` on, given as (channels, pixel)."""
        first, count = top * self._width, math.prod(planes.shape) // (self._colours + 1)
        if not dr.is_jit_v(mi.Float):
            first -= self._top * self._width
            self._buffer[first : first + count] = np.reshape(planes, (-1, count))[: self._channels].T
            return
        flat = mi.Float(np.ravel(planes)) if isinstance(planes, np.ndarray) else planes
        lane = dr.arange(mi.UInt32, count)
        parts = [dr.gather(mi.Float, flat, lane + i * count) for i in range(self._colours + 1)]
        self.put(opaque(mi.UInt32(first)) + lane, parts, mi.Bool(True))

    def start(self) -> None:
        """Start the kernels of what has been put so far."""
        dr.eval(self._buffer)

    def picture(self) -> mi.TensorXf:
        """Return what has been put, (rows, width, channels)."""
        shape = self._height, self._width, self._channels
        return mi.TensorXf(self._buffer, shape) if dr.is_jit_v(mi.Float) else mi.TensorXf(self._buffer.reshape(shape))

    def finish(self) -> mi.TensorXf:
        """Hand the whole picture to the film, and return it."""
        picture = self.picture()
        block = mi.ImageBlock(self._film.crop_size(), self._film.crop_offset(), 4 + self._alpha, border=False)
        contents = block.tensor()
        contents += self._stored()  # onto zeros, which Dr.Jit drops: nothing is evaluated or copied
        self._film.prepare([])
        self._film.put_block(block)
        as_drawn = self._channels == self._film.base_channels_count() and "pixel_format = xyz" not in str(self._film)
        return picture if as_drawn else self._film.develop()  # XYZ, and the luminance of colours, are the film's

    def _stored(self) -> mi.TensorXf:
        """Arrange the picture as the film keeps it: red, green, blue, alpha if any, weight 1.

        Dr.Jit works it out when somebody asks the film, and never if nobody does.
        """
        width = 4 + self._alpha
        source = [i if self._colours == 3 else 0 for i in range(3)] + [self._colours] * self._alpha
        if not dr.is_jit_v(mi.Float):
            weights = np.ones((len(self._buffer), 1), np.float32)
            return mi.TensorXf(np.hstack([self._buffer[:, source], weights]).reshape(self._height, self._width, width))
        place = dr.arange(mi.UInt32, self._width * self._height * width)
        pixel, channel = place // width, place % width
        which = mi.UInt32(0)
        for i, ours in enumerate(source):
            which = dr.select(channel == i, ours, which)
        value = dr.gather(mi.Float, self._buffer, pixel * self._channels + which)
        stored = dr.select(channel == width - 1, 1, value)
        return mi.TensorXf(stored, (self._height, self._width, width))
