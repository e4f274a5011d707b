"""What came out, for the eye and as data.

results.json, besides what every command writes
    quick      whether `--quick` was given
    complete   false while steps are missing, and after an interruption
    schedule   what was to be measured: see `error_schedule.Schedule`
    frozen     the commit whose number gives the seeds
    povray     its version; null where it is not installed
    targets    one object a target: target, measured, verdict (met, not met, not measured)
    scenes     by letter: title, seed, size, rays (of one sample a pixel, all kinds), unsure and checked (RMSE between
        the converged picture and a coarser grid, and a refined picture), hidden (pixels whose corners do not show what
        is in them), slopes (by curve: of log RMSE over log rays, log extra rays and log CPU time), note (why POV-Ray
        is missing), and
        points one object a picture: way, knob (n, target error, samples, threshold), rmse, p999, largest, flip, rays
            (over those of one sample a pixel), missed (hidden and off by more than 1e-2), cost (time over that of one
            sample a pixel, as `comparison` in results.json of `whitted benchmark speed`; null with other checks and for
            the oracle), bare (the same of tracing the same samples in one launch and nothing else; null but for the
            ways `target error` and `without a target`, whose knob is an error above any), busy (times of all kernels in
            parts of the wall time; likewise)
    redrawn    the same of more scenes of these kinds, with their kind; no POV-Ray
    untimed    the same of still more, without times
    peers      the same of the scene that `path` and `direct` draw alike
    epsilon    points of the textbook's constant; knob is the constant, in world units
    shadows    share of points in the wrong light: case, by_epsilon (pairs), ours (without a constant)
    exact      of one sample a pixel in float32 against double precision: rmse, largest, above_1e-3, pixels
    kept       one object a target error and scene: scene, target, rmse, rays, unsure
    seconds    that it took;    notes: what could not be measured
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from whitted_validation import report
from whitted_validation.benchmark.error import FROZEN, GRID, RANDOM, TARGET, UNREFINED, Curves, Results
from whitted_validation.benchmark.error_curves import (
    Of,
    Point,
    at_error,
    bare_cpu,
    cheapest,
    cpu,
    kernels_wall,
    rays,
    slope,
    wall,
)
from whitted_validation.benchmark.error_drawing import PEERS
from whitted_validation.benchmark.error_epsilon import Wrong
from whitted_validation.benchmark.error_oracle import ORACLE
from whitted_validation.benchmark.error_povray import METHODS
from whitted_validation.benchmark.error_schedule import Schedule
from whitted_validation.benchmark.error_targets import (
    BARE,
    MOST_RAYS,
    NAMES,
    OUR_KERNELS,
    can_judge,
    extra,
    outcomes,
    trusted,
)
from whitted_validation.benchmark.speed_page import plain, targets_table
from whitted_validation.report import Chart, Group, Section, Sentence, Table
from whitted_validation.report.sections import Cell, Tone, short
from whitted_validation.stress.case import percent

FLOORS = f"wall, {OUR_KERNELS}", f"CPU, {BARE}"
"""Columns of a picture's times that stand beside its own."""

AXES: dict[str, Of] = {"rays": rays, "extra rays": extra, "CPU time": cpu}


def write(folder: Path, results: Results, schedule: Schedule, quick: bool) -> None:
    """Write results.json and report.html."""
    facts = {
        "quick": quick,
        "complete": results.complete,
        "schedule": plain(schedule),
        "frozen": FROZEN,
        "targets": [
            {"target": each.target, "measured": each.measured, "verdict": each.verdict} for each in outcomes(results)
        ],
        "povray": results.povray,
        "scenes": {kind: _curves_facts(curves) for kind, curves in results.scenes.items()},
        "redrawn": [{"kind": kind} | _curves_facts(curves) for kind, curves in results.redrawn],
        "untimed": [{"kind": kind} | _curves_facts(curves) for kind, curves in results.untimed],
        "peers": _curves_facts(results.peers) if results.peers else None,
        "epsilon": [plain(point) for point in results.epsilon],
        "shadows": [plain(each) for each in results.shadows],
        "exact": dict(zip(("rmse", "largest", "above_1e-3", "pixels"), results.exact, strict=True))
        if results.exact
        else None,
        "kept": [plain(each) for each in results.kept],
        "seconds": results.seconds,
        "notes": results.notes,
    }
    report.write(folder, facts, "whitted benchmark error", sections(results, schedule, quick))


