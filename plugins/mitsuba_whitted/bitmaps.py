"""A bitmap texture as numbers: its texels as linear colours, and how it goes on between and beyond them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.scene_graph import SceneGraph, number
from mitsuba_whitted.tables import opaque

Texels = NDArray[Any]

ROWS_AT_ONCE = 64
"""Rows of a picture that are looked at before the next are."""


class Bitmap(NamedTuple):
    """What a bitmap texture is made of."""

    stored: Texels
    """(height, width, 1 or 3), bytes or numbers."""
    srgb: bool
    """Whether bytes are sRGB."""
    wrap: str
    """`repeat`, `mirror` or `clamp`."""
    bilinear: bool

    def colours(self) -> NDArray[np.float32]:
        """Give the linear values of all texels, (height width, channels)."""
        return _linear(self.stored, self.srgb).astype(np.float32, copy=False).reshape(-1, self.stored.shape[2])


class _Probe(NamedTuple):
    """Answers that a texture may give at one place, one of which is the nearest to what it does give."""

    x: float
    """Place, in texels."""
    y: float
    answers: dict[str, NDArray[Any]]


def bitmap_of(graph: SceneGraph, texture: mi.Texture) -> Bitmap:
    """Read a bitmap.

    Mitsuba tells its texels and nothing else: not the wrap mode, nor the filter, nor whether bytes are sRGB. These
    are found by asking the texture for its colour where the answers differ. Where none differ, any will do.
    Its to_uv must be invertible.
    """
    stored = np.array(graph.value(texture, "data"))
    height, width, channels = stored.shape
    to_uv = to_uv_of(graph, texture)

    def said(probes: Iterator[_Probe]) -> str:
        off: dict[str, float] = {}
        for probe in probes:
            u, v, _ = np.linalg.solve(to_uv, [probe.x / width, probe.y / height, 1])
            colour = _colour(texture, u, v, channels)
            for answer, expected in probe.answers.items():
                off[answer] = off.get(answer, 0.0) + float(np.abs(colour - expected).sum())
        return min(off, key=lambda answer: off[answer], default="")

    srgb = stored.dtype == np.uint8 and said(_encoding_probes(stored)) == "sRGB"
    wrap = said(_wrap_probes(stored, srgb))
    return Bitmap(stored, srgb, wrap, said(_filter_probes(stored, srgb)) == "bilinear")


def to_uv_of(graph: SceneGraph, texture: mi.Texture) -> NDArray[np.float64]:
    """Give the matrix of a bitmap or checkerboard, (3, 3)."""
    return np.array(graph.value(texture, "to_uv").matrix, float).reshape(3, 3)


def _linear(stored: Texels, srgb: bool) -> Texels:
    """Linear values of bytes (IEC 61966-2-1), rounded once; other numbers are linear."""
    if stored.dtype != np.uint8:
        return stored
    x = np.arange(256) / 255
    table = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4) if srgb else x
    values: Texels = table.astype(np.float32)[stored]
    return values


def _encoding_probes(stored: Texels) -> Iterator[_Probe]:
    """Ask at a texel of middling value; those of 0 and 255 are the same either way."""
    row, column = _place_of_most(lambda rows: 128 - np.abs(stored[rows].astype(np.int16) - 128), len(stored), 64)
    texel = stored[row, column]
    yield _Probe(column + 0.5, row + 0.5, {"linear": _linear(texel, False), "sRGB": _linear(texel, True)})


def _filter_probes(stored: Texels, srgb: bool) -> Iterator[_Probe]:
    """Ask between a texel and the next, right or above, where the two differ."""
    for right in (True, False):
        here, there = (stored[:, :-1], stored[:, 1:]) if right else (stored[:-1], stored[1:])
        if not here.size:
            continue
        row, column = _place_of_difference(here, there)
        nearest, other = _linear(here[row, column], srgb), _linear(there[row, column], srgb)
        x, y = column + 0.5, row + 0.5
        off = 3 / 8  # of the way to the next centre: still the nearest texel
        answers = {"nearest": nearest, "bilinear": nearest + off * (other - nearest)}
        yield _Probe(x + off * right, y + off * (not right), answers)


def _wrap_probes(stored: Texels, srgb: bool) -> Iterator[_Probe]:
    """Ask in the period to the right and in that above, where two wrap modes differ."""
    height, width = stored.shape[:2]
    right = {"repeat": stored, "mirror": stored[:, ::-1], "clamp": np.broadcast_to(stored[:, -1:], stored.shape)}
    above = {"repeat": stored, "mirror": stored[::-1], "clamp": np.broadcast_to(stored[-1:], stored.shape)}
    for continued, x, y in ((right, width, 0), (above, 0, height)):
        for one, other in itertools.combinations(continued.values(), 2):
            row, column = _place_of_difference(one, other)
            answers = {wrap: _linear(texels[row, column], srgb) for wrap, texels in continued.items()}
            yield _Probe(x + column + 0.5, y + row + 0.5, answers)


def _place_of_difference(one: Texels, other: Texels) -> tuple[int, int]:
    """Find where two pictures differ by an eighth of the greatest value, or else the most."""

    def differences(rows: slice) -> NDArray[np.float32]:
        return np.abs(one[rows].astype(np.float32) - other[rows].astype(np.float32))

    return _place_of_most(differences, len(one), float(one.max()) / 8)


def _place_of_most(score: Callable[[slice], NDArray[Any]], height: int, enough: float) -> tuple[int, int]:
    """Find the texel with the greatest score, or in the first rows that have one, one with enough."""
    best, place = -np.inf, (0, 0)
    for start in range(0, height, ROWS_AT_ONCE):
        scores = score(slice(start, start + ROWS_AT_ONCE)).max(axis=2)
        row, column = divmod(int(scores.argmax()), scores.shape[1])
        if scores[row, column] > best:
            best, place = scores[row, column], (start + row, column)
        if best >= enough:
            break
    return place


def _colour(texture: mi.Texture, u: float, v: float, channels: int) -> NDArray[np.float64]:
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.uv = opaque(mi.Point2f(float(u), float(v)))
    if channels == 1:
        return np.array([number(texture.eval_1(si))])
    return np.array([number(channel) for channel in texture.eval_3(si)])
