"""The command line `whitted`.

Mitsuba, numpy and the like are imported only by the commands that need them, after everything that can be
found wrong without them: `--help` and `scenes` answer at once, and so does a broken scene.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from whitted_validation import compare_command, picture_files, scene_files, validate_command
from whitted_validation.benchmark import command as benchmark_command
from whitted_validation.printable import printable
from whitted_validation.progress import shown
from whitted_validation.refusal import Refusal, one_line
from whitted_validation.request import Request
from whitted_validation.stress import command as stress_command

TERMS = ("ambient", "diffuse", "specular")


def _terms(_ctx: click.Context, _param: click.Parameter, value: str | None) -> set[str] | None:
    if value is None:
        return None
    terms = {term.strip() for term in value.split(",")}
    if not terms <= set(TERMS):
        raise click.BadParameter(f"{value}; allowed are {', '.join(TERMS)}, separated by commas")
    return terms


def _defines(_ctx: click.Context, _param: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    defines = {}
    for value in values:
        key, equals, text = value.partition("=")
        if not (key and equals):
            raise click.BadParameter(f"{value}; it must read key=value")
        defines[key] = text
    return defines


def _folders(_ctx: click.Context, _param: click.Parameter, values: tuple[str, ...]) -> list[Path]:
    folders = [Path(folder) for value in values for folder in value.split(";") if folder]
    for folder in folders:
        if not folder.is_dir():
            raise click.BadParameter(f"{folder}; it must be a folder")
    return folders


def about_scene(command: Callable[..., None]) -> Callable[..., None]:
    """Add the argument SCENE and the options of the `mitsuba` program that say how to read it.

    The command receives all of them as one `Request`.
    """

    @click.argument("scene")
    @click.option("-m", "--mode", "variant", metavar="VARIANT", help="Mitsuba variant, such as llvm_ad_rgb.")
    @click.option("-D", "--define", "defines", multiple=True, callback=_defines, metavar="KEY=VALUE", help="Set $KEY.")
    @click.option(
        "-a",
        "--append",
        "folders",
        multiple=True,
        callback=_folders,
        metavar="DIR[;DIR]",
        help="Let the scene use files in this folder too.",
    )
    @click.option("-t", "--threads", type=click.IntRange(min=1), help="Number of threads.")
    @click.option("-v", "--verbose", "verbosity", count=True, help="Say more; give it again for still more.")
    @functools.wraps(command)
    def gathered(
        scene: str,
        variant: str | None,
        defines: dict[str, str],
        folders: list[Path],
        threads: int | None,
        verbosity: int,
        **others: Any,
    ) -> None:
        command(Request(scene, variant, defines, folders, threads, verbosity), **others)

    return gathered


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="mitsuba-whitted")
def whitted() -> None:
    """Whitted's classic ray tracer inside Mitsuba 3.

    SCENE is a Mitsuba XML file, or the bare name of a scene that `whitted scenes` lists.
    """


@whitted.command()
@about_scene
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    help="Picture, by its ending .exr, .png or .npy. [default: SCENE with .exr]",
)
@click.option("-s", "--sensor", default=0, metavar="INDEX", help="Sensor to draw, counted from 0.")
@click.option(
    "--grid",
    type=click.IntRange(1, 64),
    metavar="N",
    help="N x N samples a pixel. [default: the scene's sample_count]",
)
@click.option(
    "--target-error",
    type=click.FloatRange(0, min_open=True),
    metavar="E",
    help="Refine pixels until the root mean square error is likely to be below E.",
)
@click.option("--exposure", type=float, metavar="EV", help="Brighten a .png by EV stops.")
@click.option("--only", callback=_terms, metavar="TERMS", help="Keep only these of ambient,diffuse,specular.")
@click.option("--no-shadows", is_flag=True, help="Let every light reach every surface.")
@click.option("--no-mirrors", is_flag=True, help="Follow no mirror rays.")
@click.option("--reference", is_flag=True, help="Draw with the plain-Python reference tracer, without Mitsuba.")
@click.option("--stats", is_flag=True, help="Print how many rays were traced and how long it took.")
def render(
    request: Request,
    output: str | None,
    sensor: int,
    grid: int | None,
    target_error: float | None,
    exposure: float | None,
    only: set[str] | None,
    no_shadows: bool,
    no_mirrors: bool,
    reference: bool,
    stats: bool,
) -> None:
    """Draw SCENE and write the picture."""
    start = time.perf_counter()
    if reference and (request.variant or request.threads or request.verbosity or stats):
        raise Refusal("--reference draws without Mitsuba and takes none of -m, -t, -v and --stats")
    if target_error is not None and (grid or reference):
        raise Refusal("--target-error chooses the samples itself and takes neither --grid nor --reference")
    if target_error is not None and not target_error < math.inf:  # click's range lets NaN through
        raise Refusal(f"--target-error {target_error:g}: allowed is any finite number above 0")
    scene_file = request.seen.file  # what is wrong with the scene comes before what is wrong with the output
    picture_file = Path(output or Path(request.scene).with_suffix(".exr"))
    picture_files.check_writable(picture_file, exposure)
    off = {term for term in TERMS if only is not None and term not in only}
    off |= {"shadows"} if no_shadows else set()
    off |= {"mirrors"} if no_mirrors else set()
    switches: dict[str, Any] = {f"enable_{part}": False for part in off}
    if reference:
        _render_reference(scene_file, request, sensor, grid, switches, picture_file, exposure or 0.0)
        return
    if target_error or grid:
        switches["target_error"] = target_error or 0.0
    loaded = request.load(sensor)

    from whitted_validation import render as drawing

    drawing.switch(loaded, switches)
    with shown(printable(picture_file.name)) as progress, drawing.Stopwatch() as kernels:
        if picture_file.suffix.lower() == ".npy" and not loaded.integrator.settings.target_error:
            # It grows on disk, however large it gets.
            height = int(loaded.sensor.film().crop_size()[1])
            picture_files.write_bands(picture_file, height, drawing.bands(loaded, grid, progress))
        else:
            picture_files.write(picture_file, drawing.render(loaded, grid, progress), exposure or 0.0)
    if stats:
        total = time.perf_counter() - start
        for line in drawing.statistics(loaded, grid, kernels, total):
            click.echo(line)


@whitted.command()
@about_scene
def plan(request: Request) -> None:
    """Print what SCENE needs, and so what the kernel holds and leaves out."""
    loaded = request.load()
    click.echo(str(loaded.integrator.plan(loaded.scene)))


@whitted.command()
@about_scene
@click.argument("x", type=int)
@click.argument("y", type=int)
@click.option("-s", "--sensor", default=0, metavar="INDEX", help="Sensor that sees the pixel, counted from 0.")
@click.option("--grid", type=click.IntRange(1, 64), default=1, metavar="N", help="N x N samples. [default: 1]")
@click.option("--size", callback=validate_command.size, metavar="WxH", help=validate_command.SIZE_HELP)
@click.option("--report", metavar="DIR", help="Write results.json and report.html, with drawings, to this folder.")
def explain(
    request: Request, x: int, y: int, sensor: int, grid: int, size: tuple[int, int] | None, report: str | None
) -> None:
    """Say why pixel X Y of SCENE has its colour: its ray tree, by the plugin and by the reference tracer.

    X counts to the right and Y down, both from 0.
    """
    from whitted_validation.explanation import terminal
    from whitted_validation.explanation.explanation import Explainer

    explanation = Explainer(request, sensor, grid, size).pixel(x, y)
    if report is not None:
        from whitted_validation.explanation.report import write_explanation

        write_explanation(Path(report), explanation)
    terminal.show(explanation)


@whitted.command()
@click.option("--copy", metavar="DIR", help="Copy them to a new folder, to be edited there.")
def scenes(copy: str | None) -> None:
    """List the shipped scenes, or copy them out."""
    if copy is not None:
        for file in scene_files.copy_to(Path(copy)):
            click.echo(file)
        return
    files = scene_files.shipped()
    width = max((len(file.stem) for file in files), default=0)
    for file in files:
        click.echo(f"{file.stem:<{width}}  {scene_files.purpose(file)}")


@whitted.command()
def doctor() -> None:
    """Print versions, the libLLVM chosen and why, and which variants work here."""
    from whitted_validation import doctor as examination

    for line in examination.report():
        click.echo(line)


validate_command.add_to(whitted, _defines, _folders)
stress_command.add_to(whitted)
benchmark_command.add_to(whitted)
whitted.add_command(compare_command.compare)


def _render_reference(
    scene_file: Path,
    request: Request,
    sensor: int,
    grid: int | None,
    switches: dict[str, Any],
    picture_file: Path,
    exposure: float,
) -> None:
    """Draw with the tracer that needs nothing but Python."""
    import whitted_reference as tracer

    try:
        scene = tracer.load(scene_file, request.defines, request.folders)
        scene = dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, **switches))
        if grid is None and sensor in range(len(scene.sensors)):
            grid = math.isqrt(scene.sensors[sensor].sample_count - 1) + 1
        with shown(printable(picture_file.name)) as progress:
            picture = tracer.render(scene, grid=grid or 1, sensor=sensor, progress=progress)
    except tracer.SceneError as error:
        raise Refusal(str(error)) from None
    for remark in scene.messages:
        click.echo(f"whitted: {remark}", err=True)
    tracer.save(picture, picture_file, exposure)


def main() -> None:
    """Run the command line: 0 done, 2 misuse or something refused, 130 interrupted."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run one command; whatever is refused becomes one line on stderr."""
    code = 2
    try:
        return int(whitted.main(arguments, prog_name="whitted", standalone_mode=False) or 0)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return 2
    except click.ClickException as error:
        message = error.format_message()
    except Refusal as error:
        message = str(error)
    except (click.Abort, KeyboardInterrupt):
        message, code = "interrupted", 130
    except RuntimeError as error:
        if not _interrupted(error):
            raise
        message, code = "interrupted", 130
    except BrokenPipeError:  # the reader of our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    click.echo(f"whitted: {one_line(message)}", err=True)
    return code


def _interrupted(error: BaseException | None) -> bool:
    """Look for Ctrl-C among the causes: Dr.Jit wraps what is raised while it records a kernel."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None
