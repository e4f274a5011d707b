"""What refinement is to reach, and whether what was measured shows it.

Where several scenes of a kind were drawn, the median of what each takes counts; single pictures count one by one.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence

from whitted_validation.benchmark.error import GRID, TARGET, UNREFINED, Curves, Kept, Results
from whitted_validation.benchmark.error_checks import CHECKS, NO_CHECKS
from whitted_validation.benchmark.error_curves import (
    Of,
    Point,
    at_error,
    bare_cpu,
    bare_wall,
    cheapest,
    cpu,
    kernels_wall,
    largest,
    rays,
    slope,
    wall,
)
from whitted_validation.benchmark.error_oracle import ORACLE
from whitted_validation.benchmark.error_povray import POVRAY
from whitted_validation.benchmark.error_schedule import FULL
from whitted_validation.benchmark.speed_targets import Outcome

NAMES = {"a": "balls", "b": "clutter", "c": "mesh"}

MOST_RAYS = (("a", 1e-3, 1.6), ("a", 5e-4, 2.0), ("a", 2e-4, 3.0), ("c", 5e-4, 1.5), ("b", 2e-3, 10.0))
"""Scene, RMSE, and rays over those of one sample a pixel."""

MOST_TIME = (("a", 5e-4, 5.0), ("c", 5e-4, 4.0))
"""The same for wall and CPU time."""

CLUTTER = 2e-3
LEAST_GAIN = 2.0
"""In clutter, at this RMSE: time of the grid over ours."""

MOST_WORST = 2.0
"""Error of the worst pixel over that of the grid's at equal RMSE."""

LEAST_KEPT = 0.95
"""Share of pictures below their target error."""

LEAST_SCENES = 30
"""With fewer, nothing is said of the promise."""

MOST_OVER = 1.5
LEAST_USED = 0.3
CHEAP = 1.3
MOST_UNSURE = 0.3
"""RMSE over the target error: never above the first, nor below the second unless the picture takes fewer rays than the
third, over those of one sample a pixel. A converged picture that is more unsure than the fourth, in parts of the target
error, judges only what exceeds the target by more than that.
"""

STEEPEST_GRID = -1.0
"""Slope of log RMSE over log extra rays that refinement is to beat."""

STEEP_FROM = 1e-3
"""Slopes are told from this RMSE down as well: far above it corners alone do, which take hardly any extra rays."""

LEAST_POVRAY = (("a", 30.0), ("c", 30.0), ("b", 20.0))
"""Scene, and the wall time of POV-Ray's best mode over ours at equal RMSE, wherever both curves go."""


BARE = "tracing the same samples alone"
"""Said of the floor beside a time: see `error_bare`."""

OUR_KERNELS = "our kernels alone"
"""Said of a time without what the host does in between."""

PARTS: dict[Of, dict[str, Of]] = {cpu: {BARE: bare_cpu}, wall: {OUR_KERNELS: kernels_wall, BARE: bare_wall}}
"""Of each time, what stands beside it."""


def trusted(curves: Curves, way: str) -> list[Point]:
    """Return the points of a curve that the converged picture can judge: three times as far off as it may be."""
    return [point for point in curves.of(way) if point.rmse > 3 * curves.unsure]


def extra(point: Point) -> float:
    """Rays beyond those of one sample a pixel, in parts of these."""
    return rays(point) - 1


def outcomes(results: Results) -> Iterator[Outcome]:
    """Hold the results against all targets."""
    found, timed = ({kind: of(kind) for kind in NAMES} for of in (results.of, results.timed))
    if any(each.size != FULL.size for drawn in found.values() for each in drawn):
        found = timed = {kind: [] for kind in NAMES}
    for kind, rmse, most in MOST_RAYS:
        target = f"{NAMES[kind]}: RMSE {rmse:g} with at most {most:g} times the rays of one sample a pixel"
        yield _at_most(target, found[kind], rays, rmse, most)
    for kind, rmse, most in MOST_TIME:
        for of, clock in ((cpu, "CPU"), (wall, "wall")):
            target = f"{NAMES[kind]}: RMSE {rmse:g} in at most {most:g} times the {clock} time of one sample a pixel"
            yield _at_most(target, timed[kind], of, rmse, most)
    yield from _clutter(timed["b"])
    for kind, least in LEAST_POVRAY:
        target = f"{NAMES[kind]}: POV-Ray's best mode takes at least {least:g} times the wall time"
        yield _povray(next(iter(timed[kind]), None), target, least)
    yield from _promise(results.kept)
    yield _worst(found)
    yield _slope(timed["a"])  # of the others small errors are not known well enough


