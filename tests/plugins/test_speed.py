"""Speed, as shares of what Mitsuba's own integrators take on the same scene in the same run."""

from __future__ import annotations

import gc
import statistics
import time
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

SCENE = Path(__file__).parents[2] / "scenes" / "many_spheres.xml"


@pytest.fixture
def large_scene(llvm_ad_rgb: str) -> mi.Scene:
    scene = mi.load_file(str(SCENE), optimize=False)
    parameters = mi.traverse(scene)
    parameters["camera.film.size"] = [1024, 1024]
    parameters.update()
    return scene


def _cpu_seconds(scene: mi.Scene, integrator: Any) -> float:
    start = time.process_time()
    dr.eval(mi.render(scene, integrator=integrator, spp=1))
    dr.sync_thread()
    return time.process_time() - start


@pytest.mark.slow
def test_two_hundred_spheres_take_less_than_path_takes(large_scene: mi.Scene) -> None:
    # The limit of 0.7 is the requirement, not a measurement: path asks one light a hit where whitted asks two.
    whitted = large_scene.integrator()
    path = mi.load_dict({"type": "path", "max_depth": whitted.settings.max_depth})
    for integrator in (whitted, path):
        _cpu_seconds(large_scene, integrator)  # compiles
    ratios = [_cpu_seconds(large_scene, whitted) / _cpu_seconds(large_scene, path) for _ in range(7)]
    print(f"\nwhitted / path, CPU time, {len(ratios)} pairs: median {statistics.median(ratios):.3f}")
    assert statistics.median(ratios) <= 0.7


def test_a_picture_is_started_in_a_few_milliseconds(large_scene: mi.Scene) -> None:
    # 5 ms is the requirement; of this thread's own time, which other work on the machine does not stretch.
    # What all tests before have left would be searched for garbage meanwhile, and that counted in.
    gc.collect()
    gc.freeze()
    mi.render(large_scene)
    dr.sync_thread()
    times = []
    for _ in range(20):
        start = time.thread_time()
        picture = mi.render(large_scene)
        times.append(time.thread_time() - start)
        dr.sync_thread()
        del picture
    gc.unfreeze()
    print(f"\nmi.render() returns after {1000 * statistics.median(times):.2f} ms (median of {len(times)})")
    assert statistics.median(times) < 5e-3
