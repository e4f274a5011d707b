"""What this machine has and what works on it."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from importlib.metadata import version

import mitsuba_whitted  # isort: skip  # before Dr.Jit, whose libLLVM it chooses
import drjit as dr
import mitsuba as mi
import numpy as np


def report() -> Iterator[str]:
    """Examine the machine, line by line."""
    llvm = mitsuba_whitted.LIBLLVM
    yield ", ".join(f"{name} {version(name)}" for name in ("mitsuba-whitted", "mitsuba", "drjit", "numpy"))
    yield f"Python {platform.python_version()}, {platform.platform()}"
    if llvm.version[0] >= 0:
        yield f"libLLVM {'.'.join(map(str, llvm.version))}, {llvm.reason}: {llvm.path or 'path unknown'}"
    if llvm.refusal:
        yield f"problem: {llvm.refusal}"
    for variant in mi.variants():
        if variant.endswith(("_rgb", "_mono")):
            yield f"{variant:<14} {_verdict(variant)}"


def _verdict(variant: str) -> str:
    """Draw a white disk under a light of 1 in a variant: its pixel must be 1, by model.md."""
    if variant.startswith("llvm") and mitsuba_whitted.LIBLLVM.refusal:
        return "not tried, for the problem above"
    if variant.startswith("cuda") and not dr.has_backend(dr.JitBackend.CUDA):
        return "no NVIDIA GPU answers"
    try:
        mi.set_variant(variant)
        mi.set_log_level(mi.LogLevel.Error)  # grey film in a mono variant is no news
        facing = mi.ScalarTransform4f().look_at(origin=[0, 0, 1], target=[0, 0, 0], up=[0, 1, 0])
        film = {"type": "hdrfilm", "width": 1, "height": 1, "filter": {"type": "box"}}
        surface = {"type": "blinnphong", "diffuse_reflectance": 1.0}
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "whitted"},
                "camera": {"type": "perspective", "to_world": facing, "film": film},
                "light": {"type": "directional", "direction": [0, 0, -1], "irradiance": 1.0},
                "disk": {"type": "disk", "surface": surface},
            }
        )
        pixel = np.array(mi.render(scene, spp=1)).reshape(-1)
    except (RuntimeError, ImportError, ValueError) as error:
        return f"fails: {' '.join(str(error).split())}"
    return "works" if (pixel == 1).all() else f"draws {pixel.tolist()} where 1 is right"
