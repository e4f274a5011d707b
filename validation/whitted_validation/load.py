"""A scene file, looked over and handed to Mitsuba, for the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.stage import Settings
from whitted_validation import messages
from whitted_validation.refusal import Refusal, no_such_sensor
from whitted_validation.scene_check import Scene


@dataclass
class Loaded:
    """A scene that can be drawn.

    Attributes
    ----------
    integrator
        The scene's own if it is a `whitted`, else one with the defaults; `remark` then says so.
    """

    file: Path
    scene: mi.Scene
    sensor: mi.Sensor
    integrator: Any
    remark: str | None


def load(seen: Scene, folders: Sequence[Path], defines: Mapping[str, str], sensor: int = 0) -> Loaded:
    """Load a scene in the current variant, and make sure that `whitted` can draw it.

    Shapes are not merged, so that they keep their ids. Nothing is searched for in the current directory: a
    scene means the same wherever the command is typed.

    Parameters
    ----------
    seen
        What `scene_check.check` returned for the file, with the same `folders` and `defines`.
    sensor
        Which sensor is to be drawn, counted from 0 in the order of the file.

    Raises
    ------
    Refusal
        With the file, line and element, where Mitsuba tells them.
    """
    usual = mi.file_resolver()  # type: ignore[operator]  # its stub takes it for an object
    resolver = mi.FileResolver()
    resolver.clear()
    for folder in [*map(str, folders), *(str(path) for path in usual if str(path) != str(Path.cwd()))]:
        resolver.append(folder)
    mi.set_file_resolver(resolver)  # type: ignore[operator]  # likewise
    try:
        # One thread: a plugin in Python that logs holds the interpreter and waits for the log, while another
        # thread's message holds the log and waits for the interpreter, to be heard by `messages`.
        scene = mi.load_file(str(seen.file), parallel=False, optimize=False, **defines)
    except (RuntimeError, ValueError, TypeError) as error:
        if "KeyboardInterrupt" in str(error):  # Ctrl-C in a plugin's constructor, which Mitsuba reports as an error
            raise KeyboardInterrupt from None
        raise messages.refusal(error, seen) from None
    finally:
        mi.set_file_resolver(usual)  # type: ignore[operator]
    _check_numbers(scene, seen.file)
    sensors: list[mi.Sensor] = scene.sensors()
    if not 0 <= sensor < len(sensors):
        raise no_such_sensor(seen.file, len(sensors), sensor)
    integrator: Any = scene.integrator()
    remark = None
    if not isinstance(getattr(integrator, "settings", None), Settings):
        remark = f"{seen.file}: has {seen.integrator}; drawn by whitted with its defaults"
        integrator = mi.load_dict({"type": "whitted", "id": "whitted"})
    try:
        integrator.plan(scene, sensors[sensor])
    except SceneError as error:
        raise Refusal(f"{seen.file}: {error}") from None
    return Loaded(seen.file, scene, sensors[sensor], integrator, remark)


def _check_numbers(scene: mi.Scene, file: Path) -> None:
    """Look for what only shows in the loaded scene: numbers from other files, products of transforms.

    A key begins with the id of its object, which is as near as Mitsuba can tell.
    """
    parameters = mi.traverse(scene)
    for key, _ in parameters:
        value = parameters[key]
        if key.endswith("to_world"):
            value = np.array(value.matrix, dtype=np.float64).reshape(4, 4)
            if np.isfinite(value).all() and _flattens(value[:3, :3]):
                raise Refusal(f"{file}: {key}: is singular, it flattens the object; it must be invertible")
        try:
            numbers = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            continue  # a name or an object, no number
        if not np.isfinite(numbers).all():
            raise Refusal(f"{file}: {key}: holds nan or infinity; every number must be finite")


def _flattens(matrix: NDArray[np.float64]) -> bool:
    """Tell whether rounding the matrix to float32 could have made or hidden a determinant of zero.

    Each row is off by at most u = 2**-24 of its length, so the determinant by at most 3 u of the product of
    all lengths, Hadamard's bound. Unequal scales, however far apart, are far from that.
    """
    lengths = np.linalg.norm(matrix, axis=1)
    return bool(abs(np.linalg.det(matrix)) <= 3 * 2.0**-24 * lengths.prod())
