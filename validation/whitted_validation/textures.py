"""How fast the coefficients of a surface change with its coordinates, and where they jump."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_reference import scene
from whitted_reference.arithmetic import FLOAT
from whitted_reference.textures import evaluator
from whitted_validation.roundoffs import U

COLOURS = ("ambient", "diffuse", "specular", "mirror")
TERMS = (*COLOURS, "exponent")
# A byte's linear value: a power of base 2.4 of it, by a logarithm and an exponential; relative to 1.
DECODED = 8 * U

Slope = Callable[[float, float], tuple[float, float]]  # (u, v) -> largest change per unit of u and of v


class Slopes:
    """Slopes of every coefficient of every surface, near given coordinates; steps are left out."""

    def __init__(self, description: scene.Scene) -> None:
        self._slopes: dict[tuple[str, bool, str], list[Slope]] = {}
        self._varying: set[tuple[str, bool]] = set()
        for name, look in _looks(description.shapes):
            material = look.material
            sides = (material.front, material.behind) if isinstance(material, scene.TwoSided) else (material,)
            for front, side in zip((True, False), sides, strict=False):
                for term, texture in _textures(side):
                    slopes = list(_slopes(texture))
                    if slopes:
                        self._slopes[name, front, term] = slopes
                    if any(slope is not _level for slope in slopes):
                        self._varying.add((name, front))

    def varies(self, surface: str, front: bool) -> bool:
        """Tell whether any coefficient changes other than in steps."""
        return (surface, front) in self._varying

    def error(self, surface: str, front: bool, term: str, uv: tuple[float, float], off: tuple[float, float]) -> float:
        """Bound the change of a coefficient in any channel, at coordinates `uv` known to within `off`."""
        slopes = self._slopes.get((surface, front, term))
        if slopes is None:
            return 0.0
        changes = (slope(*uv) for slope in slopes)
        return DECODED + max(du * off[0] + dv * off[1] for du, dv in changes)


def _looks(shapes: Any, prefix: str = "") -> Iterator[tuple[str, scene.Look]]:
    for shape in shapes:
        if isinstance(shape, scene.Instance):
            yield from _looks(shape.shapes, f"{shape.id}/")
        else:
            yield prefix + shape.look.id, shape.look


def _textures(side: scene.OneSided) -> Iterator[tuple[str, scene.Texture]]:
    if isinstance(side, scene.Diffuse):
        yield "ambient", side.reflectance
        yield "diffuse", side.reflectance
    elif isinstance(side, scene.Conductor):
        yield "mirror", side.mirror
    else:
        for term in TERMS:
            yield term, getattr(side, term)


def _slopes(texture: scene.Texture) -> Iterator[Slope]:
    """Yield the slopes of all pictures in a texture."""
    if isinstance(texture, scene.Checkerboard):  # what is in its squares is asked at the same uv
        yield from _slopes(texture.color0)
        yield from _slopes(texture.color1)
    elif isinstance(texture, scene.Bitmap):
        yield _slope(texture) if texture.bilinear else _level


def _level(u: float, v: float) -> tuple[float, float]:
    """Change in steps only."""
    return 0.0, 0.0


def _slope(texture: scene.Bitmap) -> Slope:
    """Find the largest differences of neighbouring texels, among those around a place."""
    w, h = texture.width, texture.height
    whole: tuple[Any, Any] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    colour = evaluator(replace(texture, bilinear=False, to_uv=whole), FLOAT)
    assert callable(colour)
    # One texel more on each side, by the texture's own rule; two more, so that every place has neighbours.
    texels = np.array(
        [[colour((i + 0.5) / w, (j + 0.5) / h) for i in range(-2, w + 2)] for j in range(-2, h + 2)], float
    )
    across = np.abs(np.diff(texels, axis=1)).max(axis=2)
    down = np.abs(np.diff(texels, axis=0)).max(axis=2)
    across, down = _greatest_around(across) * w, _greatest_around(down) * h
    (a, b, s), (c, d, t) = texture.to_uv
    inside: Callable[[float, int], int] = {"repeat": _repeat, "mirror": _mirror, "clamp": _clamp}[texture.wrap]

    def slope(u: float, v: float) -> tuple[float, float]:
        i = inside(a * u + b * v + s, w) + 2
        j = inside(c * u + d * v + t, h) + 2
        x = float(across[j, min(i, across.shape[1] - 1)])
        y = float(down[min(j, down.shape[0] - 1), i])
        return abs(a) * x + abs(c) * y, abs(b) * x + abs(d) * y

    return slope


def _greatest_around(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest value within two places of each: bilinear weights, and uv just across a texel's side."""
    padded = np.pad(values, 2, mode="edge")
    h, w = values.shape
    greatest: NDArray[np.float64] = np.max([padded[j : j + h, i : i + w] for j in range(5) for i in range(5)], axis=0)
    return greatest


def _repeat(x: float, size: int) -> int:
    return math.floor(x * size) % size


def _mirror(x: float, size: int) -> int:
    i = math.floor(x * size) % (2 * size)
    return i if i < size else 2 * size - 1 - i


def _clamp(x: float, size: int) -> int:
    return min(max(math.floor(x * size), 0), size - 1)