def _slope(balls: list[Curves]) -> Outcome:
    target = f"balls: RMSE falls with extra rays more steeply than with power {STEEPEST_GRID:g}"

    def slopes(way: str, below: float = math.inf) -> list[float]:
        return _all_known(slope((p for p in trusted(each, way) if p.rmse <= below), extra) for each in balls)

    ours, grid = slopes(TARGET), slopes(GRID)
    if not ours or not grid:
        return Outcome(target, "", None)
    text = f"{_spread(ours, '{:.2f}')}; grid {statistics.median(grid):.2f}"
    chosen = slopes(ORACLE)
    text += f"; {ORACLE} {_spread(chosen, '{:.2f}')}" if chosen else ""
    below = {way: slopes(way, STEEP_FROM) for way in (TARGET, ORACLE, NO_CHECKS, GRID)}
    told = ", ".join(f"{way} {_spread(found, '{:.2f}')}" for way, found in below.items() if found)
    text += f"; from {STEEP_FROM:g} down: {told}" if told else ""
    return Outcome(target, text, statistics.median(ours) < STEEPEST_GRID)


def _spread(found: Sequence[float], how: str = "{:.3g}") -> str:
    """Write the median, and from where to where the numbers go if there are several."""
    middle, least, most = (how.format(each) for each in (statistics.median(found), min(found), max(found)))
    return f"{middle} ({least} to {most})" if len(found) > 1 else middle


def _all_known(found: Iterable[float]) -> list[float]:
    """Return numbers of which none is missing; else nothing, for a median of the others would be one of luck."""
    known = list(found)
    return [] if any(math.isnan(each) for each in known) else known


def costs(drawn: Sequence[Curves], way: str, of: Of, rmse: float) -> list[float]:
    """Interpolate a cost at this error, one a scene; nothing if the curve of some scene does not come to it."""
    return _all_known(at_error(curves.of(way), of, rmse) for curves in drawn)


def _at_most(target: str, drawn: Sequence[Curves], of: Of, rmse: float, most: float) -> Outcome:
    found = costs(drawn, TARGET, of, rmse)
    if not found:
        return Outcome(target, "", None)
    beside = {"grid": costs(drawn, GRID, of, rmse)}
    if of is rays:
        beside |= {way: costs(drawn, way, of, rmse) for way in (*CHECKS, ORACLE)}
    beside |= {what: costs(drawn, TARGET, part, rmse) for what, part in PARTS.get(of, {}).items()}
    text = "".join(f"; {what} {statistics.median(each):.3g}" for what, each in beside.items() if each)
    return Outcome(target, f"{_spread(found, '{:.4g}')}{text}", statistics.median(found) <= most)


def gains(
    curves: Curves, of: Of, others: Sequence[Point], ours: Of | None = None, way: str = TARGET
) -> list[tuple[float, float]]:
    """Compare one of our curves with another at equal RMSE: our RMSE, and its cost over ours, wherever both go.

    `ours` is what counts as our cost, if not the same as theirs.
    """
    ours = ours or of
    found = []
    for point in trusted(curves, way):
        other = at_error(others, of, point.rmse)
        if ours(point) > 0 and not math.isnan(other):
            found.append((point.rmse, other / ours(point)))
    return found


def _povray(curves: Curves | None, target: str, least: float) -> Outcome:
    """Compare with the cheapest of POV-Ray's modes, at the error of each of our pictures."""
    target = f"{target} at equal RMSE"
    if curves is None:
        return Outcome(target, "", None)
    theirs = cheapest([p for p in curves.points if p.way.startswith(POVRAY)], wall)
    ratios = gains(curves, wall, theirs)
    text = ", ".join(f"{gain:.3g} at {rmse:.2g}" for rmse, gain in ratios)
    for what, part in PARTS[wall].items():
        alone = [gain for _, gain in gains(curves, wall, theirs, part)]
        text += f"; {what} {min(alone):.3g} to {max(alone):.3g}" if alone else ""
    return Outcome(target, text, all(g >= least for _, g in ratios) if ratios else None)


def _of_grid(drawn: Sequence[Curves], of: Of, ours: Of) -> list[float]:
    """Tell how many times as much as ours the grid takes in clutter, one a scene; nothing if some curve ends before."""
    ratios = (at_error(curves.of(GRID), of, CLUTTER) / at_error(curves.of(TARGET), ours, CLUTTER) for curves in drawn)
    return _all_known(ratios)


def _clutter(drawn: Sequence[Curves]) -> Iterator[Outcome]:
    for of, clock in ((cpu, "CPU"), (wall, "wall")):
        target = f"clutter: RMSE {CLUTTER:g} in at most 1/{LEAST_GAIN:g} of the grid's {clock} time"
        ratios = _of_grid(drawn, of, of)
        if ratios:
            floors = {what: _of_grid(drawn, of, part) for what, part in PARTS[of].items()}
            beside = "".join(f"; {what} 1/{statistics.median(each):.3g}" for what, each in floors.items() if each)
            text = _spread(ratios, "1/{:.3g}") + beside
            yield Outcome(target, text, statistics.median(ratios) >= LEAST_GAIN)
        else:
            yield Outcome(target, "", None)
        target = f"clutter: never slower than the grid of equal RMSE, {clock} time"
        pairs = [(curves, *pair) for curves in drawn for pair in gains(curves, of, curves.of(GRID))]
        slower = [
            f"at {rmse:.2g} {1 / gain:.3g} times its time{_untargeted(curves, of, rmse)}"
            for curves, rmse, gain in pairs
            if gain < 1
        ]
        text = f"{len(slower)} of {len(pairs)} pictures slower" + "".join(f"; {each}" for each in slower)
        text += f"; than the fastest grid that was drawn and is as good {_than_drawn(drawn, of)}" if pairs else ""
        for what, part in PARTS[of].items():
            alone = [pair for curves in drawn for pair in gains(curves, of, curves.of(GRID), part)]
            too_slow = [f"{1 / gain:.3g} times at {rmse:.2g}" for rmse, gain in alone if gain < 1]
            text += f"; {what} slower in {len(too_slow)}" if alone else ""
            text += f": {', '.join(too_slow)}" if too_slow else ""
        yield Outcome(target, text if pairs else "", not slower if pairs else None)


