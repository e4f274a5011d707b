"""From scene files to verdicts: draw with the plugin, trace with the reference, judge."""

from __future__ import annotations

import html
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import whitted_reference
from whitted_reference.image import resized
from whitted_validation.bounds import measure
from whitted_validation.picture_reading import read_picture
from whitted_validation.refusal import Refusal, no_such_sensor
from whitted_validation.request import Request
from whitted_validation.verdict import Judgement, Status, judge

# Up to so many samples starting processes takes longer than tracing here, at about a millisecond each.
WORTH_PROCESSES = 2_000

Progress = Callable[[int, int], None]  # rows done, rows in all


@dataclass
class Verdict:
    """What `validate` found out about one scene.

    Attributes
    ----------
    scene : the scene file
    variant : Mitsuba's variant that drew the picture, or empty if it was given
    against : the file of the picture if it was given, or empty
    grid : samples per pixel are grid x grid
    judgement : pictures, bounds, status and differences
    seconds : what it took
    description, sensor : what was traced, as the reference reads it, and from which of its sensors
    """

    scene: Path
    variant: str
    against: str
    grid: int
    judgement: Judgement
    seconds: float
    description: whitted_reference.Scene
    sensor: int

    @property
    def good(self) -> bool:
        """Tell whether every pixel is equal or explained."""
        return self.judgement.good

    @property
    def summary(self) -> str:
        """One line."""
        judgement = self.judgement
        height, width = judgement.status.shape
        counts = ", ".join(f"{judgement.count(status)} {status.name.lower()}" for status in reversed(Status))
        return f"{self.scene.stem}: {counts} of {width} x {height} pixels"

    def __str__(self) -> str:
        return self.summary

    def _repr_html_(self) -> str:
        from whitted_validation.report.verdicts import pictures

        return f"<p>{html.escape(self.summary)}</p>{pictures(self)}"


class Here(Executor):
    """An executor that does everything at once, in this process."""

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def]  # as in Executor
        """Do it."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # whoever asks for the result gets it, as from a process
            future.set_exception(error)
        return future


@contextmanager
def processes() -> Iterator[Executor]:
    """Offer new local processes; those that wait are dropped when the work is interrupted."""
    # Ctrl-C reaches workers too; what to do about it is decided here.
    executor = ProcessPoolExecutor(
        mp_context=multiprocessing.get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


def cache_folder() -> Path:
    """Return where traced pictures are kept, by the XDG base directory specification."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "mitsuba-whitted"


def validate(
    scene_file: str | Path,
    *,
    size: tuple[int, int] | None = None,
    grid: int = 1,
    sensor: int = 0,
    variant: str | None = None,
    defines: Mapping[str, str] | None = None,
    folders: Sequence[Path] = (),
    against: Path | None = None,
    executor: Executor | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Verdict:
    """Judge the plugin's picture of a scene, or any other picture of it, against the reference tracer.

    Parameters
    ----------
    scene_file : a file, or the bare name of a shipped scene
    size : (width, height) in pixels instead of the film's; any crop is dropped
    grid : samples per pixel are grid x grid
    sensor : which of the scene's sensors
    variant : of Mitsuba; None for the best that works here
    defines, folders : values for `$name`, and where else the scene's files may lie
    against : a picture (.exr or .npy, linear RGB) to judge instead of the plugin's
    executor : where rows are traced; by default new local processes, or right here if that is quicker.
        (New processes are spawned: a script keeps its own code under `if __name__ == ...`.)
    cache : a folder where traced pictures are kept
    progress : called with (rows done, rows in all)

    Raises
    ------
    Refusal
        If the scene is bad, or holds what the reference does not define.
    """
    start = time.perf_counter()
    request = Request(str(scene_file), variant, dict(defines or {}), list(folders), None, 0)
    file = request.seen.file
    try:
        grey = (variant or "").endswith("_mono")
        scene = whitted_reference.load(file, request.defines, request.folders, grey)
        if not 0 <= sensor < len(scene.sensors):
            raise no_such_sensor(file, len(scene.sensors), sensor)
        if size is not None:
            scene = resized(scene, *size)
        if against is None:
            picture, drawn_by = _drawn(request, size, grid, sensor)
        else:
            picture, drawn_by = _given_picture(against), ""
        film = scene.sensors[sensor].film
        if picture.shape != (film.crop_height, film.crop_width, 3):
            raise Refusal(
                f"{against or file}: has shape {picture.shape}; {film.crop_height, film.crop_width, 3} needed"
            )
        if executor is None and film.crop_width * film.crop_height * grid * grid <= WORTH_PROCESSES:
            executor = Here()
        with processes() if executor is None else _given(executor) as workers:
            bounds = measure(scene, workers, grid, sensor, progress, cache)
            judgement = judge(scene, bounds, picture, workers, grid, sensor)
    except whitted_reference.SceneError as error:
        raise Refusal(str(error)) from None
    seconds = time.perf_counter() - start
    return Verdict(file, drawn_by, "" if against is None else str(against), grid, judgement, seconds, scene, sensor)


@contextmanager
def _given(executor: Executor) -> Iterator[Executor]:
    yield executor


def _drawn(request: Request, size: tuple[int, int] | None, grid: int, sensor: int) -> tuple[NDArray[np.float64], str]:
    """Draw with the plugin; return the picture and the variant."""
    loaded = request.load(sensor)

    import mitsuba as mi

    from whitted_validation import render

    variant = str(mi.variant())
    if not variant.endswith(("_rgb", "_mono")):
        raise Refusal(f"-m {variant}: pictures are judged in rgb and mono variants")
    if size is not None:
        render.resize(loaded, size)
    picture = render.render(loaded, grid).astype(np.float64)
    return np.repeat(picture, 3 // picture.shape[2], axis=2), variant  # of grey, three equal channels


def _given_picture(path: Path) -> NDArray[np.float64]:
    """Read a picture that can be judged: no steps of 8 or 16 bits, which are far coarser than any bound."""
    picture = read_picture(path)
    if picture.stepped:
        raise Refusal(f"{picture.name}: a picture to be judged is .exr or .npy: linear, and not in steps")
    return picture.values.astype(np.float64)
