"""Points of cost and error, and what is read off them: slopes, cheapest points, and costs at equal error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from whitted_validation.benchmark.speed_pairs import Comparison


@dataclass(frozen=True)
class Point:
    """One picture.

    Attributes
    ----------
    way : how it was drawn: the name of its curve
    knob : n, target error, samples a pixel or epsilon
    rmse, p999, largest : of its error against the converged picture, linear radiance; the RMSE over all channels, the
        99.9th percentile and the largest over pixels, each by its worst channel
    flip : mean, or None where it is not installed
    rays : over those of one sample a pixel, of all kinds; None where nobody counts them
    cost : time over that of one sample a pixel
    missed : pixels with hidden features whose error is above `MISSED`; None where that was not looked for
    bare : time of tracing the same samples and nothing else, over that of one sample a pixel; None where not taken
    busy : times of all kernels, in parts of the wall time; None where not taken
    """

    way: str
    knob: float
    rmse: float
    p999: float
    largest: float
    flip: float | None = None
    rays: float | None = None
    cost: Comparison | None = None
    missed: int | None = None
    bare: Comparison | None = None
    busy: float | None = None


def cpu(point: Point) -> float:
    """CPU time over that of one sample a pixel; NaN where it was not taken."""
    return point.cost.cpu.median if point.cost else math.nan


def wall(point: Point) -> float:
    """Wall time likewise."""
    return point.cost.wall.median if point.cost else math.nan


def bare_cpu(point: Point) -> float:
    """CPU time of tracing the same samples and nothing else, likewise."""
    return point.bare.cpu.median if point.bare else math.nan


def bare_wall(point: Point) -> float:
    """Wall time of that."""
    return point.bare.wall.median if point.bare else math.nan


def kernels_wall(point: Point) -> float:
    """Sum of the times of its kernels over the wall time of one sample a pixel: without what the host does in between.

    Two kernels that run side by side count twice, and those that run while the host works have fewer cores.
    """
    return math.nan if point.busy is None else wall(point) * point.busy


def rays(point: Point) -> float:
    """Rays likewise."""
    return math.nan if point.rays is None else point.rays


def largest(point: Point) -> float:
    """Return the error of the worst pixel."""
    return point.largest


Of = Callable[[Point], float]


def at_error(points: Iterable[Point], of: Of, rmse: float) -> float:
    """Interpolate, on log-log axes, between the two points whose errors enclose `rmse`.

    A curve that passes it several times counts where it does so first, from the largest error down.

    Returns
    -------
    float
        NaN where the curve does not come to `rmse`.
    """
    known = sorted(((p.rmse, of(p)) for p in points if p.rmse > 0 and of(p) > 0), reverse=True)
    for (above, x), (below, y) in itertools.pairwise(known):
        if above >= rmse >= below:
            share = 0.0 if above == below else math.log(above / rmse) / math.log(above / below)
            return float(x * (y / x) ** share)
    return math.nan


def slope(points: Iterable[Point], of: Of) -> float:
    """Fit log RMSE as a linear function of log `of`, by least squares; NaN for fewer than three points."""
    known = [(math.log(of(p)), math.log(p.rmse)) for p in points if p.rmse > 0 and of(p) > 0]
    if len({x for x, _ in known}) < 3:
        return math.nan
    x, y = np.array(known).T
    x -= x.mean()
    return float(x @ y / (x @ x))


def cheapest(points: Sequence[Point], of: Of) -> list[Point]:
    """Return the Pareto front: the points that no other beats or equals in both cost and error."""
    front: list[Point] = []
    for point in sorted((p for p in points if of(p) > 0), key=lambda p: (of(p), p.rmse)):
        if not front or point.rmse < front[-1].rmse:
            front.append(point)
    return front
