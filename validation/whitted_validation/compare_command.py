"""The command `whitted compare`."""

from __future__ import annotations

from pathlib import Path

import click


def _limit(_ctx: click.Context, _param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not value >= 0:
        raise click.BadParameter(f"{value:g}; it must be 0 or more")
    return value


@click.command()
@click.argument("a")
@click.argument("b")
@click.option("--max-error", type=float, callback=_limit, metavar="E", help="End with 1 if any pixel is further off.")
@click.option("--max-rmse", type=float, callback=_limit, metavar="E", help="End with 1 if the RMSE is larger.")
@click.option("--layer", metavar="NAME", help="Layer of .exr files, where several have colours.")
@click.option("--report", metavar="DIR", help="Write results.json and report.html to this folder.")
def compare(
    a: str, b: str, max_error: float | None, max_rmse: float | None, layer: str | None, report: str | None
) -> int:
    """Compare two pictures from anywhere: EXR, PNG or NPY, of one size.

    The error of a pixel is |A - B| in its worst channel, linear. B is the reference where that matters (FLIP).
    Ends with 0, with 1 if a limit is exceeded, with 2 if the pictures cannot be compared.
    """
    from whitted_validation.comparison import compare as compared

    comparison = compared(Path(a), Path(b), layer=layer)
    for remark in comparison.remarks:
        click.echo(f"whitted: {remark}", err=True)
    click.echo(str(comparison))
    exceeded = comparison.exceeded(max_error, max_rmse)
    if report is not None:
        from whitted_validation.compare_report import write_comparison

        write_comparison(Path(report), comparison, max_error, max_rmse)
    for line in exceeded:
        click.echo(f"whitted: {line}", err=True)
    return 1 if exceeded else 0
