"""Outlines of shapes as seen along an axis: what a draughtsman would draw of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whitted_reference import scene
from whitted_reference.scene import Shape
from whitted_reference.transforms import Affine

Array = NDArray[np.float64]

CORNERS = 48
"""Of the polygon that stands for an ellipse; it is off by 1 - cos(pi / 48), 0.2 % of its radius."""

_TURN = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
_CIRCLE = np.stack([np.cos(_TURN), np.sin(_TURN)])
_SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)


class Outline(NamedTuple):
    """Closed lines (n, 2) in the coordinates of a view, of the shape with that id."""

    id: str
    rings: list[Array]


def outlines(shapes: Sequence[Shape], axes: Array) -> Iterator[Outline]:
    """Project shapes onto two unit vectors, the rows of `axes` (2, 3)."""
    for shape in shapes:
        yield from _of_shape(shape, np.eye(3, 4), "", axes)


def _of_shape(shape: Shape, placed: Array, prefix: str, axes: Array) -> Iterator[Outline]:
    if isinstance(shape, scene.Instance):
        for inner in shape.shapes:
            yield from _of_shape(inner, _times(placed, _matrix(shape.to_world)), f"{shape.id}/", axes)
        return
    name = prefix + shape.look.id
    matrix = _times(placed, _matrix(shape.to_world))
    flat, origin = axes @ matrix[:, :3], axes @ matrix[:, 3]
    match shape:
        case scene.Sphere():
            middle = axes @ (placed[:, :3] @ np.array(shape.centre) + placed[:, 3])
            yield Outline(name, [_shadow_of_ball(axes @ placed[:, :3] * shape.radius) + middle])
        case scene.Cylinder():
            ends = [flat[:, :2] @ _CIRCLE + (origin + z * flat[:, 2])[:, None] for z in (0.0, 1.0)]
            yield Outline(name, [hull(np.concatenate([end.T for end in ends]))])
        case scene.Disk():
            yield Outline(name, [(flat[:, :2] @ _CIRCLE + origin[:, None]).T])
        case scene.Rectangle():
            yield Outline(name, [_SQUARE @ flat.T + origin])
        case scene.Mesh():
            yield Outline(name, [hull(_seen(shape.vertices, placed, axes))])
        case scene.Polygon():
            yield Outline(name, [_seen(ring, placed, axes) for ring in shape.rings])


def _seen(points: Sequence[tuple[float, float, float]], placed: Array, axes: Array) -> Array:
    """Project points that stand where the shape's own to_world has put them."""
    seen: Array = (np.array(points, float) @ placed[:, :3].T + placed[:, 3]) @ axes.T
    return seen


def _matrix(to_world: Affine) -> Array:
    return np.array(to_world.matrix, float)


def _times(a: Array, b: Array) -> Array:
    """Compose two affine maps given as (3, 4)."""
    linear = a[:, :3] @ b[:, :3]
    return np.column_stack([linear, a[:, :3] @ b[:, 3] + a[:, 3]])


def _shadow_of_ball(flat: Array) -> Array:
    """Outline of the unit ball under a linear map P to the plane: the farthest point along w, P P^T w / |P^T w|."""
    pulled = flat.T @ _CIRCLE
    length = np.linalg.norm(pulled, axis=0)
    outline: Array = (flat @ pulled / np.where(length > 0, length, 1.0)).T
    return outline


def hull(points: Array) -> Array:
    """Convex hull of points (n, 2), counter-clockwise (Andrew 1979, the monotone chain)."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered

    def chain(candidates: Array) -> list[Array]:
        kept: list[Array] = []
        for q in candidates:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], q) <= 0:
                kept.pop()
            kept.append(q)
        return kept[:-1]

    return np.array([*chain(ordered), *chain(ordered[::-1])])


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
