"""The plugin's picture for the command line: in bands of rows, so that long work shows how far it is."""

from __future__ import annotations

import math
from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from whitted_validation.refusal import Refusal

# Samples that are drawn at once. One kernel takes them all, so this bounds the memory (some 100 bytes each)
# and how long nothing is heard of it; a scalar variant goes through them one by one.
BAND = {True: 1 << 22, False: 1 << 12}
ROW = 1 << 26  # the most samples of one row, which is not divided further


def sensor_of(scene: mi.Scene, index: int) -> mi.Sensor:
    """Take the sensor that `-s` names, counted from 0 in the order of the file."""
    sensors: list[mi.Sensor] = scene.sensors()
    if not 0 <= index < len(sensors):
        raise Refusal(f"-s {index}: the scene has {len(sensors)} sensor(s), counted from 0")
    return sensors[index]


def grid_of(sensor: mi.Sensor) -> int:
    """Side of the sensor's sample grid: the square root of its sample_count, rounded up."""
    return math.isqrt(max(sensor.sampler().sample_count() - 1, 0)) + 1


def render(
    scene: mi.Scene,
    integrator: mi.Integrator,
    sensor: mi.Sensor,
    grid: int,
    advance: Callable[[float], None] = lambda part: None,
) -> NDArray[np.float32]:
    """Draw the sensor's crop window, band by band.

    Parameters
    ----------
    grid
        n x n samples for each pixel.
    advance
        Told after each band which part of the whole is done, in (0, 1].

    Returns
    -------
    (height, width, channels) float32
        The same numbers however the picture is divided.

    Raises
    ------
    Refusal
        If a single row is more than can be drawn at once.
    """
    width, height = (int(side) for side in sensor.film().crop_size())
    left, top = (int(side) for side in sensor.film().crop_offset())
    if width * grid**2 > ROW:
        raise Refusal(f"--grid {grid}: a row has {width} x {grid}^2 samples; at most {ROW} are allowed")
    rows = max(1, BAND[dr.is_jit_v(mi.Float)] // (width * grid**2))
    if sensor.film().rfilter().radius() > 0.5:
        rows = height  # a filter wider than the box takes from neighbouring rows
    bands = []
    try:
        for row in range(0, height, rows):
            _crop(sensor, (left, top + row), (width, min(rows, height - row)))
            bands.append(np.array(integrator.render(scene, sensor, spp=grid**2)))
            advance(min(1.0, (row + rows) / height))
    finally:
        _crop(sensor, (left, top), (width, height))
    return np.concatenate(bands)


def _crop(sensor: mi.Sensor, offset: tuple[int, int], size: tuple[int, int]) -> None:
    window = mi.traverse(sensor)
    window["film.crop_offset"] = offset
    window["film.crop_size"] = size
    window.update()
