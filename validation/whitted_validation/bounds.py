"""The reference's picture together with a bound of what float32 may make of it, pixel by pixel.

Rows are spread over processes and kept under a hash of everything that they depend on.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import whitted_reference
from whitted_reference import Scene
from whitted_reference.arithmetic import INTERVAL
from whitted_reference.image import DEEPEST
from whitted_reference.proof import Prover
from whitted_reference.ray_tree import Tree
from whitted_validation.noise import Shaken, sampled_bound
from whitted_validation.rounding import Follower, Rounding
from whitted_validation.roundoffs import U
from whitted_validation.textures import Slopes

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]  # rows done, rows in all

# The least fault that must not be overlooked: a coefficient off by 1e-3 (model: reflectances lie in 0..1). A
# bound above that, relative to max(1, colour), is tried to be replaced by a sampled one.
LEAST_FAULT = 1e-3


class Means(IntEnum):
    """What vouches for the reference's colour of a pixel and for the bound around it."""

    ROUNDING = 0
    """the propagated bound, below the least fault"""
    NOISE = 1
    """draws, likewise"""
    INTERVAL = 2
    """neither: intervals enclose the colour to one rounding of float32"""
    DECIMAL = 3
    """nor do these: the colour was computed with forty digits"""


class Cause(IntEnum):
    """Why a bound is loose."""

    NONE = 0
    TEXTURE = 1
    """without the slopes of textures it would not be"""
    GRAZING = 2
    """one ray, which meets its surface at a small angle or is far away"""
    MIRRORS = 3
    """errors grow from mirror to mirror"""


@dataclass
class Bounds:
    """What the reference says of a picture.

    Attributes
    ----------
    colour : (height, width, 3) float64, linear radiance in double precision
    bound : (height, width, 3) float64, largest error of a float32 tracer that decides alike; may be infinite
    sampled : (height, width) bool, whether the bound comes from draws (see `noise`)
    chaotic : (height, width) bool, whether most draws decide otherwise: beyond float32
    means : (height, width) uint8, the `Means` that vouches for the pixel
    cause : (height, width) uint8, the `Cause` of a loose bound
    """

    colour: Array
    bound: Array
    sampled: NDArray[np.bool_]
    chaotic: NDArray[np.bool_]
    means: NDArray[np.uint8]
    cause: NDArray[np.uint8]

    @property
    def loose(self) -> NDArray[np.bool_]:
        """Tell where the bound is too large to notice a coefficient off by 1e-3."""
        return is_loose(self.colour, self.bound)


def least_fault(colour: Array) -> Array:
    """Return the change of a colour that must not be overlooked."""
    return LEAST_FAULT * np.maximum(1.0, np.abs(colour))


def is_loose(colour: Array, bound: Array) -> NDArray[np.bool_]:
    """Tell for one pixel or many whether a bound exceeds what the least fault changes."""
    return np.asarray((bound > least_fault(colour)).any(axis=-1))


def measure(
    scene: Scene,
    executor: Executor,
    grid: int = 1,
    sensor: int = 0,
    progress: Progress | None = None,
    cache: Path | None = None,
) -> Bounds:
    """Trace a picture in double precision and bound what float32 makes of it.

    Parameters
    ----------
    scene : what `whitted_reference.load` returned
    executor : where rows are traced
    grid : samples per pixel are grid x grid
    sensor : which of the scene's cameras
    progress : called with (rows done, rows in all)
    cache : a folder where results are kept
    """
    packed = pickle.dumps(scene, protocol=4)
    kept = None if cache is None else cache / f"{_fingerprint(packed, grid, sensor)}.npz"
    if kept is not None and kept.is_file():
        with np.load(kept) as data:
            return Bounds(**{field.name: data[field.name] for field in fields(Bounds)})
    film = scene.sensors[sensor].film
    bounds = _empty(film.crop_height, film.crop_width)
    waiting: dict[Future[Bounds], int] = {}
    for y in range(film.crop_height):
        waiting[executor.submit(measure_row, packed, sensor, grid, y)] = y
    for done, row in enumerate(as_completed(waiting), 1):
        y = waiting[row]
        found = row.result()
        for field in fields(Bounds):
            getattr(bounds, field.name)[y] = getattr(found, field.name)[0]
        if progress is not None:
            progress(done, film.crop_height)
    if kept is not None:
        _write(kept, bounds)
    return bounds


