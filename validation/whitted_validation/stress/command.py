"""The command `whitted stress`."""

from __future__ import annotations

from pathlib import Path

import click

from whitted_validation.progress import steps
from whitted_validation.refusal import Refusal


def add_to(group: click.Group) -> None:
    """Add the command to a group."""

    @group.command()
    @click.option("--quick", is_flag=True, help="A twentieth of the probes, and few whole pictures: about a minute.")
    @click.option("--report", metavar="DIR", help="Write results.json and report.html to this folder.")
    @click.option("-m", "--mode", "variant", metavar="VARIANT", help="Mitsuba variant, such as llvm_ad_rgb.")
    def stress(quick: bool, report: str | None, variant: str | None) -> int:
        """Try what breaks ray tracers, and compare ways for a ray to leave its own surface.

        Ends with 0 if every statement holds for the plugin as it is, with 1 if one does not.
        """
        return _stress(quick, None if report is None else Path(report), variant)

    del stress


def _stress(quick: bool, folder: Path | None, asked: str | None) -> int:
    from whitted_validation import variants

    variant, why = variants.choose(asked)
    if not variant.endswith("_ad_rgb"):
        raise Refusal(f"stress: {variant} is too slow for millions of probes; use llvm_ad_rgb or cuda_ad_rgb")

    import mitsuba as mi

    from whitted_validation.stress import page
    from whitted_validation.stress.run import Result, cases, run
    from whitted_validation.validation import cache_folder, processes

    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    if asked is None:
        click.echo(f"whitted: {why}", err=True)
    wanted = cases(quick)
    results: list[Result] = []

    def save(complete: bool) -> None:
        if folder is not None:
            page.write(folder, results, len(wanted), quick, complete)

    save(complete=False)  # before any work: the folder can be written to
    with processes() as workers, steps("stress", len(wanted)) as (told, done):
        click.echo(page.heading())
        for result in run(wanted, quick, workers, cache_folder(), told=told):
            if not results or results[-1].case.family != result.case.family:
                click.echo(result.case.family)
            click.echo(page.row(result))
            results.append(result)
            done()
            save(complete=len(results) == len(wanted))
    click.echo(page.summary(results, len(wanted)))
    for result in results:
        if not result.holds:
            click.echo(f"does not hold: {result.case.family}, {result.case.name}: {result.case.statement}")
    return 0 if all(result.holds for result in results) else 1
