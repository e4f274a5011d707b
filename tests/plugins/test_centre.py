"""A scene far from the origin gives the picture that it gives at the origin."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_whitted.centre import centre_of
from mitsuba_whitted.scene_graph import SceneGraph

SHIFTS = [(1024.0, -1024.0, 512.0), (8192.0, 8192.0, -16384.0), (0.0, 2.0**20, 0.0)]
"""Powers of two and their like: the moved scene's numbers are exact, so that its picture has no reason to differ."""


def scene(shift: tuple[float, float, float], **more: Any) -> mi.Scene:
    x, y, z = shift
    move = mi.ScalarTransform4f().translate(shift)
    bsdf = {"type": "blinnphong", "mirror_reflectance": 0.4, "specular_reflectance": 0.4, "exponent": 100.0}
    balls = {
        f"ball{i}": {"type": "sphere", "center": [x + 1.5 * i - 3, y, z + 0.625], "radius": 0.625, "bsdf": bsdf}
        for i in range(5)
    }
    view = mi.ScalarTransform4f([[1, 0, 0, 0], [0, 0, 1, -8], [0, -1, 0, 2], [0, 0, 0, 1]])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "whitted", "ambient": 0.1},
            "camera": {
                "type": "perspective",
                "to_world": move @ view,
                "film": {"type": "hdrfilm", "width": 64, "height": 48, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 1},
            },
            "floor": {"type": "rectangle", "to_world": move @ mi.ScalarTransform4f().scale(16)},
            "block": {"type": "cube", "to_world": move @ mi.ScalarTransform4f().translate([0, 2, 1]).scale(0.5)},
            "disk": {"type": "disk", "to_world": move @ mi.ScalarTransform4f().translate([-3, 3, 1])},
            "tube": {"type": "cylinder", "p0": [x + 3, y + 2, z], "p1": [x + 3, y + 2, z + 2], "radius": 0.25},
            "lamp": {"type": "point", "position": [x + 4, y - 4, z + 6], "intensity": 40.0},
            "sun": {"type": "directional", "direction": [0.3, 0.5, -1], "irradiance": 0.5},
            **balls,
            **more,
        }
    )


@pytest.mark.parametrize("shift", SHIFTS[1:])
def test_a_scene_gives_the_same_bytes_wherever_it_is_moved_to(any_variant: str, shift: tuple[float, ...]) -> None:
    assert np.array_equal(np.array(mi.render(scene(shift))), np.array(mi.render(scene(SHIFTS[0]))))


def test_a_scene_at_the_origin_is_not_moved(llvm_ad_rgb: None) -> None:
    assert not centre_of(SceneGraph(scene((0.0, 0.0, 0.0)))).any()


def test_the_centre_is_among_the_shapes_though_a_floor_be_huge(llvm_ad_rgb: None) -> None:
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(1e6)}
    centre = centre_of(SceneGraph(scene(SHIFTS[0], huge=floor)))
    assert np.abs(centre - SHIFTS[0]).max() <= 4


def test_an_edit_that_moves_the_scene_moves_the_centre(llvm_ad_rgb: None) -> None:
    one = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "whitted"},
            "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
            "ball": {"type": "sphere", "center": [0, 0, 4]},
            "lamp": {"type": "point", "position": [0, 0, 0]},
        }
    )
    near = np.array(mi.render(one, spp=1))
    parameters = mi.traverse(one)
    far = mi.ScalarTransform4f().translate([4096, 0, 4])
    for key in ("ball.to_world", "sensor.to_world"):
        parameters[key] = type(parameters[key])(
            (far if "ball" in key else mi.ScalarTransform4f().translate([4096, 0, 0])).matrix
        )
    parameters["lamp.position"] = [4096, 0, 0]
    parameters.update()
    assert np.array_equal(np.array(mi.render(one, spp=1)), near)