def measure_row(packed: bytes, sensor: int, grid: int, y: int) -> Bounds:
    """Do one row of a pickled scene; this is what a worker does."""
    tools = _tools(packed, sensor)
    width = tools.follower.film.crop_width
    row = _empty(1, width)
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST))
    for x in range(width):
        colour, bound = np.zeros(3), np.zeros(3)
        for j in range(grid):
            for i in range(grid):
                tree = tools.follower.record(x, y, i, j, grid)
                error = tools.rounding.bound(tree).colour
                if is_loose(np.array(tree.colour, float), error):
                    cause = tools.cause(tree)
                    sampled = sampled_bound(tools.shaken, tree, x, y, i, j, grid)
                    if sampled.chaotic:
                        error = sampled.bound
                        row.chaotic[0, x] = True
                    elif (sampled.bound < error).any():
                        error = np.minimum(error, sampled.bound)
                        row.sampled[0, x] = True
                    row.cause[0, x] = max(row.cause[0, x], cause)
                colour += np.array(tree.colour, float)
                bound += error
        row.colour[0, x] = colour / (grid * grid)
        # The film adds up the samples, each sum rounds once, and divides.
        row.bound[0, x] = bound / (grid * grid) + (grid * grid if grid > 1 else 0) * U * np.abs(row.colour[0, x])
        row.means[0, x] = Means.NOISE if row.sampled[0, x] else Means.ROUNDING
        if row.chaotic[0, x] or is_loose(row.colour[0, x], row.bound[0, x]):
            settled = tools.prover.settle(x, y, grid, enough=U)
            row.colour[0, x], row.bound[0, x] = settled.colour, row.bound[0, x] + settled.off
            row.means[0, x] = Means.INTERVAL if settled.means == INTERVAL.name else Means.DECIMAL
        else:
            row.cause[0, x] = Cause.NONE
    return row


def _empty(height: int, width: int) -> Bounds:
    def zeros(*channels: int, dtype: Any = float) -> NDArray[Any]:
        return np.zeros((height, width, *channels), dtype)

    return Bounds(
        zeros(3), zeros(3), zeros(dtype=bool), zeros(dtype=bool), zeros(dtype=np.uint8), zeros(dtype=np.uint8)
    )


class _Tools:
    """What a worker needs of one scene."""

    def __init__(self, scene: Scene, sensor: int) -> None:
        self.follower = Follower(scene, sensor)
        self.rounding = Rounding(self.follower, Slopes(scene))
        self._level = Rounding(self.follower, Slopes(scene, level=True))
        self.prover = Prover(scene, sensor)
        self._description, self._sensor = scene, sensor

    @cached_property
    def shaken(self) -> Shaken:
        """A second tracer, made for the first loose bound: of a large mesh that takes seconds."""
        return Shaken(self._description, self._sensor)

    def cause(self, tree: Tree) -> Cause:
        """Say why the bound of a sample is loose."""
        if not is_loose(np.array(tree.colour, float), self._level.bound(tree).colour):
            return Cause.TEXTURE
        return Cause.MIRRORS if tree.root.mirror else Cause.GRAZING


@lru_cache(maxsize=2)
def _tools(packed: bytes, sensor: int) -> _Tools:
    return _Tools(pickle.loads(packed), sensor)


def _fingerprint(packed: bytes, grid: int, sensor: int) -> str:
    """Hash the scene with its meshes and textures, the tracer's source and that of the model, and the machine."""
    digest = hashlib.sha256(packed)
    here = Path(__file__).parent
    model = [here / f"{name}.py" for name in ("bounds", "forms", "noise", "patch", "rounding", "roundoffs", "textures")]
    for source in [*sorted(Path(whitted_reference.__file__).parent.glob("*.py")), *model]:
        digest.update(source.read_bytes())
    digest.update(f"{grid} {sensor} {sys.version} {np.__version__} {platform.platform()}".encode())
    return digest.hexdigest()


def _write(path: Path, bounds: Bounds) -> None:
    """Write beside, then rename: another process sees the whole file or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(f".{os.getpid()}.npz")
    np.savez_compressed(beside, **vars(bounds))
    os.replace(beside, path)
