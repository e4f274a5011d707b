"""Re-tracing a pixel under noise of the size of rounding, for pixels whose propagated bound says too little.

The propagated bound adds up the sizes of all rounding errors, as if every one of them pushed the colour the
same way. Where that comes out large (steep textures, grazing chains of mirrors), the pixel is traced again
with each rounding drawn at random from its own interval, uniformly and independently.

From N draws to a bound. The colour's error is a sum S of independent terms c_i x_i, |x_i| <= 1. Hoeffding
(1963): P(|S| > s) <= 2 exp(-s^2 / (2 sum c_i^2)), and uniform draws have variance sigma^2 = sum c_i^2 / 3, so
that beyond s = sigma sqrt(6 ln(2 / q)) lies at most q. The estimate of sigma from N draws about the exact
colour is low by more than a factor sqrt(N / x) with the chance that chi^2 with N degrees of freedom is below
x. With N = 32 and q = 10^-6 for each of the two: s = 9.33 sigma, x = 7.05, together FACTOR = 19.9 times the
observed root mean square. So of a million pixels judged this way about two may be called wrong by chance, in
each channel; the pictures of one run have some thousands.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whitted_reference import scene
from whitted_reference.materials import Material, Terms
from whitted_reference.ray_tree import RayNode, Tree
from whitted_reference.vectors import Colour, dot
from whitted_validation.patch import patch_of
from whitted_validation.rounding import Follower, chain
from whitted_validation.roundoffs import (
    CAMERA_DIRECTION,
    IRRADIANCE,
    PLANE_DISTANCE,
    PLANE_SLOPE,
    POWER,
    REFLECTED,
    TERM,
    TEXEL,
    TO_LIGHT,
    UNIT_VECTOR,
    U,
)
from whitted_validation.textures import COLOURS, Slopes

DRAWS = 32
# ln(2 / 10^-6) = 14.5; the quantile x of chi^2 with 32 degrees of freedom at 10^-6 is 7.05 (see above).
FACTOR = math.sqrt(6 * math.log(2 / 1e-6)) * math.sqrt(DRAWS / 7.05)


class Shaken(Follower):
    """A tracer that gives every ray the roundings of the one that is judged, at random.

    What meeting a surface costs is given to the direction of the ray that meets it: t times the roundings of
    the plane's distance and slope.
    """

    def __init__(self, description: scene.Scene, sensor: int = 0) -> None:
        super().__init__(description, sensor)
        self._random = random.Random(0)
        self._slopes = Slopes(description)

    def seed(self, x: int, y: int) -> None:
        """Begin the draws of a pixel."""
        self._random.seed(f"{x} {y}")

    def raycolor(self, e, d, start, end, k=0, leaving=None, share=(1, 1, 1)):  # type: ignore[no-untyped-def]
        """Do as the tracer with a ray that is a little off."""
        above = self.node
        if k == 0:
            off, turn = np.zeros(3), CAMERA_DIRECTION + PLANE_DISTANCE + PLANE_SLOPE
        else:
            patch = patch_of(self.primitives[above.primitive], above)
            off, turn = patch.point_roundings, REFLECTED + 2 * patch.normal_roundings + PLANE_DISTANCE + PLANE_SLOPE
        e = tuple(x + self._draw(float(s)) for x, s in zip(e, off, strict=True))
        d = tuple(x + self._draw(turn) for x in d)
        size = math.hypot(*d)
        d = tuple(x / size for x in d)
        return super().raycolor(e, d, start, end, k, leaving, share)

    def textured(self, side: Material, uv: tuple[float, float]) -> Terms:
        """Do as the tracer with coordinates, and coefficients of pictures, that are a little off."""
        node = self.node
        off_u, off_v = patch_of(self.primitives[node.primitive], node).uv_roundings
        terms = super().textured(side, (uv[0] + self._draw(off_u), uv[1] + self._draw(off_v)))
        if self._slopes.varies(self.primitives[node.primitive].surface.id, node.front):
            shaken: dict[str, Any] = {name: self._shaken(getattr(terms, name)) for name in COLOURS}
            terms = replace(terms, **shaken)
        node.terms = terms
        return terms

    def reflected(self, terms, i, n, d, l, n_l):  # type: ignore[no-untyped-def]  # noqa: E741
        """Do as the tracer with a normal, a light and an irradiance that are a little off."""
        node = self.node
        turn = patch_of(self.primitives[node.primitive], node).normal_roundings + 2 * UNIT_VECTOR  # n, and h for it
        n = tuple(x + self._draw(turn) for x in n)
        d = tuple(x + self._draw(U) for x in d)
        l = tuple(x + self._draw(TO_LIGHT) for x in l)  # noqa: E741
        i = tuple(x * (1.0 + self._draw(IRRADIANCE)) for x in i)
        return super().reflected(terms, i, n, d, l, max(dot(n, l) + self._draw(3 * U), 0.0))

    def _shaken(self, colour: Colour | None) -> Colour | None:
        if colour is None:
            return None
        red, green, blue = (c + self._draw(TEXEL) for c in colour)
        return red, green, blue

    def signature(self, tree: Tree) -> list[Any]:
        """List what was decided along the rays of a tree."""
        return [
            (
                node.primitive,
                node.front,
                [(light.id, light.above, light.blocked_by is None) for light in node.lights],
                self._cell(node),
            )
            for node in chain(tree.root)
        ]

    def _cell(self, node: RayNode) -> Terms | None:
        """Return the coefficients where they only change in steps: they tell the step."""
        if node.primitive < 0 or self._slopes.varies(self.primitives[node.primitive].surface.id, node.front):
            return None
        return node.terms

    def _draw(self, size: float) -> float:
        return size * self._random.uniform(-1.0, 1.0)


class Sampled(NamedTuple):
    """A bound from draws; `chaotic` where most of them decide otherwise than the exact path."""

    bound: NDArray[np.float64]
    chaotic: bool


def sampled_bound(shaken: Shaken, tree: Tree, x: int, y: int, i: int = 0, j: int = 0, grid: int = 1) -> Sampled:
    """Bound the error of each channel by draws that decide alike, or by all where these are too few.

    A pixel of the second kind is beyond float32: noise of its size alone changes what is seen there. Its bound
    is that of the colours which the draws give, whatever they decide.
    """
    shaken.seed(x, y)
    decided = shaken.signature(tree)
    exact = np.array(tree.colour, float)
    alike: list[NDArray[np.float64]] = []
    others: list[NDArray[np.float64]] = []
    while len(alike) < DRAWS and len(others) <= DRAWS:
        drawn = shaken.record(x, y, i, j, grid)
        kind = alike if shaken.signature(drawn) == decided else others
        kind.append((np.array(drawn.colour, float) - exact) ** 2)
    chaotic = len(alike) < DRAWS
    # Products, powers and sums are not drawn: at each hit they cost no more than this of what it adds.
    shading = (TERM + POWER + U * (4 + len(tree.root.lights))) * np.abs(exact)
    squares = alike + others if chaotic else alike
    return Sampled(FACTOR * np.sqrt(np.mean(squares, axis=0)) + len(decided) * shading, chaotic)
