"""The plugin's picture for the command line, and what it took."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from whitted_validation.load import Loaded


def switch(loaded: Loaded, switches: Mapping[str, Any]) -> None:
    """Set parameters of the integrator, such as ``enable_shadows``, whatever the scene says."""
    loaded.integrator.settings = dataclasses.replace(loaded.integrator.settings, **switches)


def resize(loaded: Loaded, size: tuple[int, int]) -> None:
    """Give the film another size, (width, height) in pixels; any crop is dropped."""
    film = mi.traverse(loaded.sensor.film())
    film["size"] = size
    film["crop_offset"] = (0, 0)
    film["crop_size"] = size
    film.update()
    loaded.sensor.parameters_changed()


def render(loaded: Loaded, grid: int | None, progress: Callable[[int, int], None] | None = None) -> NDArray[np.float32]:
    """Draw the crop window of the sensor that was asked for.

    Parameters
    ----------
    grid
        n for n x n samples a pixel; None for the sampler's own number.
    progress
        Told the rows done and the rows in all, again and again.

    Returns
    -------
    (height, width, channels) float32
        Linear radiance.
    """

    def band_done(rows: int, all_rows: int) -> None:
        dr.sync_thread()  # kernels run on when their call is over: the bar would run ahead, and Ctrl-C wait
        if progress:
            progress(rows, all_rows)

    samples = grid**2 if grid else 0
    picture = loaded.integrator.render(loaded.scene, loaded.sensor, spp=samples, progress=band_done)
    return np.array(picture, dtype=np.float32)


def bands(
    loaded: Loaded, grid: int | None, progress: Callable[[int, int], None] | None = None
) -> Iterator[NDArray[np.float32]]:
    """Draw the same rows top down, (rows, width, channels) at a time, of which no more than one band is held."""
    height = int(loaded.sensor.film().crop_size()[1])
    for top, rows in loaded.integrator.render_in_bands(loaded.scene, loaded.sensor, spp=grid**2 if grid else 0):
        yield rows
        if progress:
            progress(top + len(rows), height)


class Stopwatch:
    """Time that kernels take to compile and to run, in seconds, while Dr.Jit records it."""

    def __init__(self) -> None:
        self.compiling = self.running = 0.0

    def __enter__(self) -> Stopwatch:
        dr.kernel_history_clear()
        dr.set_flag(dr.JitFlag.KernelHistory, True)
        return self

    def __exit__(self, *_: object) -> None:
        dr.set_flag(dr.JitFlag.KernelHistory, False)
        for kernel in dr.kernel_history():  # in milliseconds
            self.compiling += (kernel.get("codegen_time", 0.0) + kernel.get("backend_time", 0.0)) / 1000
            self.running += kernel["execution_time"] / 1000


def statistics(loaded: Loaded, grid: int | None, kernels: Stopwatch, total: float) -> Iterator[str]:
    """Say what a picture took, line by line; the rays are counted by tracing it once more.

    Parameters
    ----------
    kernels
        What was measured while it was drawn.
    total
        Seconds from the command to the written file.
    """
    width, height = (int(side) for side in loaded.sensor.film().crop_size())
    rays = loaded.integrator.count_rays(loaded.scene, loaded.sensor, spp=grid**2 if grid else 0)
    yield f"pixels        {width * height} ({width} x {height})"
    for kind, number in rays.items():
        yield f"{f'{kind} rays':<13} {number}"
    if kernels.running:  # a scalar variant has none
        yield f"kernel time   {kernels.running:.3g} s, and {kernels.compiling:.3g} s to compile"
    yield f"total time    {total:.3g} s"
