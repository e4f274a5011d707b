"""Two pictures of one size, from anywhere: how far apart they are, and where most."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_validation.flip import Flip, flip
from whitted_validation.picture_reading import Picture, from_array, read_picture
from whitted_validation.refusal import Refusal
from whitted_validation.report.pair import pair

PER_MILLE = (500, 900, 990, 999)  # the percentiles that are given, as whole numbers
SHARE_ABOVE = 1e-3
MOST_LISTED = 20  # worst pixels
_BAND = 1 << 20  # pixels that are worked on at once: float64 copies of whole pictures would be gigabytes


@dataclass(frozen=True)
class Pixel:
    """A pixel, its colour in both pictures, and its error."""

    x: int
    y: int
    a: tuple[float, ...]
    b: tuple[float, ...]
    error: float


@dataclass(frozen=True)
class NotFinite:
    """In how many pixels of a picture a channel is nan, and in how many infinite."""

    nan: int
    infinite: int


@dataclass(frozen=True)
class Comparison:
    """What `compare` found out. Print it, or show it in a notebook.

    The error of a pixel is |A - B| in its worst channel, linear; it is infinite where either picture holds nan or
    infinity, even if both hold the same.

    Attributes
    ----------
    a, b : the pictures
    error : (height, width) float64
    largest, rmse : over all pixels; the root of the mean square is also over channels
    finite_largest, finite_rmse : the same over the pixels that are finite in both
    percentiles : (percent, error): at least so many percent of the pixels have at most this error
    equal : number of pixels without any error
    above : number of pixels whose error is above SHARE_ABOVE
    not_finite : in A and in B
    worst : at most MOST_LISTED pixels with an error, the largest first, then in reading order
    flip : the mean FLIP, with B as the reference
    """

    a: Picture
    b: Picture
    error: NDArray[np.float64]
    largest: float
    rmse: float
    finite_largest: float
    finite_rmse: float
    percentiles: tuple[tuple[float, float], ...]
    equal: int
    above: int
    not_finite: tuple[NotFinite, NotFinite]
    worst: tuple[Pixel, ...]
    flip: Flip

    @property
    def rgb(self) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """A and B with three channels, (height, width, 3), luminance as grey."""
        shape = (*self.error.shape, 3)
        return np.broadcast_to(self.a.values, shape), np.broadcast_to(self.b.values, shape)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was chosen or left out when the pictures were read."""
        return self.a.remarks + self.b.remarks

    @property
    def sentence(self) -> str:
        """What came out, in words."""
        pixels = self.error.size
        if self.equal == pixels:
            return f"All {pixels:,} pixels are equal."
        wild = pixels - int(np.count_nonzero(np.isfinite(self.error)))
        first = f"{wild:,} of {pixels:,} pixels cannot be compared, for nan or infinity; " if wild else ""
        if wild == pixels:
            return f"None of the {pixels:,} pixels can be compared, for nan or infinity."
        differ = self.above - wild
        return (
            f"{first}{self.equal:,} of {pixels:,} pixels are equal; the largest error is {self.finite_largest:.3g}, "
            f"the RMSE {self.finite_rmse:.3g}, and {differ:,} differ{'s' * (differ == 1)} by more than {SHARE_ABOVE:g}."
        )

    def exceeded(self, max_error: float | None = None, max_rmse: float | None = None) -> list[str]:
        """Return a line for each limit that is given and exceeded."""
        found = (("max error", self.largest, max_error), ("RMSE", self.rmse, max_rmse))
        return [
            f"{name} {value:.9g} exceeds {limit:.9g}"
            for name, value, limit in found
            if limit is not None and not value <= limit
        ]

    @property
    def table(self) -> list[tuple[str, str]]:
        """The findings as name and value."""
        height, width = self.error.shape
        pixels = self.error.size
        channels = "luminance" if self.a.values.shape[2] == 1 else "RGB"
        rows = [
            ("A", self.a.name),
            ("B", self.b.name),
            ("size", f"{width} x {height}, {channels}"),
            ("equal", f"{self.equal} of {pixels} pixels"),
            ("max error", f"{self.largest:.9g}"),
            ("RMSE", f"{self.rmse:.9g}"),
            *((f"{percent:g} %", f"of the pixels within {error:.9g}") for percent, error in self.percentiles),
            (f"above {SHARE_ABOVE:g}", f"{100 * self.above / pixels:.4g} % of the pixels ({self.above})"),
            ("FLIP", str(self.flip)),
        ]
        for name, found in zip("AB", self.not_finite, strict=True):
            if found.nan or found.infinite:
                rows.append((f"not finite in {name}", f"pixels with nan: {found.nan}, with infinity: {found.infinite}"))
        if math.isinf(self.largest):
            finite = int(np.count_nonzero(np.isfinite(self.error)))
            rows.append(
                ("elsewhere", f"max error {self.finite_largest:.9g}, RMSE {self.finite_rmse:.9g} ({finite} pixels)")
            )
        return rows

    def __str__(self) -> str:
        rows = self.table
        width = max(len(name) for name, _ in rows)
        lines = [f"{name:<{width}}  {value}" for name, value in rows]
        lines += [
            f"  ({pixel.x}, {pixel.y})  error {pixel.error:.9g}  A {colour(pixel.a)}  B {colour(pixel.b)}"
            for pixel in self.worst[:10]
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in self.table
        )
        return f"<p>{html.escape(self.sentence)}</p>{pair(*self.rgb, (self.a.name, self.b.name))}<table>{rows}</table>"


