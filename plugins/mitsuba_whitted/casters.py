"""Which of the few shapes can block a light at all: a floor under everything throws no shadow."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.shapes import PLANES, Kind, Row

Vector = NDArray[np.float64]


def casters(
    graph: SceneGraph,
    rows: list[Row],
    few: list[int],
    centre: Vector,
    places: list[Vector],
    directions: list[Vector],
    two_sided: bool,
) -> set[int]:
    """Leave out of `few` what can be on no segment from a surface to a light.

    Parameters
    ----------
    graph, rows : the scene, its shapes in the order of ``graph.all_shapes``
    few : numbers of the shapes in question
    centre : what the places of `rows` are relative to
    places, directions : of lights, relative to it as well, and unit vectors towards those infinitely far
    two_sided : whether some surface is lit from both sides
    """
    if len(rows) == 1 and not graph.instances and _lights_only_its_outside(rows[0], two_sided):
        return set()
    return {
        i for i in few if rows[i].kind not in PLANES or not _all_on_one_side(graph, rows, i, centre, places, directions)
    }


def _lights_only_its_outside(row: Row, two_sided: bool) -> bool:
    """Whether no segment from the lit side of a shape to a light meets the shape again."""
    return row.kind in PLANES or (row.kind == Kind.SPHERE and row.sign > 0 and not two_sided)


def _all_on_one_side(
    graph: SceneGraph, rows: list[Row], i: int, centre: Vector, places: list[Vector], directions: list[Vector]
) -> bool:
    """Whether all other shapes are on one side of plane `i`, or touch it, and all lights beyond it on that side."""
    a, n = rows[i].a, rows[i].b
    heights = np.array([*(n @ (place - a) for place in places), *(n @ direction for direction in directions)])
    others = [
        _ball_between(rows[j], n, a) if rows[j].kind == Kind.SPHERE else _box_between(shape, n, centre + a)
        for j, shape in enumerate(graph.plain)
        if j != i
    ]
    others += [_box_between(instance, n, centre + a) for instance in graph.instances]
    low, high = np.array(others or [(0.0, 0.0)]).T
    return bool((heights > 0).all() and (low >= 0).all()) or bool((heights < 0).all() and (high <= 0).all())


def _ball_between(ball: Row, n: Vector, a: Vector) -> tuple[float, float]:
    """Lowest and highest point of a ball over the plane through `a` with normal `n`."""
    height = float(n @ (ball.a - a))
    return height - ball.r, height + ball.r


def _box_between(shape: mi.Shape, n: Vector, a: Vector) -> tuple[float, float]:
    box = shape.bbox()
    corners = np.array([box.corner(i) for i in range(8)], float)
    heights = (corners - a) @ n
    return float(heights.min()), float(heights.max())
