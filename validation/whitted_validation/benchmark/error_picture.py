"""One picture of a curve: how far it is off the converged one, and what it costs beside one sample a pixel."""

from __future__ import annotations

import statistics
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_validation.benchmark.error_curves import Point
from whitted_validation.benchmark.error_drawing import Draw, Image, Timed, pixels
from whitted_validation.benchmark.error_schedule import Schedule
from whitted_validation.benchmark.speed_pairs import Comparison, compare
from whitted_validation.benchmark.speed_pairs import Timed as Clocked
from whitted_validation.comparison import compare as compare_pictures
from whitted_validation.render import Stopwatch

MISSED = 1e-2
"""A pixel with a hidden feature is missed if a channel is off by more."""

BUSY = 5
"""Pictures whose kernels are timed."""

TICK = 0.1
"""A tick of the CPU's clock is at most this share of a sample."""


def picture_point(
    way: str,
    knob: float,
    draw: Draw,
    truth: Image,
    schedule: Schedule,
    one: Timed | None = None,
    traced: float | None = None,
    hidden: Any = None,
) -> Point:
    """Draw one picture, compare it with the converged one, and take its time beside one sample a pixel."""
    drawn = pixels(draw)
    costs = None if one is None else timed(draw, one, len(truth), schedule)
    return compared(way, knob, drawn, truth, costs, traced, hidden)


def timed(draw: Draw, one: Timed, side: int, schedule: Schedule) -> Comparison:
    """Take the time of a picture beside one sample a pixel."""
    drawing = Timed(draw, side)
    return cost(one, drawing, drawing.facts.one.wall, schedule)


def busy(draw: Draw, side: int) -> float:
    """Sum up the times of a picture's kernels, in parts of its wall time: the median of some pictures."""
    drawing, shares = Timed(draw, side), []
    for _ in range(BUSY):
        with Stopwatch() as kernels:
            taken = drawing.sample(1)
        shares.append(kernels.running / taken.wall)
    return statistics.median(shares)


def cost(one: Timed, other: Clocked, seconds: float, schedule: Schedule) -> Comparison:
    """Take the time of a way to draw, for whose picture one waits so many seconds, beside one sample a pixel."""
    a_pair = 2 * max(seconds, TICK)
    pairs = max(1, min(schedule.pairs, int(schedule.patience / a_pair)))
    return compare(one, other, pairs, TICK)


def compared(
    way: str,
    knob: float,
    drawn: NDArray[Any],
    truth: Image,
    costs: Comparison | None,
    traced: float | None,
    hidden: NDArray[np.bool_] | None,
) -> Point:
    """Compare a picture with the converged one."""
    found = compare_pictures(drawn, truth)
    missed = None if hidden is None else int(np.count_nonzero(hidden & (found.error > MISSED)))
    p999 = dict(found.percentiles)[99.9]
    return Point(way, knob, found.rmse, p999, found.largest, found.flip.mean, traced, costs, missed)
