"""A bitmap texture as numbers: its texels as linear colours, and how it goes on between and beyond them."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.scene_graph import SceneGraph, number
from mitsuba_whitted.tables import opaque

PAD_MODES = {"repeat": "wrap", "mirror": "symmetric", "clamp": "edge"}
"""How numpy calls what Mitsuba's wrap modes do."""


class Bitmap(NamedTuple):
    """What a bitmap texture is made of."""

    texels: NDArray[np.float64]
    """(height, width, 1 or 3), linear."""
    wrap: str
    """`repeat`, `mirror` or `clamp`."""
    bilinear: bool


class _Probe(NamedTuple):
    """Answers that a texture may give at one place, one of which is the nearest to what it does give."""

    x: float
    """Place, in texels."""
    y: float
    answers: dict[str, NDArray[np.float64]]


def bitmap_of(graph: SceneGraph, texture: mi.Texture) -> Bitmap:
    """Read a bitmap.

    Mitsuba tells its texels and nothing else: not the wrap mode, nor the filter, nor whether bytes are sRGB. These
    are found by asking the texture for its colour where the answers differ most. Where none differ, any will do.
    Its to_uv must be invertible.
    """
    stored = np.array(graph.value(texture, "data"))
    to_uv = to_uv_of(graph, texture)

    def said(probes: list[_Probe]) -> str:
        off: dict[str, float] = {}
        for probe in probes:
            height, width = stored.shape[:2]
            u, v, _ = np.linalg.solve(to_uv, [probe.x / width, probe.y / height, 1])
            colour = _colour(texture, u, v, stored.shape[2])
            for answer, expected in probe.answers.items():
                off[answer] = off.get(answer, 0.0) + float(np.abs(colour - expected).sum())
        return min(off, key=lambda answer: off[answer])

    texels = stored.astype(float)
    if stored.dtype == np.uint8:
        texels = _decoded(stored, said([_encoding_probe(stored)]) == "sRGB")
    return Bitmap(texels, said(list(_wrap_probes(texels))), said(list(_filter_probes(texels))) == "bilinear")


def to_uv_of(graph: SceneGraph, texture: mi.Texture) -> NDArray[np.float64]:
    """Give the matrix of a bitmap or checkerboard, (3, 3)."""
    return np.array(graph.value(texture, "to_uv").matrix, float).reshape(3, 3)


def _decoded(stored: NDArray[np.uint8], srgb: bool) -> NDArray[np.float64]:
    """Linear values of bytes (IEC 61966-2-1)."""
    x = np.arange(256) / 255
    table = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4) if srgb else x
    values: NDArray[np.float64] = table[stored]
    return values


def _encoding_probe(stored: NDArray[np.uint8]) -> _Probe:
    """Ask at a texel of middling value; those of 0 and 255 are the same either way."""
    row, column = _place_of_most(-np.abs(stored.astype(int) - 128))
    linear, srgb = (_decoded(stored[row, column], srgb) for srgb in (False, True))
    return _Probe(column + 0.5, row + 0.5, {"linear": linear, "sRGB": srgb})


def _filter_probes(texels: NDArray[np.float64]) -> Any:
    """Ask between a texel and the next, right or above, where the two differ most."""
    for right in (True, False):
        here, there = (texels[:, :-1], texels[:, 1:]) if right else (texels[:-1], texels[1:])
        row, column = _place_of_most(np.abs(there - here))
        nearest, other = here[row, column], there[row, column]
        x, y = column + 0.5, row + 0.5
        off = 3 / 8  # of the way to the next centre: still the nearest texel
        answers = {"nearest": nearest, "bilinear": nearest + off * (other - nearest)}
        yield _Probe(x + off * right, y + off * (not right), answers)


def _wrap_probes(texels: NDArray[np.float64]) -> Any:
    """Ask in the period to the right and in that above, where two wrap modes differ most."""
    height, width = texels.shape[:2]
    for pad in ([(0, 0), (0, width), (0, 0)], [(0, height), (0, 0), (0, 0)]):
        continued = {wrap: np.pad(texels, pad, mode) for wrap, mode in PAD_MODES.items()}  # type: ignore[call-overload]
        for one, other in itertools.combinations(continued.values(), 2):
            row, column = _place_of_most(np.abs(one - other))
            yield _Probe(column + 0.5, row + 0.5, {wrap: texel[row, column] for wrap, texel in continued.items()})


def _place_of_most(differences: NDArray[Any]) -> tuple[int, int]:
    row, column = divmod(int(differences.max(axis=2).argmax()), differences.shape[1])
    return row, column


def _colour(texture: mi.Texture, u: float, v: float, channels: int) -> NDArray[np.float64]:
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.uv = opaque(mi.Point2f(float(u), float(v)))
    if channels == 1:
        return np.array([number(texture.eval_1(si))])
    return np.array([number(channel) for channel in texture.eval_3(si)])
