"""The floor of refinement: what merely tracing its samples takes, if all were known beforehand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mitsuba_whitted  # noqa: F401  # isort: skip  # before Mitsuba
import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

FINEST = 256
"""Places of samples are told apart to this part of a pixel when they are put in order."""


def bare(scene: Any) -> Callable[[], Any]:
    """Trace the samples that a scene's target error takes, and nothing else.

    All in one launch, along a Z curve, so that a vector's rays are as close as they can be; nothing is decided, split
    or averaged. What a refinement takes beyond this is work of its own, and the price of not knowing its samples.

    Returns
    -------
    Callable
        Starts to trace; evaluating the colours and paths that it returns finishes it.
    """
    from mitsuba_whitted.trace import trace  # its names need a variant

    x, y = (mi.Float(places) for places in samples(scene).T)
    dr.eval(x, y)
    integrator = scene.integrator()
    stage, camera, plan = integrator._prepare(scene, scene.sensors()[0])

    def draw() -> Any:
        traced = trace(stage, plan, camera.rays(x, y), mi.Bool(True))
        return traced.colour, traced.path

    return draw


def samples(scene: Any) -> NDArray[np.float32]:
    """Find the places of all samples that a scene's target error takes, (n, 2): x, y in pixels, neighbours together."""
    integrator = scene.integrator()
    count = integrator.count_rays(scene)["camera"]
    found, used = dr.empty(mi.Float, 2 * count), dr.zeros(mi.UInt32, 1)

    def note(x: Any, y: Any, _rays: Any, active: Any) -> None:
        place = dr.scatter_inc(used, mi.UInt32(0), active)  # in any order: it is sorted below
        dr.scatter(found, mi.Point2f(x, y), place, active)

    integrator.count_rays(scene, heard=note)
    places = np.array(found).reshape(-1, 2)
    order = np.lexsort((*places.T, _along_z_curve(places)))
    sorted_places: NDArray[np.float32] = places[order]
    return sorted_places


def _along_z_curve(places: NDArray[np.float32]) -> NDArray[np.uint64]:
    """Interleave the bits of two numbers below 2^32 (Morton 1966)."""
    number = np.zeros(len(places), np.uint64)
    for axis in range(2):
        bits = (np.maximum(places[:, axis], 0) * FINEST).astype(np.uint64)  # an edge may bulge out of the picture
        for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F),
                            (2, 0x3333333333333333), (1, 0x5555555555555555)):  # fmt: skip
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        number |= bits << np.uint64(axis)
    return number
