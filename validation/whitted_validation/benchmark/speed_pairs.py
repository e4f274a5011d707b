"""Two processes side by side: which is faster, and how sure that is.

They draw in turn, A B, B A, A B, ..., so that whatever slows the machine for a while slows both, and a steady
drift favours neither. Each pair gives a ratio; the median of these is the result.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from whitted_validation.benchmark.speed_worker import Facts, Sample

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """A median, and where it lies with a confidence of at least 95 %; NaN where there are too few numbers."""

    median: float
    low: float
    high: float
    least: float
    most: float

    def inverse(self) -> Interval:
        """Turn the ratio round."""
        return Interval(1 / self.median, 1 / self.high, 1 / self.low, 1 / self.most, 1 / self.least)


def interval(values: Sequence[float]) -> Interval:
    """Find the distribution-free interval of the median from order statistics (David and Nagaraja 2003, 7.1).

    For independent values of one continuous distribution the number below its median is binomial (n, 1/2). So the
    k-th smallest and k-th largest enclose the median but for a probability of 2 P(fewer than k of n), and k is the
    largest that keeps it within 5 %. Fewer than 6 values have no such interval.
    """
    n, ordered = len(values), sorted(values)
    k, outside = 0, 0.0
    while True:
        outside += 2 * math.comb(n, k) / 2**n
        if outside > 1 - CONFIDENCE:
            break
        k += 1
    low, high = (ordered[k - 1], ordered[n - k]) if k else (math.nan, math.nan)
    return Interval(statistics.median(ordered), low, high, ordered[0], ordered[-1])


class Timed(Protocol):
    """What draws when it is told to."""

    facts: Facts

    def sample(self, pictures: int) -> Sample:
        """Draw so many pictures and take the time."""


@dataclass(frozen=True)
class Comparison:
    """Time of B over time of A, a pixel.

    Attributes
    ----------
    cpu, wall : the ratios
    a, b : medians, seconds a picture
    pictures : in one sample of A, and of B
    """

    cpu: Interval
    wall: Interval
    a: Sample
    b: Sample
    pictures: tuple[int, int]
    pairs: int


def compare(
    a: Timed, b: Timed, pairs: int, share_of_tick: float, told: Callable[[], None] = lambda: None
) -> Comparison:
    """Draw in turn and take the time.

    Parameters
    ----------
    pairs : how many
    share_of_tick : a sample takes so long that a tick of its clock is at most this share of it
    told : called after each pair
    """
    pictures = tuple(max(1, math.ceil(w.facts.tick / share_of_tick / max(w.facts.one.cpu, 1e-9))) for w in (a, b))
    taken: list[tuple[Sample, Sample]] = []
    for number in range(pairs):
        first, second = ((a, pictures[0]), (b, pictures[1]))[:: -1 if number % 2 else 1]
        samples = first[0].sample(first[1]), second[0].sample(second[1])
        taken.append((samples[1], samples[0]) if number % 2 else samples)
        told()
    pixels = a.facts.side**2 / b.facts.side**2

    def ratio(clock: str) -> Interval:
        return interval([pixels * getattr(y, clock) / getattr(x, clock) for x, y in taken])

    def middle(which: int) -> Sample:
        return Sample(*(statistics.median(getattr(pair[which], clock) for pair in taken) for clock in Sample._fields))

    return Comparison(ratio("cpu"), ratio("wall"), middle(0), middle(1), (pictures[0], pictures[1]), pairs)
