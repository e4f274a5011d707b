"""What came out, for the eye and as data.

results.json, besides what every command writes
    quick      whether `--quick` was given
    complete   false while steps are missing, and after an interruption
    schedule   size of the pictures, pairs, share of a tick of the CPU's clock in a sample
    targets    one object a target: target, measured, verdict (met, not met, not measured)
    scenes     by letter: title, size, rays by kind, rays_per_second (millions; of wall and of CPU time), plan,
        launch (s), edits (kernels compiled after each), facts (of the planned kernel), note, and
        povray (of one of its pictures: version, rays, shadow_rays, and parse, the s that it takes to read the scene),
        rows   one object a configuration: name, family, words, note, off (share of pixels), facts, comparison
    random     by seed: the row of the general kernel
    sizes      by size: facts;    large: side, peak_mb, stopped;    starts: cold and warm
    load       of the machine, one number a part;    notes: what could not be measured
    facts      side, kernels (hashes), operations, one (s a picture: wall, cpu), and the most memory (10^6 bytes):
        loaded_mb before the first picture, first_mb after it, peak_mb after several
    comparison time over that of the planned kernel, a pixel: cpu and wall, each with median, low, high (the
        distribution-free 95 % interval), least, most; a, b: median s a picture; pictures in a sample; pairs
"""

from __future__ import annotations

import dataclasses
import html
import statistics
from pathlib import Path
from typing import Any

from whitted_validation import report
from whitted_validation.benchmark.speed import Measured, Results, Row, Schedule
from whitted_validation.benchmark.speed_configurations import BY_NAME, FAMILIES
from whitted_validation.benchmark.speed_targets import Outcome, outcomes, said
from whitted_validation.report import Bars, Cell, Group, Markup, Section, Sentence, Table
from whitted_validation.report.sections import Tone

SLOWEST_BAR = 20.0
"""Bars end here: what is slower would flatten all others."""


def write(folder: Path, results: Results, schedule: Schedule, quick: bool) -> None:
    """Write results.json and report.html."""
    facts = {
        "quick": quick,
        "complete": results.complete,
        "schedule": {"size": schedule.size, "pairs": schedule.pairs, "tick": schedule.tick},
        "targets": [
            {"target": each.target, "measured": each.measured, "verdict": each.verdict} for each in outcomes(results)
        ],
        "scenes": {kind: _scene_facts(measured) for kind, measured in results.scenes.items()},
        "random": {seed: _row_facts(row) for seed, row in results.random.items()},
        "sizes": {size: plain(facts) for size, facts in results.sizes.items()},
        "starts": {cache: plain(begun) for cache, begun in results.starts.items()},
        "large": plain(results.large),
        "load": results.load,
        "notes": results.notes,
    }
    report.write(folder, facts, "whitted benchmark speed", sections(results, schedule, quick))


def plain(x: Any) -> Any:
    """Turn dataclasses and named tuples into dictionaries, all the way down."""
    if dataclasses.is_dataclass(x) and not isinstance(x, type):
        return {f.name: plain(getattr(x, f.name)) for f in dataclasses.fields(x)}
    if isinstance(x, tuple) and hasattr(x, "_asdict"):
        return x._asdict()
    return [plain(each) for each in x] if isinstance(x, (list, tuple)) else x


def _scene_facts(measured: Measured) -> dict[str, Any]:
    facts: dict[str, Any] = plain(measured)
    return facts | {"rows": [_row_facts(row) for row in measured.rows], "rays_per_second": rays_per_second(measured)}


def _row_facts(row: Row) -> dict[str, Any]:
    configuration = BY_NAME[row.name]
    facts: dict[str, Any] = plain(row)
    return facts | {"family": configuration.family, "words": configuration.words}


def rays_per_second(measured: Measured) -> dict[str, float]:
    """Millions of rays of all kinds in a second of wall and of CPU time, by the median over all pairs."""
    compared = [row.comparison for row in measured.rows if row.comparison]
    rays = sum(measured.rays.values()) / 1e6
    if not compared:
        return {}
    return {clock: rays / statistics.median(getattr(c.a, clock) for c in compared) for clock in ("wall", "cpu")}


def summary(results: Results) -> str:
    """Say in one sentence what came out."""
    verdicts = [outcome.met for outcome in outcomes(results)]
    measured = [met for met in verdicts if met is not None]
    missing = len(verdicts) - len(measured)
    said_missing = f"; {missing} are not measured" if missing else ""
    interrupted = "" if results.complete else "; not all is measured yet"
    return f"{sum(measured)} of {len(measured)} targets met{said_missing}{interrupted}."


def line(row: Row) -> str:
    """Return a line of the table on the terminal."""
    name = f"  {row.name:<14}"
    if row.comparison is None:
        return f"{name}{row.note}"
    return f"{name}CPU {said(row.comparison.cpu):<26} wall {said(row.comparison.wall)}"


