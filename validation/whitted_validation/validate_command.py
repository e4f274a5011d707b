"""The command `whitted validate`."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from whitted_validation import scene_files
from whitted_validation.refusal import Refusal
from whitted_validation.request import Request

ALL_SIZE = (128, 128)  # of --all: at this size all shipped scenes take a few minutes, traced for the first time


def _size(_ctx: click.Context, _param: click.Parameter, value: str | None) -> tuple[int, int] | None:
    if value is None:
        return None
    match = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", value)
    if not match:
        raise click.BadParameter(f"{value}; it must read WxH, such as 128x128")
    return int(match[1]), int(match[2])


def add_to(group: click.Group, defines: Callable[..., Any], folders: Callable[..., Any]) -> None:
    """Add the command to a group; `defines` and `folders` read the values of -D and -a."""

    @group.command()
    @click.argument("scenes", nargs=-1, metavar="SCENE...")
    @click.option("--all", "every", is_flag=True, help="Judge all shipped scenes, at 128x128 unless --size is given.")
    @click.option("--size", callback=_size, metavar="WxH", help="Size in pixels. [default: the scene's]")
    @click.option("--against", metavar="PICTURE", help="Judge this .exr or .npy instead of the plugin's picture.")
    @click.option("--report", metavar="DIR", help="Write results.json and report.html to this folder.")
    @click.option("-m", "--mode", "variant", metavar="VARIANT", help="Mitsuba variant, such as llvm_ad_rgb.")
    @click.option("-D", "--define", "defines", multiple=True, callback=defines, metavar="KEY=VALUE", help="Set $KEY.")
    @click.option(
        "-a", "--append", "folders", multiple=True, callback=folders, metavar="DIR[;DIR]", help="Allow files from here."
    )
    @click.option("-s", "--sensor", default=0, metavar="INDEX", help="Sensor to judge, counted from 0.")
    @click.option(
        "--grid", type=click.IntRange(1, 64), default=1, metavar="N", help="N x N samples a pixel. [default: 1]"
    )
    def validate(
        scenes: tuple[str, ...],
        every: bool,
        size: tuple[int, int] | None,
        against: str | None,
        report: str | None,
        variant: str | None,
        defines: dict[str, str],
        folders: list[Path],
        sensor: int,
        grid: int,
    ) -> int:
        """Judge the plugin's picture of each SCENE, pixel by pixel, against the reference tracer.

        Ends with 0 if every pixel is equal or explained, with 1 if not, with 2 if a scene cannot be judged.
        """
        if every == bool(scenes):
            raise Refusal("validate: name scenes, or give --all")
        if against is not None and len(scenes) != 1:
            raise Refusal("--against: one picture needs one scene")
        if every:
            scenes = tuple(str(file) for file in scene_files.shipped())
            size = size or ALL_SIZE
        options: dict[str, Any] = {"size": size, "grid": grid, "sensor": sensor, "variant": variant}
        options |= {"defines": defines, "folders": folders, "against": against and Path(against)}
        return _judge(scenes, options, report and Path(report))

    del validate


def _judge(scenes: tuple[str, ...], options: dict[str, Any], folder: Path | str | None) -> int:
    from whitted_validation.explanation.report import explained
    from whitted_validation.report.verdicts import Judged, exit_code, write_verdicts
    from whitted_validation.seen import look
    from whitted_validation.validation import Verdict, cache_folder, processes, validate

    verdicts: list[Verdict] = []
    pages: list[Judged] = []
    refused: list[tuple[str, str]] = []

    def save(complete: bool) -> None:
        if folder:
            write_verdicts(Path(folder), pages, refused, complete)

    save(complete=False)  # before any work: the folder can be written to
    with processes() as workers:
        for scene in scenes:
            try:
                with _progress(Path(scene).stem) as progress:
                    verdict = validate(scene, executor=workers, cache=cache_folder(), progress=progress, **options)
            except Refusal as refusal:
                refused.append((scene, str(refusal)))
                click.echo(f"whitted: {refusal}", err=True)
            else:
                verdicts.append(verdict)
                if folder:
                    request = Request(scene, verdict.variant, options["defines"], options["folders"], None, 0)
                    rays = explained(verdict, request, options["size"])
                    pages.append(Judged(verdict, look(verdict.description, workers, verdict.sensor), rays))
                click.echo(verdict.summary)
                for difference in verdict.judgement.differences[:5]:
                    reasons = f": {'; '.join(difference.reasons)}" if difference.reasons else ""
                    click.echo(
                        f"  ({difference.x}, {difference.y}) {difference.status.name.lower()}, "
                        f"error {difference.error:.1e}, bound {difference.bound:.1e}{reasons}"
                    )
            save(complete=False)
    save(complete=True)
    return exit_code(verdicts, refused)


@contextmanager
def _progress(name: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar on a terminal; elsewhere nobody is watching."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name)
        yield lambda done, rows: bar.update(task, completed=done, total=rows)