def _untargeted(curves: Curves, of: Of, rmse: float) -> str:
    """Tell what a picture without a target takes of the grid's time at this error."""
    found = [of(point) / at_error(curves.of(GRID), of, rmse) for point in curves.of(UNREFINED)]
    return "".join(f" ({UNREFINED} {each:.3g})" for each in found)


def _than_drawn(drawn: Sequence[Curves], of: Of) -> int:
    """Count our pictures that take longer than the fastest of the grid's own pictures with no larger RMSE.

    A curve through those goes where no grid can be: between n and n + 1. Pictures beyond its ends do not count.
    """
    count = 0
    for curves in drawn:
        grids = curves.of(GRID)
        for point in trusted(curves, TARGET):
            if not math.isnan(at_error(grids, of, point.rmse)):
                count += of(point) > min(of(grid) for grid in grids if grid.rmse <= point.rmse and of(grid) > 0)
    return count


def can_judge(kept: Kept) -> bool:
    """Tell whether the converged picture is good enough to judge this one, or this one so bad that any is."""
    return kept.unsure <= MOST_UNSURE * kept.target or kept.rmse - kept.unsure > kept.target


def _promise(kept: Sequence[Kept]) -> Iterator[Outcome]:
    unknown = sum(not can_judge(each) for each in kept)
    kept = [each for each in kept if can_judge(each)]
    scenes = len({each.scene for each in kept})
    below = sum(each.rmse <= each.target for each in kept)
    over = [each for each in kept if each.rmse > MOST_OVER * each.target]
    enough = scenes >= LEAST_SCENES
    text = f"{below} of {len(kept)} on {scenes} scenes" + f"; {unknown} more cannot be judged" * bool(unknown)
    target = f"target error kept in at least {100 * LEAST_KEPT:g} % of the pictures"
    yield Outcome(target, text if kept else "", below >= LEAST_KEPT * len(kept) if enough else None)
    most = max((each.rmse / each.target for each in kept), default=math.nan)
    target = f"and never exceeded by more than {MOST_OVER:g} times"
    yield Outcome(
        target, f"{len(over)} pictures; at most {most:.3g} times" if kept else "", not over if enough else None
    )
    target = f"and not wasteful: at least {LEAST_USED:g} of it, where a picture takes over {CHEAP:g} times the rays"
    waste = [each for each in kept if each.rmse < LEAST_USED * each.target and each.rays >= CHEAP]
    text = f"{len(waste)} of {len(kept)} wasteful"
    more = _room(kept)
    if waste and more < math.inf:
        still = sum(more * each.rmse < LEAST_USED * each.target for each in waste)
        text += f"; were all errors {more:.3g} times as large, {still}"
    yield Outcome(target, text if kept else "", not waste if enough else None)


def _room(kept: Sequence[Kept]) -> float:
    """Tell how many times as large all errors might be before the two promises above are broken.

    As if a larger part of each target were aimed at: what one constant could do.
    """
    parts = sorted(each.rmse / each.target for each in kept)
    last_kept = parts[math.ceil(LEAST_KEPT * len(parts)) - 1] if parts else 0
    return min(1 / last_kept, MOST_OVER / parts[-1]) if last_kept else math.inf


def _worst(found: dict[str, list[Curves]]) -> Outcome:
    """Compare the worst pixel of each picture with that of the grid at equal RMSE."""
    target = f"worst pixel at most {MOST_WORST:g} times that of the grid of equal RMSE"

    def worse(way: str) -> tuple[int, str]:
        ratios = [
            (1 / gain, f"{NAMES[kind]}, seed {curves.seed},", rmse)
            for kind, drawn in found.items()
            for curves in drawn
            for rmse, gain in gains(curves, largest, curves.of(GRID), way=way)
        ]
        if not ratios:
            return 0, ""
        most, which, rmse = max(ratios)
        above = sum(ratio > MOST_WORST for ratio, *_ in ratios)
        return above, f"{above} of {len(ratios)} pictures worse; at most {most:.3g} times, {which} at {rmse:.2g}"

    above, text = worse(TARGET)
    if not text:
        return Outcome(target, "", None)
    others = {way: worse(way)[1] for way in CHECKS}
    return Outcome(target, text + "".join(f"; {way}: {told}" for way, told in others.items() if told), not above)
