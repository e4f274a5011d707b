"""What is seen through the middle of each pixel: the object, the lights that reach it, and the mirrors on the way."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from whitted_reference import Scene
from whitted_reference.image import DEEPEST
from whitted_reference.lights import Spot
from whitted_reference.ray_tree import RayNode
from whitted_validation.rounding import Follower, chain

BACKGROUND = "background"

T = TypeVar("T")


@dataclass
class Seen:
    """What the reference finds along the ray through the middle of each pixel.

    Attributes
    ----------
    object, lights : (height, width) indices into `objects` and `light_texts`
    objects : ids of shapes, and the background
    light_texts : which lights reach the first hit, and what keeps the others away
    bounces : (height, width), how many mirror rays follow the camera ray
    """

    object: NDArray[np.int32]
    objects: list[str]
    lights: NDArray[np.int32]
    light_texts: list[str]
    bounces: NDArray[np.int32]


def look(scene: Scene, executor: Executor, sensor: int = 0) -> Seen:
    """Trace the middle of every pixel.

    Parameters
    ----------
    scene : what `whitted_reference.load` returned
    executor : where rows are traced
    sensor : which of the scene's cameras
    """
    packed = pickle.dumps(scene, protocol=4)
    height = scene.sensors[sensor].film.crop_height
    waiting = [executor.submit(look_along_row, packed, sensor, y) for y in range(height)]
    rows = [future.result() for future in waiting]
    objects, object_texts = _indexed(rows, lambda pixel: pixel[0])
    lights, light_texts = _indexed(rows, lambda pixel: pixel[1])
    bounces = np.array([[pixel[2] for pixel in row] for row in rows], np.int32)
    return Seen(objects, object_texts, lights, light_texts, bounces)


def look_along_row(packed: bytes, sensor: int, y: int) -> list[tuple[str, str, int]]:
    """Return object, lights and bounces of each pixel of a row; this is what a worker does."""
    follower = _follower(packed, sensor)
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST))
    row = []
    for x in range(follower.film.crop_width):
        root = follower.record(x, y).root
        row.append((_object(root), _lights(follower, root), sum(1 for _ in chain(root)) - 1))
    return row


@lru_cache(maxsize=2)
def _follower(packed: bytes, sensor: int) -> Follower:
    return Follower(pickle.loads(packed), sensor)


def _object(node: RayNode) -> str:
    if node.shape is None:
        return BACKGROUND
    return node.shape if _faces(node) else f"{node.shape}, from behind"


def _faces(node: RayNode) -> bool:
    return node.n_v > 0 and node.n_g_v > 0


def _lights(follower: Follower, node: RayNode) -> str:
    """Say of each light whether it reaches the hit, those that do first."""
    if node.shape is None or not _faces(node):
        return ""
    lit = [light.id for light in node.lights if light.above and light.blocked_by is None]
    kept_away = [
        f"{light.id} below the horizon" if not light.above else f"{light.id} behind {light.blocked_by}"
        for light in node.lights
        if not light.above or light.blocked_by is not None
    ]
    asked = {light.id for light in node.lights}
    kept_away += [
        f"{light.id} shines elsewhere" for light in follower.lights if isinstance(light, Spot) and light.id not in asked
    ]
    return "; ".join([f"lit by {', '.join(lit)}" if lit else "no light", *kept_away])


def _indexed(rows: list[list[T]], text: Callable[[T], str]) -> tuple[NDArray[np.int32], list[str]]:
    """Give numbers to the different texts in the order in which they appear."""
    places: dict[str, int] = {}
    plane = [[places.setdefault(text(pixel), len(places)) for pixel in row] for row in rows]
    return np.array(plane, np.int32), list(places)