def sections(results: Results, schedule: Schedule, quick: bool) -> list[Section]:
    """Build the page."""
    held = list(outcomes(results))
    parts: list[Section] = [
        Sentence(summary(results), "bad" if any(each.met is False for each in held) else "good"),
        Sentence(
            "All ratios are times over that of the plugin as it is, a pixel: above 1 is slower. Two processes draw in "
            f"turn, {schedule.pairs} pairs; a ratio is the median of the pairs, and behind it stands the interval "
            "that holds the median with a confidence of 95 %, whatever the distribution. CPU time is that of all "
            "threads, and the steadier of the two where other work shares the machine: its load was "
            f"{min(results.load, default=0):.1f} to {max(results.load, default=0):.1f} meanwhile."
        ),
        targets_table(held, quick),
    ]
    for kind, measured in results.scenes.items():
        parts.append(_scene(kind, measured))
    if results.random:
        parts.append(_random(results))
    rows: list[list[str | float | Cell]]
    if results.sizes:
        rows = [
            [f"{f.side} x {f.side}", f.loaded_mb, f.first_mb, f.peak_mb, f.side**2 / f.one.wall / 1e6]
            for f in results.sizes.values()
        ]
        columns = ["picture", "MB before", "after one picture", "after several", "million pixels/s, one picture"]
        parts.append(Group("Memory", [Table(columns, rows)]))
    if results.starts:
        rows = [[begun.cache, said(begun.wall), said(begun.cpu), len(begun.ours)] for begun in results.starts.values()]
        note = "`whitted render` of 256 x 256 pixels over a script that loads the scene and draws it with `path`."
        parts.append(Group("Start", [Table(["cache of kernels", "wall time", "CPU time", "pairs"], rows)], note))
    if results.notes:
        parts.append(Group("Not measured", [Sentence(note) for note in results.notes]))
    return parts


def targets_table(held: list[Outcome], quick: bool) -> Group:
    """Show what is to be reached, and what was."""
    note = "Small pictures and few pairs: a look, not a measurement." if quick else ""
    tones: dict[bool | None, Tone] = {True: "good", False: "bad", None: "quiet"}
    rows: list[list[str | float | Cell]]
    rows = [[each.target.replace("`", ""), each.measured, Cell(each.verdict, tones[each.met])] for each in held]
    return Group("Targets", [Table(["target", "measured", "verdict"], rows)], note)


def _scene(kind: str, measured: Measured) -> Group:
    parts: list[Section] = []
    speed = rays_per_second(measured)
    rays = ", ".join(f"{number:,} {name}" for name, number in measured.rays.items())
    note = f"{measured.size} x {measured.size} pixels; rays: {rays}"
    if speed:
        note += f"; {speed['wall']:.1f} million a second, {speed['cpu']:.1f} a second of CPU time"
    compared = {row.name: row.comparison for row in measured.rows if row.comparison}
    rivals = {name for name in compared if BY_NAME[name].family in ("plugin", "peer")}
    shown = {name: c for name, c in compared.items() if name in rivals and c.cpu.median < SLOWEST_BAR}
    if shown:
        labels, heights = ["planned", *shown], [1.0, *(c.cpu.median for c in shown.values())]
        parts.append(Bars("CPU time, the plugin as it is = 1", "", "ratio", labels, {"CPU time": heights}))
    for family, words in FAMILIES.items():
        rows = [_cells(row) for row in measured.rows if BY_NAME[row.name].family == family]
        if family == "plugin" and measured.facts is not None:
            f = measured.facts
            rows.insert(0, ["planned", BY_NAME["planned"].words, "1", "1", f.operations, len(f.kernels), f.peak_mb, ""])
        if rows:
            columns = ["", "what", "CPU time", "wall time", "operations", "kernels", "MB", "pixels off"]
            parts.append(Table(columns, rows, words))
    if measured.plan:
        parts.append(Markup(f"<pre>{html.escape(measured.plan)}</pre>"))
    if measured.povray:
        p = measured.povray
        parts.append(
            Sentence(
                f"POV-Ray {p.version} draws the same picture with {p.rays:,} rays from camera and mirrors and "
                f"{p.shadow_rays:,} towards lights, after {p.parse:.2f} s to read the scene, which are not counted."
            )
        )
    if measured.note:
        parts.append(Sentence(measured.note, "bad"))
    return Group(f"Scene {kind}: {measured.title}", parts, note)


def _cells(row: Row) -> list[str | float | Cell]:
    compared, facts = row.comparison, row.facts
    cpu, wall = (said(compared.cpu), said(compared.wall)) if compared else (Cell(row.note, "quiet"), "")
    kernel = [facts.operations, len(facts.kernels), facts.peak_mb] if facts else ["", "", ""]
    off = "" if row.off is None else f"{100 * row.off:.3g} %"
    return [row.name, BY_NAME[row.name].words.replace("`", ""), cpu, wall, *kernel, off]


def _random(results: Results) -> Group:
    rows = [[f"seed {seed}", *_cells(row)[2:]] for seed, row in results.random.items()]
    columns = ["scene", "CPU time", "wall time", "operations", "kernels", "MB", "pixels off"]
    return Group("Random scenes", [Table(columns, rows)], "The general kernel over the planned one.")
