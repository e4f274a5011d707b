"""Colours that vary over a surface: checkerboards and 8-bit pictures (Mitsuba's definitions)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from whitted_reference import scene
from whitted_reference.arithmetic import Arithmetic
from whitted_reference.float32 import LUMINANCE
from whitted_reference.vectors import Colour, Number, dot

Evaluate = Callable[[Number, Number], Colour]  # (u, v) -> colour


def evaluator(texture: scene.Texture, arithmetic: Arithmetic) -> Colour | Evaluate:
    """Return the texture's colour if it is constant, else a function of (u, v)."""
    if isinstance(texture, scene.Checkerboard):
        return _checkerboard(texture, arithmetic)
    if isinstance(texture, scene.Bitmap):
        return _bitmap(texture, arithmetic)
    return arithmetic.vec(texture)


def _checkerboard(texture: scene.Checkerboard, arithmetic: Arithmetic) -> Evaluate:
    floor = arithmetic.floor
    even, odd = evaluator(texture.color0, arithmetic), evaluator(texture.color1, arithmetic)
    (a, b, s), (c, d, t) = (arithmetic.vec(row) for row in texture.to_uv)

    def evaluate(u: Number, v: Number) -> Colour:
        x, y = a * u + b * v + s, c * u + d * v + t
        right, upper = 2 * (x - floor(x)) > 1, 2 * (y - floor(y)) > 1
        chosen = even if right == upper else odd
        return chosen(u, v) if callable(chosen) else chosen

    return evaluate


def _bitmap(texture: scene.Bitmap, arithmetic: Arithmetic) -> Evaluate:
    floor = arithmetic.floor
    width, height, channels, texels = texture.width, texture.height, texture.channels, texture.texels
    table = [_decoded(byte, texture.srgb, arithmetic) for byte in range(256)]
    wrap = _WRAPS[texture.wrap]
    (a, b, s), (c, d, t) = (arithmetic.vec(row) for row in texture.to_uv)
    half = arithmetic.of(0.5)

    def texel(i: int, j: int) -> Colour:
        place = (wrap(j, height) * width + wrap(i, width)) * channels
        if channels == 1:
            grey = table[texels[place]]
            return grey, grey, grey
        return table[texels[place]], table[texels[place + 1]], table[texels[place + 2]]

    def nearest(u: Number, v: Number) -> Colour:
        return texel(floor((a * u + b * v + s) * width), floor((c * u + d * v + t) * height))

    def bilinear(u: Number, v: Number) -> Colour:
        x, y = (a * u + b * v + s) * width - half, (c * u + d * v + t) * height - half
        i, j = floor(x), floor(y)
        x, y = x - i, y - j
        rows = zip(texel(i, j), texel(i + 1, j), texel(i, j + 1), texel(i + 1, j + 1), strict=True)
        red, green, blue = (
            (c00 * (1 - x) + c10 * x) * (1 - y) + (c01 * (1 - x) + c11 * x) * y for c00, c10, c01, c11 in rows
        )
        return red, green, blue

    colour = bilinear if texture.bilinear else nearest
    if not texture.grey or channels == 1:
        return colour
    weights = arithmetic.vec(LUMINANCE)

    def grey(u: Number, v: Number) -> Colour:
        value = dot(weights, colour(u, v))
        return value, value, value

    return grey


def beyond_nearest_edge(
    textures: Sequence[scene.Texture], u: float, v: float
) -> tuple[float, tuple[float, float]] | None:
    """Return how far in uv the closest jump of colour is, and a (u, v) as far on its other side.

    Checkerboards jump at halves, bitmaps without interpolation between texels; others do not jump.
    """
    found: list[tuple[float, tuple[float, float]]] = []
    for texture in textures:
        if isinstance(texture, scene.Checkerboard):
            cells = (2.0, 2.0)
            inner = beyond_nearest_edge((texture.color0, texture.color1), u, v)
            found += [inner] if inner else []
        elif isinstance(texture, scene.Bitmap) and not texture.bilinear:
            cells = (float(texture.width), float(texture.height))
        else:
            continue
        for (a, b, offset), count in zip(texture.to_uv, cells, strict=True):
            steepness = a * a + b * b
            if steepness == 0.0:
                continue
            x = (a * u + b * v + offset) * count
            off = x - round(x)
            # Exactly on an edge step over it by what double precision can tell apart: down, but up from
            # the halves of a checkerboard, which belong to the cell below.
            half = isinstance(texture, scene.Checkerboard) and round(x) % 2 == 1
            step = -2.0 * off or (2.0**-40 if half else -(2.0**-40))
            move = step / count / steepness
            found.append((abs(off) / count / math.sqrt(steepness), (u + move * a, v + move * b)))
    return min(found, default=None)


def _decoded(byte: int, srgb: bool, arithmetic: Arithmetic) -> Number:
    """Return the linear value of a byte (IEC 61966-2-1)."""
    of = arithmetic.of
    x = of(byte) / 255
    if not srgb:
        return x
    if x * 100000 <= 4045:
        return x * 100 / 1292
    return arithmetic.power((x * 1000 + 55) / 1055, of(24) / 10)


def _repeat(i: int, size: int) -> int:
    return i % size


def _mirror(i: int, size: int) -> int:
    i %= 2 * size
    return i if i < size else 2 * size - 1 - i


def _clamp(i: int, size: int) -> int:
    return min(max(i, 0), size - 1)


_WRAPS: dict[str, Callable[[int, int], int]] = {"repeat": _repeat, "mirror": _mirror, "clamp": _clamp}
