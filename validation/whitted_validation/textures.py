"""How fast the coefficients of a surface change with its coordinates, and where they jump."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from whitted_reference import scene
from whitted_reference.arithmetic import FLOAT
from whitted_reference.textures import evaluator
from whitted_validation.roundoffs import TEXEL

COLOURS = ("ambient", "diffuse", "specular", "mirror")
TERMS = (*COLOURS, "exponent")
# Coordinates off by more texels than that tell nothing of the texture.
MOST_TEXELS = 8.0

Uv = tuple[float, float]
Change = Callable[[Uv, Uv], float]  # (uv, how far they may be off) -> largest change


class Slopes:
    """Slopes of every coefficient of every surface, near given coordinates; steps are left out.

    With `level` it is asked what would be if there were none.
    """

    def __init__(self, description: scene.Scene, level: bool = False) -> None:
        self._changes: dict[tuple[str, bool, str], list[Change]] = {}
        self._varying: set[tuple[str, bool]] = set()
        for name, look in _looks(description.shapes):
            material = look.material
            sides = (material.front, material.behind) if isinstance(material, scene.TwoSided) else (material,)
            for front, side in zip((True, False), sides, strict=False):
                for term, texture in _textures(side):
                    changes = list(_changes(texture))
                    if changes and not level:
                        self._changes[name, front, term] = changes
                    if any(change is not _level for change in changes):
                        self._varying.add((name, front))

    def varies(self, surface: str, front: bool) -> bool:
        """Tell whether any coefficient changes other than in steps."""
        return (surface, front) in self._varying

    def error(self, surface: str, front: bool, term: str, uv: Uv, off: Uv) -> float:
        """Bound the change of a coefficient in any channel, at coordinates `uv` known to within `off`."""
        changes = self._changes.get((surface, front, term))
        if changes is None:
            return 0.0
        return TEXEL + max(change(uv, off) for change in changes)


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


def _changes(texture: scene.Texture) -> Iterator[Change]:
    """Yield the changes of all pictures in a texture."""
    if isinstance(texture, scene.Checkerboard):  # what is in its squares is asked at the same uv
        yield from _changes(texture.color0)
        yield from _changes(texture.color1)
    elif isinstance(texture, scene.Bitmap):
        yield _change(texture) if texture.bilinear else _level


def _level(uv: Uv, off: Uv) -> float:
    """Change in steps only."""
    return 0.0


def _change(texture: scene.Bitmap) -> Change:
    """Between four texel centres a picture is bilinear: no steeper than the differences of the four."""
    w, h = texture.width, texture.height
    whole: tuple[Any, Any] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    colour = evaluator(replace(texture, bilinear=False, to_uv=whole), FLOAT)
    assert callable(colour)

    def texel(i: int, j: int) -> Any:
        return colour((i + 0.5) / w, (j + 0.5) / h)

    (a, b, s), (c, d, t) = texture.to_uv

    def change(uv: Uv, off: Uv) -> float:
        x, off_x = (a * uv[0] + b * uv[1] + s) * w - 0.5, (abs(a) * off[0] + abs(b) * off[1]) * w
        y, off_y = (c * uv[0] + d * uv[1] + t) * h - 0.5, (abs(c) * off[0] + abs(d) * off[1]) * h
        if not off_x + off_y < MOST_TEXELS:
            return 1.0  # all that bytes can differ by
        columns = range(math.floor(x - off_x), math.floor(x + off_x) + 2)
        rows = range(math.floor(y - off_y), math.floor(y + off_y) + 2)
        around = np.array([[texel(i, j) for i in columns] for j in rows], float)
        across, down = np.abs(np.diff(around, axis=1)).max(), np.abs(np.diff(around, axis=0)).max()
        return min(1.0, off_x * float(across) + off_y * float(down))

    return change
