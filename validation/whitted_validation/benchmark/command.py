"""The commands `whitted benchmark ...`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from whitted_validation.progress import steps

if TYPE_CHECKING:
    from whitted_validation.benchmark.speed_targets import Outcome


def add_to(group: click.Group) -> None:
    """Add the commands to a group."""
    group.add_command(benchmark)


@click.group()
def benchmark() -> None:
    """Measure the plugin against itself and its peers."""


@benchmark.command()
@click.option("--quick", is_flag=True, help="One small scene: a look of a minute, not a measurement.")
@click.option("--report", metavar="DIR", help="Write results.json and report.html to this folder.")
def speed(quick: bool, report: str | None) -> None:
    """Compare times: the plugin, the bare rays, each part switched off, Mitsuba's own integrators, and POV-Ray.

    Takes some twenty minutes on two processors, and longer on a busy machine. What is measured is kept when the
    command is interrupted.
    """
    from whitted_validation import variants

    variants.choose("llvm_ad_rgb")  # or one line that says what is missing

    from whitted_validation.benchmark import speed_page
    from whitted_validation.benchmark.speed import FULL, QUICK, Results, run
    from whitted_validation.benchmark.speed_targets import outcomes

    schedule = QUICK if quick else FULL
    results = Results()

    shown: dict[str, int] = {}
    last = ""

    def fresh() -> Iterator[str]:
        nonlocal last
        for kind, measured in results.scenes.items():
            for row in measured.rows[shown.get(kind, 0) :]:
                if kind != last:
                    yield f"scene {kind}: {measured.title}; times over those of the plugin as it is"
                yield speed_page.line(row)
                shown[kind], last = len(measured.rows), kind

    def save() -> None:
        if report is not None:
            speed_page.write(Path(report), results, schedule, quick)

    _follow(schedule.count(), lambda folder, told: run(schedule, folder, results, told), fresh, save)
    if quick:
        click.echo("A quick look at small pictures; the targets are those of the full measurement:")
    _say(outcomes(results), results.notes, speed_page.summary(results))


@benchmark.command()
@click.option("--quick", is_flag=True, help="Small pictures and few points: a look of a minute, not a measurement.")
@click.option("--report", metavar="DIR", help="Write results.json and report.html to this folder.")
def error(quick: bool, report: str | None) -> None:
    """Measure error against cost: grids, pictures to a target error, Mitsuba's own integrators, and POV-Ray.

    Takes an hour on two processors, and longer on a busy machine. What is measured is kept when the
    command is interrupted.
    """
    from whitted_validation import variants

    variants.choose("llvm_ad_rgb")  # or one line that says what is missing

    import mitsuba as mi

    from whitted_validation.benchmark import error_page
    from whitted_validation.benchmark.error import Results, run
    from whitted_validation.benchmark.error_schedule import FULL, QUICK
    from whitted_validation.benchmark.error_targets import outcomes

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    schedule = QUICK if quick else FULL
    results = Results()

    shown = 0

    def fresh() -> Iterator[str]:
        nonlocal shown
        lines = list(error_page.lines(results))
        yield from lines[shown:]
        shown = len(lines)

    def save() -> None:
        if report is not None:
            error_page.write(Path(report), results, schedule, quick)

    _follow(schedule.count(), lambda folder, told: run(schedule, folder, results, told), fresh, save)
    if quick:
        click.echo("A quick look at small pictures; most targets are those of the full measurement:")
    _say(outcomes(results), results.notes, error_page.summary(results))


def _follow(
    count: int,
    measure: Callable[[Path, Callable[[str], None]], Iterator[None]],
    fresh: Callable[[], Iterator[str]],
    save: Callable[[], None],
) -> None:
    """Measure step by step, `count` of them; after each print what is new and keep what is known."""
    save()  # before any work: the folder can be written to
    with (
        tempfile.TemporaryDirectory(prefix="whitted_benchmark_") as folder,
        steps("benchmark", count) as (told, done),
    ):
        for _ in measure(Path(folder), told):
            done()
            for line in fresh():
                click.echo(line)
            save()
        save()


def _say(held: Iterable[Outcome], notes: list[str], summary: str) -> None:
    """Print the targets, each with its verdict, the notes and the summary."""
    for outcome in held:
        found = f": {outcome.measured}" if outcome.measured else ""
        click.echo(f"{outcome.verdict:<13} {outcome.target.replace('`', '')}{found}")
    for note in notes:
        click.echo(note)
    click.echo(summary)