def _curves_facts(curves: Curves) -> dict[str, Any]:
    facts: dict[str, Any] = plain(curves)
    return facts | {"slopes": _slopes(curves)}


def _ways(curves: Curves) -> list[str]:
    return list(dict.fromkeys(point.way for point in curves.points))


def _others(curves: Curves) -> list[list[str]]:
    """Tell what stands beside our own two curves: nothing; other checks; an oracle; each peer; POV-Ray's methods."""
    others = [way for way in _ways(curves) if way not in (GRID, TARGET)]
    peers = TARGET, ORACLE, *PEERS, *METHODS
    by_peer = [[way for way in others if way == peer or way.startswith(f"{peer},")] for peer in peers]
    return [[], *(ways for ways in by_peer if ways)]


def _slopes(curves: Curves) -> dict[str, dict[str, float]]:
    ways = dict.fromkeys((GRID, TARGET, *(way for way in _ways(curves) if way != UNREFINED)))  # that is no curve
    return {way: {axis: slope(trusted(curves, way), of) for axis, of in AXES.items()} for way in ways}


def summary(results: Results) -> str:
    """Say in one sentence what came out."""
    verdicts = [outcome.met for outcome in outcomes(results)]
    measured = [met for met in verdicts if met is not None]
    missing = len(verdicts) - len(measured)
    said_missing = f"; {missing} are not measured" if missing else ""
    interrupted = "" if results.complete else "; not all is measured yet"
    return f"{sum(measured)} of {len(measured)} targets met{said_missing}{interrupted}."


def lines(results: Results) -> Iterator[str]:
    """Return the lines of the tables on the terminal; more are added at the end as results come in."""
    for name, curves in _all(results):
        yield f"scene {name}, {curves.title}, seed {curves.seed}: rays and times over those of one sample a pixel"
        for p in curves.points:
            traced = "" if p.rays is None else short(p.rays)
            cpu_time, wall_time = (short(of(p)) if p.cost else "" for of in (cpu, wall))
            hidden = "" if p.missed is None else f"  missed {p.missed}"
            yield (
                f"  {p.way:<34} {p.knob:<7g} RMSE {p.rmse:<9.2e} worst {p.largest:<9.2e} rays {traced:<9} "
                f"CPU {cpu_time:<8} wall {wall_time:<8}{hidden}"
            )
    for p in results.epsilon:
        yield f"epsilon {p.knob:<8g} RMSE {p.rmse:.2e} worst {p.largest:.2e}"
    for wrong in results.shadows:
        shares = ", ".join(f"{epsilon:g}: {percent(share)}" for epsilon, share in wrong.by_epsilon)
        yield f"points in the wrong light, {wrong.case}, by epsilon: {shares}; without: {percent(wrong.ours)}"
    for kept in results.kept:
        if kept.scene.startswith(RANDOM):
            parts = f"RMSE {kept.rmse / kept.target:.2f} E, {kept.rays:.3g} times the rays of one sample a pixel"
            yield f"{kept.scene}, E = {kept.target:g}: {parts}; converged within {kept.unsure:.1e}"
    if results.exact:
        yield "float32 against double precision: " + _exact(results.exact)


def _all(results: Results) -> Iterator[tuple[str, Curves]]:
    """Return all scenes, in the order in which they are drawn."""
    yield from _named(results.drawn())
    yield from _peers(results)


def _named(drawn: Iterable[tuple[str, Curves]]) -> Iterator[tuple[str, Curves]]:
    return ((f"{kind} ({NAMES[kind]})", curves) for kind, curves in drawn)


def _peers(results: Results) -> Iterator[tuple[str, Curves]]:
    if results.peers:
        yield "with one light", results.peers


def _exact(exact: tuple[float, float, int, int]) -> str:
    rmse, most, above, pixels = exact
    return f"RMSE {rmse:.2e}, largest error {most:.2e}, {above} of {pixels} pixels off by more than 1e-3"


