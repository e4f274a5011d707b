"""The shapes of a scene as numbers: kind, place and size of each, in float64."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.transforms import matrix_of

Vector = NDArray[np.float64]


class Kind(IntEnum):
    """How a hit on a shape is computed; the letters are those of the tables."""

    RECTANGLE = 0
    """Plane through `a` with normal `b`."""
    DISK = 1
    """The same."""
    SPHERE = 2
    """Centre `a`, radius `r`."""
    CYLINDER = 3
    """Axis through `a` along `b`, radius `r`."""
    MESH = 4
    """Triangles, each with a plane of its own."""


PLANES = {Kind.RECTANGLE, Kind.DISK}

_KINDS = {"Rectangle": Kind.RECTANGLE, "Disk": Kind.DISK, "Sphere": Kind.SPHERE, "Cylinder": Kind.CYLINDER}

_PLACED_BY = {
    Kind.SPHERE: "its to_world, with center and radius,",
    Kind.CYLINDER: "its to_world, with p0, p1 and radius,",
}
"""What Mitsuba folds into to_world."""


class Row(NamedTuple):
    """One shape of the scene."""

    kind: Kind
    a: Vector
    b: Vector
    plane: Vector
    """Unit normal of the plane that M x and M y span, on the side of `b`: `b` is the rounded M^-T z."""
    r: float
    sign: float
    """-1 where the normal of the formula points to the back."""
    reach: Vector
    to_local: NDArray[Any]
    """From a vector off M 0 to local coordinates, (3, 3): texture coordinates come of them."""


def row_of(graph: SceneGraph, shape: mi.Shape, centre: Vector) -> Row:
    """Read a shape, its place relative to `centre`.

    Raises
    ------
    SceneError
        If it is of another kind, or not finite, or singular.
    """
    kind = _KINDS.get(shape.class_name(), Kind.MESH)
    if kind == Kind.MESH and not shape.is_mesh():
        raise SceneError(
            f"shape `{shape.id()}`: {shape.class_name()} is not handled; "
            "allowed are spheres, rectangles, disks, cylinders, meshes and instances of them"
        )
    if shape.is_medium_transition():
        raise SceneError(f"shape `{shape.id()}`: participating media are not handled")

    box = shape.bbox()
    reach = np.maximum(np.abs(np.array(box.min, float) - centre), np.abs(np.array(box.max, float) - centre))
    flipped = -1.0 if shape.has_flipped_normals() else 1.0
    if kind == Kind.MESH:
        zero = np.zeros(3)
        return Row(kind, zero, zero, zero, 0.0, flipped, reach, np.zeros((3, 3)))

    to_world = graph.value(shape, "to_world")
    matrix = matrix_of(to_world, f"shape `{shape.id()}`", _PLACED_BY.get(kind, "to_world"))
    linear, origin = matrix[:3, :3], matrix[:3, 3] - centre

    radius = _single_length(linear[:, 0]) if kind == Kind.SPHERE else float(np.linalg.norm(linear[:, 0]))
    normal = linear[:, 2]
    if kind in PLANES:
        normal = np.array(to_world.inverse_transpose, float).reshape(4, 4)[:3, 2]
        if not np.all(np.isfinite(normal)) or not normal.any():
            raise SceneError(f"shape `{shape.id()}`: to_world is too large or too small for a normal in float32")
    if kind == Kind.CYLINDER and np.linalg.det(linear) < 0:
        flipped = -flipped  # Mitsuba notes the mirror as a flip, to keep the normal outward
    plane = np.cross(linear[:, 0], linear[:, 1]) * np.sign(np.linalg.det(linear))
    return Row(kind, origin, _unit(normal), _unit(plane), radius, flipped, reach, _to_local(kind, linear))


def _to_local(kind: Kind, linear: NDArray[np.float64]) -> NDArray[Any]:
    """Invert the linear part of to_world; for round shapes up to a factor of x and y, whose angle alone counts.

    Their axes are the columns of M. Rounded to single these are not square to each other to the last bit, so that the
    inverse would turn them by u.
    """
    if kind in PLANES:
        inverse: NDArray[Any] = np.linalg.inv(linear)
        return inverse
    if kind == Kind.SPHERE:
        return np.array(linear.T)
    axis = linear[:, 2]
    across = linear - np.outer(axis, axis @ linear) / (axis @ axis)
    return np.array([across[:, 0], across[:, 1], axis / (axis @ axis)])


def _unit(v: Vector) -> Vector:
    unit: Vector = v / np.linalg.norm(v)
    return unit


def _single_length(v: Vector) -> float:
    """Length of a vector of float32 numbers as Mitsuba's scalar variants compute a radius, x and z first.

    Those that compile fuse products and sums, so that theirs may differ in the last bit: the picture does not.
    """
    x, y, z = v.astype(np.float32)
    return float(np.sqrt(x * x + z * z + y * y))
