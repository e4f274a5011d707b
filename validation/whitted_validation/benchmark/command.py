"""The commands `whitted benchmark ...`."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click


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
    """Compare times: the plugin, the bare rays, each part switched off, and Mitsuba's own integrators.

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

    def save() -> None:
        if report is not None:
            speed_page.write(Path(report), results, schedule, quick)

    save()  # before any work: the folder can be written to
    with tempfile.TemporaryDirectory(prefix="whitted_speed_") as folder, _progress(schedule.count()) as (told, done):
        shown: dict[str, int] = {}
        last = ""
        for _ in run(schedule, Path(folder), results, told):
            done()
            for kind, measured in results.scenes.items():
                for row in measured.rows[shown.get(kind, 0) :]:
                    if kind != last:
                        click.echo(f"scene {kind}: {measured.title}; times over those of the plugin as it is")
                    click.echo(speed_page.lines(row))
                    shown[kind], last = len(measured.rows), kind
            save()
        save()
    if quick:
        click.echo("A quick look at small pictures; the targets are those of the full measurement:")
    for outcome in outcomes(results):
        found = f": {outcome.measured}" if outcome.measured else ""
        click.echo(f"{outcome.verdict:<13} {outcome.target.replace('`', '')}{found}")
    for note in results.notes:
        click.echo(note)
    click.echo(speed_page.summary(results))


@benchmark.command()
@click.option("--quick", is_flag=True, help="Small pictures and few points: a look of a minute, not a measurement.")
@click.option("--report", metavar="DIR", help="Write results.json and report.html to this folder.")
def error(quick: bool, report: str | None) -> None:
    """Measure error against cost: grids, pictures to a target error, and Mitsuba's own integrators.

    Takes some fifteen minutes on two processors, and longer on a busy machine. What is measured is kept when the
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

    def save() -> None:
        if report is not None:
            error_page.write(Path(report), results, schedule, quick)

    save()  # before any work: the folder can be written to
    with tempfile.TemporaryDirectory(prefix="whitted_error_") as folder, _progress(schedule.count()) as (told, done):
        shown = 0
        for _ in run(schedule, Path(folder), results, told):
            done()
            lines = list(error_page.lines(results))
            for line in lines[shown:]:
                click.echo(line)
            shown = len(lines)
            save()
        save()
    if quick:
        click.echo("A quick look at small pictures; most targets are those of the full measurement:")
    for outcome in outcomes(results):
        found = f": {outcome.measured}" if outcome.measured else ""
        click.echo(f"{outcome.verdict:<13} {outcome.target.replace('`', '')}{found}")
    for note in results.notes:
        click.echo(note)
    click.echo(error_page.summary(results))


@contextmanager
def _progress(count: int) -> Iterator[tuple[Callable[[str], Any], Callable[[], Any]]]:
    """Show a bar on a terminal; elsewhere nobody is watching."""
    if not sys.stderr.isatty():
        yield lambda _: None, lambda: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("benchmark", total=count)
        yield lambda what: bar.update(task, description=what), lambda: bar.advance(task)
