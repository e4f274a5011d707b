"""A whole picture: rows of pixels, spread over workers, kept once they are drawn."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import pickle
import platform
import sys
from array import array
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from whitted_reference.errors import SceneError
from whitted_reference.scene import Film, Scene
from whitted_reference.trace import Tracer

Progress = Callable[[int, int], None]  # rows done, rows in all

# Below this number of samples starting processes takes longer than drawing.
WORTH_PROCESSES = 20_000
# More mirror bounces than this are not followed: each is a level of Python's own recursion.
DEEPEST = 10_000


@dataclass
class Picture:
    """A picture in linear RGB.

    Attributes
    ----------
    rows : one list per row from the top, 3 * width floats each
    ties : (x, y) of pixels where two candidates at the same distance differ, and their ids; the written
        picture leaves the colour of such a pixel open
    """

    width: int
    height: int
    rows: list[list[float]]
    ties: dict[tuple[int, int], tuple[str, str]] = field(default_factory=dict)

    def pixel(self, x: int, y: int) -> tuple[float, float, float]:
        """Return the colour of one pixel."""
        red, green, blue = self.rows[y][3 * x : 3 * x + 3]
        return red, green, blue


def resized(scene: Scene, width: int, height: int) -> Scene:
    """Return the scene with full films of another size; the horizontal field of view stays."""
    film = Film(width, height, 0, 0, width, height)
    return replace(scene, sensors=tuple(replace(sensor, film=film) for sensor in scene.sensors))


def render(
    scene: Scene,
    grid: int = 1,
    sensor: int = 0,
    size: tuple[int, int] | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    cache: Path | None = None,
) -> Picture:
    """Draw a picture in double precision.

    Parameters
    ----------
    scene : what `load` returned
    grid : samples per pixel are grid x grid
    sensor : which of the scene's cameras
    size : (width, height) in pixels instead of the film's; any crop is dropped
    executor : where rows are drawn; by default in new local processes, or right here if that is quicker.
        (New processes are spawned: a script that draws keeps its own code under `if __name__ == ...`.)
    progress : called with (rows done, rows in all)
    cache : a folder where pictures are kept under a hash of everything that they depend on

    Returns
    -------
    Picture

    Raises
    ------
    SceneError
        If the sensor does not exist, or a mirror path has more than 10 000 bounces.
    """
    if not 0 <= sensor < len(scene.sensors):
        raise SceneError(f"{scene.name}: sensor {sensor} asked for; the scene has {len(scene.sensors)}")
    if grid < 1 or (size is not None and min(size) < 1):
        raise ValueError(f"grid {grid}, size {size}: each must be at least 1")
    if size is not None:
        scene = resized(scene, *size)
    packed = pickle.dumps(scene, protocol=4)
    kept = None if cache is None else cache / f"{_fingerprint(packed, grid, sensor)}.picture"
    if kept is not None and kept.is_file():
        return _read(kept)
    film = scene.sensors[sensor].film
    if executor is not None:
        picture = _draw(executor, packed, film, grid, sensor, progress)
    elif film.crop_width * film.crop_height * grid * grid < WORTH_PROCESSES:
        picture = Picture(film.crop_width, film.crop_height, [])
        for y in range(film.crop_height):
            _, rows, ties = draw_rows(packed, sensor, grid, y, y + 1)
            picture.rows += rows
            picture.ties.update(ties)
            if progress is not None:
                progress(y + 1, film.crop_height)
    else:
        with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as processes:
            picture = _draw(processes, packed, film, grid, sensor, progress)
    if kept is not None:
        _write(kept, picture)
    return picture


Block = tuple[int, list[list[float]], dict[tuple[int, int], tuple[str, str]]]


def _draw(executor: Executor, packed: bytes, film: Film, grid: int, sensor: int, progress: Progress | None) -> Picture:
    height = film.crop_height
    step = max(1, height // 64)  # enough blocks for any number of workers to end together
    waiting = [
        executor.submit(draw_rows, packed, sensor, grid, y, min(y + step, height)) for y in range(0, height, step)
    ]
    picture = Picture(film.crop_width, height, [[] for _ in range(height)])
    done = 0
    for block in as_completed(waiting):
        first, rows, ties = block.result()
        picture.rows[first : first + len(rows)] = rows
        picture.ties.update(ties)
        done += len(rows)
        if progress is not None:
            progress(done, height)
    return picture


def draw_rows(packed: bytes, sensor: int, grid: int, first: int, end: int) -> Block:
    """Draw rows first <= y < end of a pickled scene; this is what a worker does."""
    tracer = _tracer(packed, sensor)
    width = tracer.film.crop_width
    rows: list[list[float]] = []
    ties: dict[tuple[int, int], tuple[str, str]] = {}
    previous = sys.getrecursionlimit()
    sys.setrecursionlimit(max(previous, DEEPEST))
    try:
        for y in range(first, end):
            row: list[float] = []
            for x in range(width):
                row += tracer.pixel(x, y, grid)
                if tracer.ties:
                    ties[x, y] = tracer.ties[0]
                    tracer.ties.clear()
            rows.append(row)
    except RecursionError:
        raise SceneError(f"row {y}: a mirror path has about {DEEPEST} bounces; allowed: fewer") from None
    finally:
        sys.setrecursionlimit(previous)
    return first, rows, ties


@lru_cache(maxsize=2)
def _tracer(packed: bytes, sensor: int) -> Tracer:
    return Tracer(pickle.loads(packed), sensor=sensor)


# ------------------------------------------------------------------------------------------------- cache
def _fingerprint(packed: bytes, grid: int, sensor: int) -> str:
    """Hash the scene with its meshes and textures, the tracer's own source, and the machine's arithmetic."""
    digest = hashlib.sha256(packed)
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    digest.update(f"{grid} {sensor} {sys.version} {platform.platform()}".encode())
    return digest.hexdigest()


def _write(path: Path, picture: Picture) -> None:
    """Write beside, then rename: another process sees the whole file or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    ties = [[x, y, *ids] for (x, y), ids in sorted(picture.ties.items())]
    head = json.dumps({"width": picture.width, "height": picture.height, "ties": ties}).encode()
    body = b"".join(array("d", row).tobytes() for row in picture.rows)
    beside = path.with_suffix(f".{os.getpid()}")
    beside.write_bytes(head + b"\n" + body)
    os.replace(beside, path)


def _read(path: Path) -> Picture:
    head, body = path.read_bytes().split(b"\n", 1)
    facts = json.loads(head)
    width = facts["width"]
    numbers = array("d", body)
    rows = [list(numbers[i : i + 3 * width]) for i in range(0, len(numbers), 3 * width)]
    ties = {(x, y): (one, other) for x, y, one, other in facts["ties"]}
    return Picture(width, facts["height"], rows, ties)
