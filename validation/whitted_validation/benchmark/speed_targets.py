"""What the plugin is to reach, and whether what was measured shows it.

A ratio meets its target only if the whole interval of its median is on the good side of it. Beside two kinds of target
stands what there is to be reached at all: scenes of balls drawn by a kernel that is written for them by hand (`floor`),
and the bare rays in place of the plugin against POV-Ray.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from whitted_validation.benchmark.speed import MIXED, Results
from whitted_validation.benchmark.speed_configurations import POVRAY
from whitted_validation.benchmark.speed_memory import MOST_MB, SIDE
from whitted_validation.benchmark.speed_pairs import Interval

MOST_OF_LIMIT = {"a": 0.65, "b": 0.75, "c": 1.30, MIXED: 1.35, "e": 1.35, "f": 1.35, "g": 1.35, "d": 0.5}
"""CPU time of the plugin over that of the bare rays."""

LEAST_GAIN = {"a": 3.0, "b": 2.2, "c": 1.7}
"""CPU time of Mitsuba's `path` with the same materials over that of the plugin."""

LEAST_POVRAY = {"a": 25.0, "b": 25.0, "c": 25.0}
"""Wall time that POV-Ray traces, over that of the plugin."""

MOST_BYTES = 12.0
"""A pixel: three float32."""

MOST_START = 1.5
"""Wall time of `whitted render` over that of a bare script, both with a warm cache."""

MOST_LAUNCH = 3e-3
"""Seconds of the calling thread until `mi.render()` returns with evaluation put off, 200 shapes."""


@dataclass(frozen=True)
class Outcome:
    """A target and what was measured; `met` is None where nothing was."""

    target: str
    measured: str
    met: bool | None

    @property
    def verdict(self) -> str:
        """Say it in a word or two."""
        return {True: "met", False: "not met", None: "not measured"}[self.met]


def outcomes(results: Results) -> Iterator[Outcome]:
    """Hold the results against all targets."""
    for kind, most in MOST_OF_LIMIT.items():
        over_limit = _ratio(results, kind, "limit", Interval.inverse)
        outcome = _at_most(f"scene {kind}: at most {most:g} of the CPU time of the bare rays", over_limit, most)
        floor = _ratio(results, kind, "floor", lambda ratio: ratio)
        yield _with_floor(outcome, floor.median * over_limit.median if floor and over_limit else None, "by hand")
    for kind, least in LEAST_GAIN.items():
        gain = _ratio(results, kind, "path", lambda ratio: ratio)
        yield _at_least(f"scene {kind}: `path` takes at least {least:g} times the CPU time", gain, least)
    for kind, least in LEAST_POVRAY.items():
        measured = results.scenes.get(kind)
        row = measured.row(POVRAY) if measured else None
        gain = row.comparison.wall if row and row.comparison else None
        outcome = _at_least(f"scene {kind}: POV-Ray traces for at least {least:g} times the wall time", gain, least)
        bare = measured.row("limit") if measured else None
        rays = bare.comparison.wall.median if bare and bare.comparison else None
        yield _with_floor(outcome, gain.median / rays if gain and rays else None, "the bare rays")
    yield _never_slower(results)
    yield _memory(results)
    yield _large(results)
    warm = results.starts["warm"].wall if "warm" in results.starts else None
    yield _at_most(f"a warm start takes at most {MOST_START:g} times the time of a bare script", warm, MOST_START)
    yield _launch(results)
    yield _edits(results)


def _ratio(results: Results, kind: str, name: str, turn: Callable[[Interval], Interval]) -> Interval | None:
    measured = results.scenes.get(kind)
    row = measured.row(name) if measured else None
    return turn(row.comparison.cpu) if row and row.comparison else None


def _with_floor(outcome: Outcome, floor: float | None, whose: str) -> Outcome:
    """Tell beside what was measured what there is to be reached at all, in the same units."""
    return outcome if floor is None else replace(outcome, measured=f"{outcome.measured}; {whose}: {floor:.3g}")


def _at_most(target: str, ratio: Interval | None, most: float) -> Outcome:
    return Outcome(target, _said(ratio), None if ratio is None or math.isnan(ratio.high) else ratio.high <= most)


def _at_least(target: str, ratio: Interval | None, least: float) -> Outcome:
    return Outcome(target, _said(ratio), None if ratio is None or math.isnan(ratio.low) else ratio.low >= least)


def said(ratio: Interval) -> str:
    """Write a median and its interval."""
    if math.isnan(ratio.low):
        return f"{ratio.median:.3g} ({ratio.least:.3g} to {ratio.most:.3g}, too few for an interval)"
    return f"{ratio.median:.3g} ({ratio.low:.3g} to {ratio.high:.3g})"


def _said(ratio: Interval | None) -> str:
    return "" if ratio is None else said(ratio)


def _never_slower(results: Results) -> Outcome:
    """Look for scenes where every pair finds the plan slower: 1 in 2^9 for 9 pairs of two that are equally fast.

    A random scene has been measured again then, in new processes, and stands here with what these found.
    """
    rows = {f"scene {kind}": measured.row("general") for kind, measured in results.scenes.items()}
    rows |= {f"random scene {seed}": row for seed, row in results.random.items()}
    ratios = {where: row.comparison.cpu.inverse() for where, row in rows.items() if row and row.comparison}
    slower = [f"{where}: {said(ratio)}" for where, ratio in ratios.items() if ratio.least > 1]
    text = f"{len(slower)} of {len(ratios)} slower" + "".join(f"; {each}" for each in slower)
    target = "no scene slower with its plan than with the general kernel in every pair"
    return Outcome(target, text if ratios else "", not slower if ratios else None)


def _memory(results: Results) -> Outcome:
    """Divide what two sizes of a picture differ by: what the process takes anyhow drops out."""
    target = f"memory: at most {MOST_BYTES:g} bytes a pixel"
    if len(results.sizes) < 2:
        return Outcome(target, "", None)
    small, large = (results.sizes[size] for size in (min(results.sizes), max(results.sizes)))
    a_pixel = 1e6 * (large.first_mb - small.first_mb) / (large.side**2 - small.side**2)
    return Outcome(target, f"{a_pixel:.3g} from {small.side} to {large.side} pixels a side", a_pixel <= MOST_BYTES)


def _large(results: Results) -> Outcome:
    large, target = results.large, f"memory: {SIDE} x {SIDE} to a file within {MOST_MB:g} MB"
    if large is None:
        return Outcome(target, "", None)
    text = f"{large.peak_mb:.0f} MB" + ", stopped there" * large.stopped
    return Outcome(target, text, not large.stopped and large.peak_mb <= MOST_MB)


def _launch(results: Results) -> Outcome:
    measured = results.scenes.get("b")
    met = None if measured is None or math.isnan(measured.launch) else measured.launch < MOST_LAUNCH
    text = "" if measured is None or met is None else f"{1000 * measured.launch:.2f} ms"
    return Outcome(f"`mi.render()` returns in under {1000 * MOST_LAUNCH:g} ms with 200 shapes", text, met)


def _edits(results: Results) -> Outcome:
    compiled = {f"{kind}: {key}": n for kind, m in results.scenes.items() for key, n in m.edits.items()}
    at_fault = [key for key, n in compiled.items() if n]
    text = f"{len(compiled)} edits, {len(at_fault)} compiled" + "".join(f"; {key}" for key in at_fault)
    return Outcome("no edit of a value compiles", text if compiled else "", not at_fault if compiled else None)
