"""The origin that a picture is computed about: a scene far from its own origin is brought back to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.scene_graph import SceneGraph

WORTHWHILE = 16
"""How many times further from the origin than from one another shapes must be.

A point at distance w carries a rounding of u w, whatever lies around it. Up to 16 u of its distance s from the
middle of the scene come from a search, an offset and a shadow ray anyhow (`precise`), so that below
w = 16 s nothing would be gained.
"""

NEARER = 25
"""Per cent of the shapes that the distance from the middle is read from: a few that are far off do not count."""


def centre_of(graph: SceneGraph) -> NDArray[np.float64]:
    """Find the point, of float32 numbers, that is to be the origin: the middle of the scene, or (0, 0, 0).

    The median of the middles of all shapes, so that a huge floor does not hide how far off the rest is. The
    difference of float32 numbers within a factor of two of one another is exact (Sterbenz 1974): what stands
    near the centre is moved without a rounding.
    """
    boxes = [shape.bbox() for shape in graph.shapes]
    corners = np.array([[box.min, box.max] for box in boxes if box.valid()], float).reshape(-1, 2, 3)
    if not len(corners) or not np.isfinite(corners).all():
        return np.zeros(3)
    middle = np.percentile(corners.mean(axis=1), 50, axis=0).astype(np.float32).astype(float)
    from_origin = np.percentile(np.abs(corners).max(axis=(1, 2)), 50)  # np.median would import all of numpy.ma
    from_middle = np.percentile(np.abs(corners - middle).max(axis=(1, 2)), NEARER)
    return middle if from_origin > WORTHWHILE * from_middle else np.zeros(3)
