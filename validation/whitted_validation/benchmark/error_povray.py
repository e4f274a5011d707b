"""POV-Ray's curves of error against cost: its two methods of antialiasing, over thresholds and depths."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import whitted_reference
from whitted_validation.benchmark import povray
from whitted_validation.benchmark.error_curves import Point
from whitted_validation.benchmark.error_drawing import Image, Timed
from whitted_validation.benchmark.error_picture import compared, cost
from whitted_validation.benchmark.error_schedule import Schedule

POVRAY = "POV-Ray"

METHODS = tuple(f"{POVRAY} method {method}" for method in (1, 2))


def by_povray(
    name: str,
    file: Path,
    one: Timed,
    rays: int,
    truth: Image,
    hidden: NDArray[np.bool_],
    schedule: Schedule,
    told: Callable[[str], None],
) -> Iterator[Point]:
    """Have POV-Ray draw a scene in all modes of the schedule, and once without antialiasing.

    Parameters
    ----------
    name, file : of the scene
    one, rays : our picture of one sample a pixel, and how many rays it takes
    truth, hidden : the converged picture, and the pixels that show their corners nothing of what is in them
    told : hears what is drawn next

    Raises
    ------
    Unavailable, Failed
        As `PovRay` does.
    """
    ways = [(f"{POVRAY}, one sample", 1.0, povray.ONE_SAMPLE)]
    ways += [(f"{METHODS[m - 1]}, depth {d}", x, povray.antialiased(m, x, d)) for m, x, d in schedule.povray]
    description = whitted_reference.load(file, {"size": str(len(truth))})
    scene = povray.PovRay(description, file.parent, float(truth.max()))
    for way, knob, options in ways:
        told(f"{name}: {way}, {knob:g}")
        mode = povray.Mode(scene, options)
        drawn = mode.drawn
        costs = cost(one, mode, drawn.whole, schedule)
        yield compared(way, knob, drawn.pixels, truth, costs, (drawn.rays + drawn.shadow_rays) / rays, hidden)