def colour(values: tuple[float, ...]) -> str:
    """Show a colour with all digits that float32 has."""
    return " ".join(f"{value:.9g}" for value in values)


def compare(a: Any, b: Any, *, layer: str | None = None) -> Comparison:
    """Compare two pictures.

    Parameters
    ----------
    a, b : files (EXR, PNG, NPY), or arrays of linear values, see `picture_reading.from_array`
    layer : which layer of EXR files, where several have colours

    Raises
    ------
    Refusal
        If one is no picture, or they differ in size or channels.
    """
    first, second = (_picture(given, name, layer) for given, name in ((a, "A"), (b, "B")))
    (height, width, channels), (height_b, width_b, channels_b) = first.values.shape, second.values.shape
    if (height, width) != (height_b, width_b):
        raise Refusal(
            f"{first.name} is {width} x {height} pixels, {second.name} {width_b} x {height_b}; one size needed"
        )
    if channels != channels_b:
        kinds = {1: "luminance only", 3: "RGB"}
        raise Refusal(f"{first.name} is {kinds[channels]}, {second.name} {kinds[channels_b]}; the same needed")
    error = np.concatenate([_largest(difference) for difference in _differences(first, second)])
    finite = error[np.isfinite(error)]
    finite_largest = float(finite.max(initial=0.0))
    finite_rmse = _rmse(first, second, error, finite_largest, finite.size * channels)
    complete = finite.size == error.size
    ordered = np.sort(error, axis=None)
    percentiles = tuple((rate / 10, float(ordered[-(-rate * error.size // 1000) - 1])) for rate in PER_MILLE)
    return Comparison(
        a=first,
        b=second,
        error=error,
        largest=finite_largest if complete else math.inf,
        rmse=finite_rmse if complete else math.inf,
        finite_largest=finite_largest,
        finite_rmse=finite_rmse,
        percentiles=percentiles,
        equal=int(np.count_nonzero(error == 0)),
        above=int(np.count_nonzero(error > SHARE_ABOVE)),
        not_finite=(_not_finite(first), _not_finite(second)),
        worst=tuple(_worst(first, second, error, ordered)),
        flip=flip(first.values, second.values, first.stepped and second.stepped),
    )


def _picture(given: Any, name: str, layer: str | None) -> Picture:
    return read_picture(given, layer) if isinstance(given, (str, Path)) else from_array(given, name)


def _differences(a: Picture, b: Picture) -> Iterator[NDArray[np.float64]]:
    """Give A - B from the top, in bands of whole rows."""
    rows = max(1, _BAND // a.values.shape[1])
    for y in range(0, len(a.values), rows):
        with np.errstate(invalid="ignore", over="ignore"):
            yield a.values[y : y + rows].astype(np.float64) - b.values[y : y + rows]


def _largest(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    error = np.abs(difference).max(axis=2)
    return np.where(np.isfinite(error), error, np.inf)


def _rmse(a: Picture, b: Picture, error: NDArray[np.float64], largest: float, count: int) -> float:
    """Take the root of the mean square over the pixels of finite error; `count` values are in them.

    Differences are divided by a power of two near the largest first, which rounds nothing, so that no square
    overflows, and none underflows that counts.
    """
    if not largest:
        return 0.0
    exponent = math.frexp(largest)[1]
    sums, y = [], 0
    for difference in _differences(a, b):
        kept = difference[np.isfinite(error[y : y + len(difference)])]
        sums.append(float(np.square(np.ldexp(kept, -exponent)).sum()))
        y += len(difference)
    return math.ldexp(math.sqrt(math.fsum(sums) / count), exponent)


def _not_finite(picture: Picture) -> NotFinite:
    nan, infinite = (test(picture.values).any(axis=2) for test in (np.isnan, np.isinf))
    return NotFinite(int(np.count_nonzero(nan)), int(np.count_nonzero(infinite)))


def _worst(a: Picture, b: Picture, error: NDArray[np.float64], ordered: NDArray[np.float64]) -> Iterator[Pixel]:
    flat = error.ravel()
    least = ordered[-min(MOST_LISTED, ordered.size)]
    above, ties = np.flatnonzero(flat > least), np.flatnonzero((flat == least) & (flat > 0))
    listed = np.concatenate([above, ties[: MOST_LISTED - len(above)]])
    for place in listed[np.lexsort((listed, -flat[listed]))]:
        y, x = divmod(int(place), error.shape[1])
        in_a, in_b = (tuple(map(float, picture.values[y, x])) for picture in (a, b))
        yield Pixel(x, y, in_a, in_b, float(flat[place]))