def sections(results: Results, schedule: Schedule, quick: bool) -> list[Section]:
    """Build the page."""
    held = list(outcomes(results))
    parts: list[Section] = [
        Sentence(summary(results), "bad" if any(each.met is False for each in held) else "good"),
        Sentence(
            "Errors are those of linear radiance against a converged picture: a Fibonacci "
            f"lattice of {schedule.converged} samples in each pixel. Rays and times are given over those "
            "of one sample a pixel of the same scene. Times are medians of pairs, drawn in turn, up to "
            f"{schedule.pairs} of them; CPU time is that of all threads. {_by_povray(results)}"
            "Beside a time stands its floor: that of tracing the same samples alone, as if all were known beforehand, "
            "all at once and neighbours together; beside a wall time also the sum of its kernels' times, without what "
            "the host does in between, which the time that it is held against keeps. "
            "Pixels are checked by more samples for what no corner meets; the same is drawn without such checks, and "
            "with 16 times as many, but for those of some pixels in clutter, and the least next to a find. An oracle "
            "knows how far off each pixel is, and takes it from that refined picture where it gains most for its rays; "
            "what refinement takes beyond that is the price of guessing, and of the oracle's luck. "
            "Of several scenes of a kind the median of what each takes counts, and single pictures one by one; POV-Ray "
            f"draws the first. {_without_times(schedule)}The seeds of the scenes come from the number of the commit "
            f"after which no constant of the refinement was changed, `{FROZEN}`."
        ),
        targets_table(held, quick),
    ]
    for name, curves in [*_named(results.scenes.items()), *_peers(results)]:
        parts.append(_scene(name, curves, schedule))
    if results.redrawn or results.untimed:
        parts.append(_redrawn(results))
    if results.kept:
        parts.append(_kept(results))
    if results.epsilon:
        parts.append(_epsilon(results.epsilon, results.shadows))
    if results.exact:
        note = f"Scene a, {schedule.exact_size} x {schedule.exact_size}, one sample a pixel, by the reference tracer."
        parts.append(Group("float32 against double precision", [Sentence(_exact(results.exact) + ".")], note))
    if results.notes:
        parts.append(Group("Not measured", [Sentence(note) for note in results.notes]))
    return parts


def _by_povray(results: Results) -> str:
    if results.povray is None:
        return ""
    return f"POV-Ray {results.povray} draws the same scenes; its times are those of its phase that traces. "


def _without_times(schedule: Schedule) -> str:
    if not schedule.untimed:
        return ""
    return (
        f"Of {schedule.untimed} more of each kind rays and errors are taken but no times, against lattices of "
        f"{schedule.converged_untimed} samples; they count for rays, the worst pixel and the promise. "
    )


def _scene(name: str, curves: Curves, schedule: Schedule) -> Group:
    note = (
        f"Seed {curves.seed}, {curves.size} x {curves.size} pixels, {curves.rays:,} rays at one sample a pixel. The "
        f"converged picture differs from one of at most half as many samples by an RMSE of {short(curves.unsure)}, "
        f"and from a picture refined to {schedule.refined:g} by {short(curves.checked)}; slopes are fitted to errors "
        f"above three times the former. {curves.hidden:,} pixels show their corners nothing of what is in them; "
        "missed are those of them that are off by more than 1e-2."
    )
    if not curves.points:
        return Group(f"Scene {name}: {curves.title}", [], note)
    parts: list[Section] = []
    slopes = _slopes(curves)
    front = {id(point) for point in cheapest(curves.points, cpu)}
    for axis in ("rays", "CPU time"):
        for others in _others(curves):
            series = {}
            for way in (GRID, TARGET, *others):
                points = [(AXES[axis](p), p.rmse) for p in curves.of(way) if AXES[axis](p) > 0]
                fitted = "" if math.isnan(slopes[way][axis]) else f", slope {slopes[way][axis]:.2f}"
                if points:
                    series[f"{way}{fitted}"] = points
            if len(series) == 2 + len(others):  # not all rays are counted, nor all times taken
                parts.append(Chart("Error against cost", f"{axis}, one sample a pixel = 1", "RMSE", series))
    rows = [_row(point, id(point) in front) for point in curves.points]
    errors, costs = ("RMSE", "99.9 %", "worst", "FLIP"), ("rays", "CPU time", "wall time", *FLOORS)
    columns = ["way", "n, E, samples or threshold", *errors, *costs, "missed", ""]
    parts.append(Table(columns, rows, "All pictures; on the front: none is better in both CPU time and RMSE"))
    table: list[list[str | float | Cell]] = [
        [way, *("" if math.isnan(x) else f"{x:.2f}" for x in found.values())] for way, found in slopes.items()
    ]
    parts.append(Table(["way", *AXES], table, "Slopes: RMSE falls with this power of the cost"))
    return Group(f"Scene {name}: {curves.title}", parts, note)


