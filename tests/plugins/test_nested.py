"""The integrator inside others, where Mitsuba asks it ray by ray."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


@pytest.mark.parametrize("threads", [1, 2])
def test_it_can_be_asked_from_many_threads(any_rgb: str, threads: int) -> None:
    # A floor that fills the view, lit along its normal: every sample is k_d E = 0.5 * 0.5, wherever it falls.
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "moment", "nested": {"type": "whitted"}},
            "camera": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 1], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 6, "height": 6, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 2},
            },
            "floor": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(100),
                "bsdf": {"type": "blinnphong", "diffuse_reflectance": 0.5},
            },
            "sun": {"type": "directional", "direction": [0, 0, -1], "irradiance": 0.5},
        }
    )
    before = dr.thread_count()
    dr.set_thread_count(threads)
    try:
        picture = np.array(mi.render(scene))
    finally:
        dr.set_thread_count(before)
    assert (picture[..., :3] == 0.25).all()
