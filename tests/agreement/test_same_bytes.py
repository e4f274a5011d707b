"""Every shipped scene in every variant: the same bytes on one thread, on two, and in another process."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from functools import cache
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.xml"))
SIDE = {"scalar_rgb": 10, "llvm_ad_rgb": 40, "llvm_ad_mono": 40}
"""Pixels; 40 x 40 are more than one piece of work for Dr.Jit's threads."""


def digest(file: Path, threads: int) -> str:
    dr.set_thread_count(threads)
    scene = mi.load_file(str(file), optimize=False)
    parameters = mi.traverse(scene)
    for key in parameters.keys():  # noqa: SIM118  # iterating a SceneParameters yields pairs
        if key.endswith("film.size"):
            parameters[key] = [SIDE[mi.variant()]] * 2
    parameters.update()
    return hashlib.sha256(np.array(mi.render(scene)).tobytes()).hexdigest()


@cache
def of_another_process(variant: str) -> dict[str, str]:
    script = (
        "import sys, mitsuba_whitted, mitsuba as mi; mi.set_variant(sys.argv[1]); mi.set_log_level(mi.LogLevel.Error)\n"
        f"sys.path.insert(0, {str(Path(__file__).parent)!r}); from test_same_bytes import SCENES, digest\n"
        "for file in reversed(SCENES): print(file.stem, digest(file, 2))"
    )
    run = [sys.executable, "-c", script, variant]
    done = subprocess.run(run, capture_output=True, text=True, timeout=300, check=True)
    return dict(line.split() for line in done.stdout.splitlines() if len(line.split()) == 2)


@pytest.mark.parametrize("file", SCENES, ids=lambda file: file.stem)
def test_a_scene_has_the_same_bytes_every_time(any_variant: str, file: Path) -> None:
    threads = dr.thread_count()
    try:
        found = [digest(file, 1), digest(file, 2), digest(file, 2)]
    finally:
        dr.set_thread_count(threads)
    assert {*found, of_another_process(any_variant)[file.stem]} == {found[0]}
