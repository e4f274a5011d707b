"""Is a picture what the reference says it must be? Pixel by pixel: equal, explained or unexplained.

equal
    within the bound of the rounding model (`rounding`, `noise`);
explained
    not equal, but equal within its own bound to an alternative colour of that pixel: one that the reference
    gives when it turns decisions that float32 rounding may turn (`alternatives`);
unexplained
    neither: a fault in one of the two programs. The reference's colour of such a pixel is computed once more
    in intervals or forty digits (`whitted_reference.proof`): if the picture agrees with that, doubles were at
    fault, and the pixel is explained.

A pixel that is beyond float32 (`noise`) and off by more than the least fault is not called equal but
explained, if it is within the bound of the colours drawn there.

Bounds and alternatives follow from the scene alone. That alternatives are only worked out for pixels that
are not equal saves time and changes nothing: the picture is no argument of what computes them.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whitted_reference import Scene
from whitted_reference.image import DEEPEST
from whitted_reference.proof import Prover
from whitted_validation.alternatives import Alternatives
from whitted_validation.bounds import Bounds, least_fault
from whitted_validation.roundoffs import U

Array = NDArray[np.float64]

# Up to so many unexplained pixels are computed again with more than doubles. Where there are more, it is not
# the last digits of doubles that are at fault.
MOST_SETTLED = 32


class Status(IntEnum):
    """What is said of a pixel."""

    EQUAL = 0
    EXPLAINED = 1
    UNEXPLAINED = 2


@dataclass(frozen=True)
class Difference:
    """A pixel that is not equal.

    Attributes
    ----------
    error, bound : of its worst channel: that with the greatest ratio of the two
    reasons : the decisions that are turned, each one line: kind, shape, light and bounce; empty if unexplained
    alternatives : how many colours were tried, the reference's own included
    complete : whether these are all, or the limit was reached
    settled_by : the arithmetic in which the reference's colour was computed again; empty if it was not
    """

    x: int
    y: int
    status: Status
    error: float
    bound: float
    reasons: tuple[str, ...]
    alternatives: int
    complete: bool
    settled_by: str = ""


@dataclass
class Judgement:
    """The verdict on one picture, as numbers: see `Bounds` for the arrays."""

    picture: Array
    bounds: Bounds
    status: NDArray[np.uint8]
    differences: list[Difference] = field(default_factory=list)

    def count(self, status: Status) -> int:
        """Return the number of pixels of that status."""
        return int((self.status == status).sum())

    @property
    def good(self) -> bool:
        """Tell whether every pixel is equal or explained."""
        return self.count(Status.UNEXPLAINED) == 0


def judge(
    scene: Scene, bounds: Bounds, picture: Array, executor: Executor, grid: int = 1, sensor: int = 0
) -> Judgement:
    """Judge a picture of the scene, (height, width, 3) in linear radiance.

    Raises
    ------
    ValueError
        If the picture has another shape than the reference's.
    """
    if picture.shape != bounds.colour.shape:
        raise ValueError(f"the picture has shape {picture.shape}, the reference's {bounds.colour.shape}")
    error = np.abs(picture - bounds.colour)
    # What is far off where only chaos bounds it must not pass for equal.
    allowed = np.where(bounds.chaotic[:, :, None], np.minimum(bounds.bound, least_fault(bounds.colour)), bounds.bound)
    bad = ~(error <= allowed).all(axis=2) | ~np.isfinite(picture).all(axis=2)
    judgement = Judgement(picture, bounds, np.where(bad, Status.UNEXPLAINED, Status.EQUAL).astype(np.uint8))
    places = [(int(x), int(y)) for y, x in zip(*np.nonzero(bad), strict=True)]
    if not places:
        return judgement
    packed = pickle.dumps(scene, protocol=4)
    step = max(1, min(16, len(places) // 8))

    def ask(work: Callable[..., list[Difference]], items: Sequence[Any]) -> list[Difference]:
        blocks = [items[i : i + step] for i in range(0, len(items), step)]
        asked = [executor.submit(work, packed, sensor, grid, block) for block in blocks]
        return [difference for future in asked for difference in future.result()]

    pixels = [
        Pixel(x, y, picture[y, x], bounds.colour[y, x], bounds.bound[y, x], bool(bounds.chaotic[y, x]))
        for x, y in places
    ]
    found = ask(explain_pixels, pixels)
    open_cases = [pair for pair in zip(pixels, found, strict=True) if pair[1].status == Status.UNEXPLAINED]
    if len(open_cases) <= MOST_SETTLED:
        settled = ask(settle_pixels, open_cases)
        found = [each for each in found if each.status != Status.UNEXPLAINED] + settled
    for difference in found:
        judgement.status[difference.y, difference.x] = difference.status
    judgement.differences = sorted(found, key=lambda d: (-d.status, -d.error, d.y, d.x))
    return judgement


class Pixel(NamedTuple):
    """A pixel that is not equal: its place, the colour seen there, and what `Bounds` say."""

    x: int
    y: int
    seen: Array
    colour: Array
    bound: Array
    chaotic: bool


def explain_pixels(packed: bytes, sensor: int, grid: int, pixels: Sequence[Pixel]) -> list[Difference]:
    """Look for explanations of unequal pixels."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST))
    alternatives, _ = _witnesses(packed, sensor)
    return [_explain(alternatives, grid, pixel) for pixel in pixels]


def settle_pixels(packed: bytes, sensor: int, grid: int, cases: Sequence[tuple[Pixel, Difference]]) -> list[Difference]:
    """Compute the reference's colour of unexplained pixels again, with more than doubles."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST))
    _, prover = _witnesses(packed, sensor)
    return [_settle(prover, grid, pixel, difference) for pixel, difference in cases]


@lru_cache(maxsize=2)
def _witnesses(packed: bytes, sensor: int) -> tuple[Alternatives, Prover]:
    scene: Scene = pickle.loads(packed)
    return Alternatives(scene, sensor), Prover(scene, sensor)


def _explain(alternatives: Alternatives, grid: int, pixel: Pixel) -> Difference:
    x, y, seen, colour, bound, chaotic = pixel
    error = np.abs(seen - colour)
    with np.errstate(divide="ignore", invalid="ignore"):
        worst = int(np.nanargmax(np.where(error > 0, error / bound, 0.0))) if np.isfinite(error).all() else 0
    found, complete = alternatives.of_pixel(x, y, grid)
    reasons: tuple[str, ...] = ()
    for other in found[1:]:
        off, its_bound = np.abs(seen - other.colour), np.array(other.bound)
        # A bound as large as the difference would explain anything.
        if (off <= its_bound).all() and (its_bound < error).any():
            reasons = other.reasons
            break
    if not reasons and chaotic and (error <= bound).all():
        reasons = ("beyond float32: most draws decide otherwise",)
    status = Status.EXPLAINED if reasons else Status.UNEXPLAINED
    return Difference(x, y, status, float(error[worst]), float(bound[worst]), reasons, len(found), complete)


def _settle(prover: Prover, grid: int, pixel: Pixel, difference: Difference) -> Difference:
    settled = prover.settle(pixel.x, pixel.y, grid, enough=U)
    difference = replace(difference, settled_by=settled.means)
    if not (np.abs(pixel.seen - settled.colour) <= pixel.bound + settled.off).all():
        return difference
    return replace(difference, status=Status.EXPLAINED, reasons=("beyond double precision: the reference was wrong",))
