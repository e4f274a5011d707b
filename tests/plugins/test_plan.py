"""The plan: what the kernel holds follows from the scene's structure, and from nothing else."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


def _scene(bsdf: dict[str, Any] | None = None, integrator: dict[str, Any] | None = None, **contents: Any) -> mi.Scene:
    floor = {"type": "rectangle", "bsdf": bsdf or {"type": "blinnphong"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "whitted", **(integrator or {})},
            "camera": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([0.3, 0.2, 4], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 1},
            },
            "floor": floor,
            **contents,
        }
    )


POINT = {"type": "point", "position": [1, 1, 3], "intensity": 5.0}
BALL = {"type": "sphere", "center": [0.2, 0, 0.8], "radius": 0.3}
GREY = {"type": "blinnphong", "diffuse_reflectance": 0.5}
MIRROR = {**GREY, "mirror_reflectance": 0.1}


@pytest.mark.parametrize(
    ("part", "without", "with_it"),
    [
        ("lights", {}, {"lamp": POINT}),
        ("diffuse", {"bsdf": {"type": "blinnphong", "diffuse_reflectance": 0.0}, "lamp": POINT}, {"lamp": POINT}),
        ("specular", {"lamp": POINT}, {"bsdf": {**GREY, "specular_reflectance": 0.1}, "lamp": POINT}),
        ("mirrors", {"lamp": POINT}, {"bsdf": {**GREY, "mirror_reflectance": 0.1}, "lamp": POINT}),
        ("mirrors", {"bsdf": MIRROR}, {"bsdf": MIRROR, "sky": {"type": "constant"}}),
        ("ambient", {}, {"integrator": {"ambient": 0.1}}),
        ("two_sided", {}, {"bsdf": {"type": "twosided", "nested": GREY}}),
        ("textured", {}, {"bsdf": {"type": "blinnphong", "diffuse_reflectance": {"type": "checkerboard"}}}),
        ("background", {}, {"sky": {"type": "constant"}}),
        ("emission", {}, {"glow": {"type": "sphere", "emitter": {"type": "area", "radiance": 1.0}}}),
        (
            "shadows",
            {"integrator": {"enable_shadows": False}, "lamp": POINT, "ball": BALL},
            {"lamp": POINT, "ball": BALL},
        ),
        ("shadows", {"lamp": POINT}, {"lamp": POINT, "ball": BALL}),
        ("searched", {"ball": BALL}, {"box": {"type": "cube"}}),
        ("few", {"floor": {"type": "cube"}}, {"ball": BALL}),
        ("inverse_square", {"integrator": {"falloff": "none"}, "lamp": POINT}, {"lamp": POINT}),
        ("tables", {"ball": BALL}, {f"ball {i}": BALL for i in range(8)}),
        ("materials", {}, {"ball": BALL}),
        ("smooth_normals", {}, {"box": {"type": "cube"}}),
        ("epsilon", {}, {"integrator": {"epsilon": 1e-3}}),
    ],
)
def test_a_part_is_in_the_kernel_just_where_a_scene_needs_it(
    llvm_ad_rgb: str, part: str, without: dict[str, Any], with_it: dict[str, Any]
) -> None:
    for contents, needed in ((without, False), (with_it, True)):
        scene = _scene(**contents)
        assert bool(getattr(scene.integrator().plan(scene), part)) is needed


def _kernels(scene: mi.Scene) -> list[dict[str, Any]]:
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        picture = mi.render(scene)
        dr.eval(picture)
        dr.sync_thread()
        return [kernel for kernel in dr.kernel_history() if kernel["type"] == dr.KernelType.JIT]


def _operations(scene: mi.Scene) -> int:
    kernels = _kernels(scene)
    tracing = [kernel for kernel in kernels if kernel.get("uses_optix") or kernel["operation_count"] > 100]
    assert len(tracing) == 1, "tracing and storing a picture is one kernel"
    return int(tracing[0]["operation_count"])


@pytest.mark.parametrize(
    ("simple", "rich"),
    [
        ({"lamp": POINT}, {"lamp": POINT, "bsdf": {**GREY, "specular_reflectance": 0.1}}),
        ({"lamp": POINT}, {"lamp": POINT, "bsdf": {**GREY, "mirror_reflectance": 0.1}}),
        ({"lamp": POINT}, {"lamp": POINT, "bsdf": {"type": "twosided", "nested": GREY}}),
        ({"lamp": POINT, "ball": BALL, "integrator": {"enable_shadows": False}}, {"lamp": POINT, "ball": BALL}),
        ({"lamp": POINT}, {"lamp": POINT, "ball": BALL}),
        ({"lamp": POINT}, {"lamp": POINT, "second": POINT}),
    ],
)
def test_what_is_left_out_makes_the_kernel_smaller(
    llvm_ad_rgb: str, simple: dict[str, Any], rich: dict[str, Any]
) -> None:
    assert _operations(_scene(**simple)) < _operations(_scene(**rich))


def test_a_picture_is_one_kernel(llvm_ad_rgb: str) -> None:
    scene = _scene(lamp=POINT, bsdf={**GREY, "mirror_reflectance": 0.1})
    np.array(mi.render(scene))
    assert len(_kernels(scene)) == 1


def test_the_plan_explains_itself(llvm_ad_rgb: str) -> None:
    scene = _scene(lamp=POINT, ball=BALL)
    words = str(scene.integrator().plan(scene))
    present, absent = words.split("left out:")
    assert "light from 1 point" in present
    assert "shadow rays" in present
    assert "mirror" in absent
    assert "no BSDF is two-sided" in absent


def test_rays_are_counted_by_kind(llvm_ad_rgb: str) -> None:
    # The floor fills the middle of 16 x 16 pixels; every hit asks the lamp once, and as a mirror sends one ray on.
    # The ball, out of sight, is what could throw a shadow.
    ball = {**BALL, "center": [0, 99, 9]}
    scene = _scene(lamp=POINT, bsdf={**GREY, "mirror_reflectance": 0.1}, ball=ball)
    hits = np.array(scene.ray_intersect(_pixel_rays(scene)).is_valid()).sum()
    assert 0 < hits < 256
    counts = scene.integrator().count_rays(scene)
    assert counts == {"camera": 256, "mirror": hits, "shadow": hits}


def _pixel_rays(scene: mi.Scene) -> mi.Ray3f:
    index = dr.arange(mi.UInt32, 256)
    position = mi.Point2f((mi.Float(index % 16) + 0.5) / 16, (mi.Float(index // 16) + 0.5) / 16)
    return scene.sensors()[0].sample_ray(0, 0.5, position, mi.Point2f(0.5))[0]
