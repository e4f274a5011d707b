"""A pair of pictures to be looked into, pixel by pixel; the rest of it is viewer.js and what that uses.

A picture goes into the page as the bits of its float32 numbers, so nothing is lost. Neighbours are alike, and
so are A and B: what is stored is the second difference of the bits across the picture, or their difference from
A, or the bits themselves, whichever deflates best after its bytes are sorted by their place in the word. What the
reference knows beyond float32 goes along in eighths of float32's spacing, so that errors below it are seen.
Errors themselves are computed in the browser.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_PIXELS = 1 << 20
"""A larger pair is shown by the worst pixel of each block: a page beyond that is no pleasure to open."""

TAIL = 8  # parts of float32's spacing in which B's remainder is stored
BOUND_BITS = 6  # two digits are shown


@dataclass(frozen=True)
class Viewer:
    """Two pictures, what is known of each pixel, and controls to look at them.

    Attributes
    ----------
    a, b : (height, width, 3) floats, linear radiance; B is what A is measured against. A is kept as float32,
        B to 1/16 of float32's spacing
    names : what A and B are
    bound : (height, width, 3) floats, the largest error that is allowed; kept to BOUND_BITS
    status : (height, width), 0 equal, 1 explained, 2 unexplained; None for a comparison without a verdict
    numbers : whole numbers to show of each pixel, such as {"bounces": (height, width)}
    labels : texts to show of each pixel: {"object": ((height, width) indices, texts)}
    told : {"x,y": why the two differ there}, in words
    explained : {"x,y": HTML}, an explanation of that pixel by its rays, made safe by who wrote it; shown when the
        pixel is chosen
    """

    a: NDArray[np.floating]
    b: NDArray[np.floating]
    names: tuple[str, str] = ("A", "B")
    bound: NDArray[np.floating] | None = None
    status: NDArray[np.integer] | None = None
    numbers: Mapping[str, NDArray[np.integer]] = field(default_factory=dict)
    labels: Mapping[str, tuple[NDArray[np.integer], Sequence[str]]] = field(default_factory=dict)
    told: Mapping[str, str] = field(default_factory=dict)
    explained: Mapping[str, str] = field(default_factory=dict)

    def html(self) -> str:
        """Return a place for the viewer, with its data as JSON that cannot end its element."""
        data = json.dumps(self.data(), separators=(",", ":")).replace("<", "\\u003c")
        return (
            f'<div class="viewer"><script type="application/json">{data}</script>'
            "<noscript>The pictures need the script in this page.</noscript></div>"
        )

    def data(self) -> dict[str, Any]:
        """Return what the browser gets."""
        height, width, _ = self.a.shape
        step = 1
        while -(-height // step) * -(-width // step) > MOST_PIXELS:
            step += 1
        rows, columns = worst_of_blocks(self.a, self.b, step)

        def shown(plane: NDArray[Any]) -> NDArray[Any]:
            return plane[rows, columns]

        b = shown(self.b).astype(np.float64)
        with np.errstate(over="ignore"):
            a, near = shown(self.a).astype(np.float32), b.astype(np.float32)
        planes = {}
        for channel in range(3):
            a_bits, b_bits = _bits(a[..., channel]), _bits(near[..., channel])
            planes[f"a{channel}"] = _packed(a_bits)
            planes[f"b{channel}"] = _packed(b_bits, a_bits)
            tail = _tail(b[..., channel], near[..., channel])
            if tail.any():
                planes[f"tail{channel}"] = _packed(tail)
            if self.bound is not None:
                planes[f"bound{channel}"] = _packed(_rounded(shown(self.bound)[..., channel]))
        if self.status is not None:
            planes["status"] = _packed(shown(self.status))
        if step > 1:
            planes["x"], planes["y"] = _packed(columns), _packed(rows)
        return {
            "width": rows.shape[1],
            "height": rows.shape[0],
            "of": [width, height],
            "step": step,
            "names": list(self.names),
            "planes": planes,
            "numbers": {name: _packed(shown(plane)) for name, plane in self.numbers.items()},
            "labels": {
                name: {"plane": _packed(shown(plane)), "texts": _deflated(json.dumps(list(texts)).encode())}
                for name, (plane, texts) in self.labels.items()
            },
            "told": dict(self.told),
            "explained": _deflated(json.dumps(dict(self.explained)).encode()) if self.explained else None,
        }


def worst_of_blocks(
    a: NDArray[np.floating], b: NDArray[np.floating], step: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of the pixels to show: all, or the one with the largest error of each block."""
    height, width, _ = a.shape
    if step == 1:
        rows, columns = np.indices((height, width))
        return rows, columns
    with np.errstate(invalid="ignore"):
        error = np.abs(a.astype(np.float64) - b).max(axis=2)
    error[np.isnan(error)] = np.inf
    tall, wide = -(-height // step), -(-width // step)
    padded = np.full((tall * step, wide * step), -1.0)
    padded[:height, :width] = error
    blocks = padded.reshape(tall, step, wide, step).swapaxes(1, 2).reshape(tall, wide, step * step)
    worst = blocks.argmax(axis=2)
    i, j = np.indices((tall, wide))
    return i * step + worst // step, j * step + worst % step


def _bits(plane: NDArray[np.float32]) -> NDArray[np.uint32]:
    return np.ascontiguousarray(plane).view(np.uint32)


def _tail(exact: NDArray[np.float64], near: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return what is left of B, in parts of the spacing of float32 at it."""
    with np.errstate(invalid="ignore"):
        parts = np.rint((exact - near) / np.abs(np.spacing(near)).astype(np.float64) * TAIL)
    return np.where(np.isfinite(parts), parts, 0).astype(np.int64)


def _rounded(plane: NDArray[np.floating]) -> NDArray[np.uint32]:
    """Round positive numbers to BOUND_BITS significant bits, as float32."""
    with np.errstate(over="ignore"):
        bits = _bits(plane.astype(np.float32))
    step = np.uint32(1 << (24 - BOUND_BITS))
    return np.where(np.isfinite(plane), (bits + step // 2) & ~(step - 1), bits)


def _packed(plane: NDArray[Any], like: NDArray[np.uint32] | None = None) -> list[str]:
    """Return the shortest of the ways to write a plane of 32-bit words: its name, and base64."""
    words = plane.astype(np.uint32)
    ways = {"plain": words, "smooth": np.diff(np.diff(words, axis=0, prepend=np.uint32(0)), prepend=np.uint32(0))}
    if like is not None:
        ways["like"] = words - like
    return min(([name, _deflated(_sorted(way))] for name, way in ways.items()), key=lambda pair: len(pair[1]))


def _sorted(words: NDArray[np.uint32]) -> bytes:
    """Fold the sign into the lowest bit, and put all first bytes together, then all second ones, and so on."""
    signed = words.view(np.int32)
    folded = ((signed << 1) ^ (signed >> 31)).view(np.uint32).astype("<u4")
    return np.ascontiguousarray(folded.reshape(-1).view(np.uint8).reshape(-1, 4).T).tobytes()


def _deflated(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data)).decode()
