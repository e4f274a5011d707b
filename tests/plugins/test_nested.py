"""The integrator inside others, where Mitsuba asks it ray by ray."""

from __future__ import annotations

import mitsuba as mi
import numpy as np


def test_another_integrator_may_wrap_it(llvm_ad_rgb: str) -> None:
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
    picture = np.array(mi.render(scene))
    assert (picture[..., :3] == 0.25).all()