def _redrawn(results: Results) -> Group:
    """Compare scenes of the same kind at the errors that are asked for."""
    at = [(kind, rmse) for kind, rmse, _ in MOST_RAYS]
    costs = ["rays", "CPU time", "wall time"]
    columns = ["scene", "seed", "converged within", "RMSE", *costs, *(f"grid: {each}" for each in costs)]
    rows: list[list[str | float | Cell]] = []
    for kind, rmse in sorted(at, key=lambda each: (each[0], -each[1])):
        for curves in results.of(kind):
            found = [at_error(curves.of(way), of, rmse) for way in (TARGET, GRID) for of in (rays, cpu, wall)]
            cells = ["" if math.isnan(x) else x for x in found]
            rows.append([f"{kind} ({NAMES[kind]})", str(curves.seed), curves.unsure, rmse, *cells])
    note = "Rays and times over those of one sample a pixel, interpolated between the pictures of each curve."
    return Group("All scenes of each kind", [Table(columns, rows)], note)


def _row(p: Point, on_front: bool) -> list[str | float | Cell]:
    flip = "not installed" if p.flip is None else p.flip
    missed = "" if p.missed is None else p.missed
    shown = [("" if x != x else x) for x in (rays(p), cpu(p), wall(p), kernels_wall(p), bare_cpu(p))]
    return [p.way, p.knob, p.rmse, p.p999, p.largest, flip, *shown, missed, Cell("on the front" * on_front, "good")]


def _kept(results: Results) -> Group:
    targets = sorted({each.target for each in results.kept}, reverse=True)
    by_place = {(each.scene, each.target): each for each in results.kept}
    rows: list[list[str | float | Cell]] = []
    for scene in dict.fromkeys(each.scene for each in results.kept):
        row: list[str | float | Cell] = [scene]
        found = [by_place.get((scene, target)) for target in targets]
        row.append(max(each.unsure for each in found if each))
        for each in found:
            if each is None:
                row += ["", ""]
            else:
                over = each.rmse / each.target
                tone: Tone = "good" if over <= 1 else "bad"
                tone = tone if can_judge(each) else "quiet"
                row += [Cell(over, tone), each.rays]
        rows.append(row)
    columns = ["scene", "converged within", *(c for t in targets for c in (f"RMSE / {t:g}", "rays"))]
    note = (
        "RMSE over the target error, and rays over those of one sample a pixel; grey where the converged picture "
        "itself may be too far off to tell."
    )
    return Group("Is the target error kept?", [Table(columns, rows)], note)


def _epsilon(points: list[Point], shadows: list[Wrong]) -> Group:
    note = (
        "Scene a at one sample a pixel, drawn with the textbook's constant on all shadow and mirror rays, against the "
        "picture without any: too small a constant lets surfaces shade themselves, too large a one loses contacts. "
        "Below, points of bodies that are alone and come out lit instead of dark, or dark instead of lit; `whitted "
        "stress` has more of such cases."
    )
    chart = Chart("Error against epsilon", "epsilon, world units", "RMSE", {"RMSE": [(p.knob, p.rmse) for p in points]})
    rows: list[list[str | float | Cell]] = [[f"{p.knob:g}", p.rmse, p.p999, p.largest] for p in points]
    parts: list[Section] = [chart, Table(["epsilon", "RMSE", "99.9 %", "worst"], rows)]
    if shadows:
        wrong = {each.case: each.by_epsilon for each in shadows}
        parts.append(Chart("Points in the wrong light", "epsilon, sizes of the body", "share", wrong))
        without = ", ".join(f"{percent(each.ours)} ({each.case})" for each in shadows)
        parts.append(Sentence(f"Without a constant the share of wrong points is {without}."))
    return Group("The textbook's epsilon", parts, note)
