"""What a scene does not need is left out: the picture stays the same byte for byte, and the work is really gone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_whitted import integrator, lights, materials, stage, surfaces, tables, trace

Patch = Callable[[pytest.MonkeyPatch], None]

GREY = {"type": "blinnphong", "diffuse_reflectance": 0.5}
SHINY = {**GREY, "specular_reflectance": 0.4, "exponent": 20.0}
FROM_BEHIND = {"type": "rectangle", "flip_normals": True, "bsdf": GREY}
LAMP = {"type": "point", "position": [1, -1, 3], "intensity": 8.0}


def scene(**contents: Any) -> mi.Scene:
    """Put a floor and two balls, or what is given instead, under a lamp."""
    look_at = mi.ScalarTransform4f().look_at
    standard = {
        "floor": {"type": "rectangle", "bsdf": GREY, "to_world": mi.ScalarTransform4f().scale(4)},
        "left": {"type": "sphere", "center": [-0.6, 0, 0.5], "radius": 0.5, "bsdf": GREY},
        "right": {"type": "sphere", "center": [0.6, 0.2, 0.5], "radius": 0.5, "bsdf": GREY},
        "lamp": LAMP,
        "integrator": {"type": "whitted"},
    }
    film = {"type": "hdrfilm", "width": 40, "height": 32, "rfilter": {"type": "box"}}
    camera = {"type": "perspective", "to_world": look_at([0, -4, 2], [0, 0, 0.4], [0, 0, 1]), "film": film}
    kept = {name: value for name, value in (standard | contents).items() if value is not None}
    return mi.load_dict({"type": "scene", "camera": camera, **kept}, optimize=False)


def planned(**fields: Any) -> Patch:
    """Put a part into every kernel, whether the scene needs it or not."""
    plan_of = integrator.plan_of

    def general(*args: Any) -> Any:
        return dataclasses.replace(plan_of(*args), **fields)

    return lambda patch: patch.setattr(integrator, "plan_of", general)


def all_cast(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(stage, "casters", lambda _graph, _rows, numbers, *_: set(numbers))


def with_backs(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(materials, "has_backs", lambda _: True)


def look(of: mi.Scene) -> tuple[np.ndarray, int, dict[str, int]]:
    """Return the picture, the operations of its kernel, and the rays that it took."""
    mi.render(of, spp=1)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        picture = np.array(mi.render(of, spp=1))
        kernels = [kernel for kernel in dr.kernel_history() if kernel["type"] == dr.KernelType.JIT]
    return picture, max(kernel["operation_count"] for kernel in kernels), of.integrator().count_rays(of, spp=1)


SMALLER: dict[str, tuple[dict[str, Any], Patch]] = {
    "no mirror: no loop": ({}, planned(mirrors=True)),
    "no k_s: no half vector, no power": ({}, planned(specular=True)),
    "no ambient light": ({}, planned(ambient=True)),
    "nothing two-sided: no turned normals": ({"floor": FROM_BEHIND}, with_backs),
    "nothing glows": ({}, planned(emission=True)),
    "camera and lights outside of all balls": ({}, planned(inside=True)),
    "a floor under everything throws no shadow": ({}, all_cast),
}


@pytest.mark.parametrize("skip", SMALLER)
def test_the_kernel_is_smaller_and_the_picture_the_same(
    llvm_ad_rgb: str, skip: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    contents, put_back = SMALLER[skip]
    picture, operations, _ = look(scene(**contents))
    put_back(monkeypatch)
    with_all, more_operations, _ = look(scene(**contents))
    assert np.array_equal(picture, with_all)
    assert operations < more_operations


def gathers(of: mi.Scene) -> int:
    """Count how often the kernel of a picture gathers a value for every lane."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        np.array(mi.render(of, spp=1))
        kernels = [kernel for kernel in dr.kernel_history() if kernel["type"] == dr.KernelType.JIT]
    return max(kernel["ir"].getvalue().count("gather") for kernel in kernels)


@pytest.mark.parametrize("alone", [True, False])
def test_few_shapes_and_lights_are_constants_and_nothing_is_gathered(
    llvm_ad_rgb: str, alone: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    contents = {"sky": {"type": "constant"}, "floor": None, "left": None} if alone else {}
    picture, few = look(scene(**contents))[0], gathers(scene(**contents))
    monkeypatch.setattr(tables, "FEW_ROWS", 0)
    monkeypatch.setattr(lights, "UNROLL", 0)
    monkeypatch.setattr(surfaces, "FEW_PLANES", 0)
    with_tables, more = look(scene(**contents))[0], gathers(scene(**contents))
    assert np.array_equal(picture, with_tables)
    assert few == 0 < more


def test_rays_that_meet_nothing_have_one_path_whatever_the_first_shape_wears(llvm_ad_rgb: str) -> None:
    checkered = {**GREY, "diffuse_reflectance": {"type": "checkerboard"}, "mirror_reflectance": 0.2}
    ball = {"type": "sphere", "center": [0, 0, 0.5], "radius": 0.5, "bsdf": checkered}
    of = scene(floor=ball, left=None, right=None, sky={"type": "constant"})
    prepared = of.integrator()._prepare(of, of.sensors()[0])
    lane = dr.arange(mi.UInt32, 40 * 32)
    traced = trace.trace(prepared[0], prepared[2], prepared[1].rays(mi.Float(lane % 40), mi.Float(lane // 40)))
    hit, path = np.array(traced.hit), np.array(traced.path)
    assert 0 < hit.sum() < len(hit)
    assert len(set(path[~hit])) == 1 < len(set(path[hit]))


@pytest.mark.parametrize("bsdf", [GREY, SHINY])
def test_a_light_below_the_horizon_is_a_branch_not_taken(
    llvm_ad_rgb: str, bsdf: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    contents = {"left": {"type": "sphere", "bsdf": bsdf}, "right": None}
    picture, _, rays = look(scene(**contents))
    monkeypatch.setattr(trace.dr, "if_stmt", lambda _args, _condition, do, _else, **_: do())
    without_branch, _, _ = look(scene(**contents))
    assert np.array_equal(picture, without_branch)
    assert 0 < rays["shadow"] < rays["camera"]  # the ball fills the view, and its lower half asks nothing


def test_nothing_asks_for_shadows_outside_the_cone_of_a_spot(llvm_ad_rgb: str, monkeypatch: pytest.MonkeyPatch) -> None:
    to_world = mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    spot = {"type": "spot", "to_world": to_world, "intensity": 30.0, "cutoff_angle": 10.0}
    picture, _, rays = look(scene(lamp=spot))
    sample = lights.Lights._sample
    monkeypatch.setattr(lights.Lights, "_sample", lambda *args: sample(*args)._replace(reaches=mi.Bool(True)))
    asked_everywhere, _, more_rays = look(scene(lamp=spot))
    assert np.array_equal(picture, asked_everywhere)
    assert 0 < rays["shadow"] < more_rays["shadow"] / 2


def test_a_surface_that_reflects_no_light_asks_for_none(llvm_ad_rgb: str) -> None:
    black = {"type": "blinnphong", "diffuse_reflectance": 0.0}
    floor = {"type": "rectangle", "bsdf": black, "to_world": mi.ScalarTransform4f().scale(4)}
    balls = look(scene())[2]["shadow"] - look(scene(floor=floor))[2]["shadow"]
    assert balls > 0  # those of the floor


def test_a_single_ball_asks_for_no_shadow(llvm_ad_rgb: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert look(scene(floor=None, right=None))[2]["shadow"] == 0
    all_cast(monkeypatch)
    assert look(scene(floor=None, right=None))[2]["shadow"] > 0


def test_a_ray_that_nothing_can_come_back_along_is_not_followed(llvm_ad_rgb: str) -> None:
    # A red mirror that sees a green one: what the green one sends on, the red one does not pass.
    def mirror(red: float, green: float) -> dict[str, Any]:
        colour = {"type": "rgb", "value": [red, green, 0]}
        return {"type": "blinnphong", "diffuse_reflectance": 0.1, "mirror_reflectance": colour}

    turned = mi.ScalarTransform4f().translate([0, 0, 2]).rotate([1, 0, 0], 180).scale(4)
    facing = {
        "integrator": {"type": "whitted", "ambient": 0.1},
        "left": None,
        "right": None,
        "floor": {"type": "rectangle", "bsdf": mirror(1, 0), "to_world": mi.ScalarTransform4f().scale(4)},
        "lid": {"type": "rectangle", "bsdf": mirror(0, 1), "to_world": turned},
    }
    ends = look(scene(**facing))[2]["mirror"]
    facing["lid"]["bsdf"] = mirror(1, 1)
    assert 0 < ends < look(scene(**facing))[2]["mirror"]


def test_an_edit_that_needs_what_was_left_out_brings_it_back(llvm_ad_rgb: str) -> None:
    edited = scene()
    before, operations, _ = look(edited)
    parameters = mi.traverse(edited)
    parameters["left.bsdf.mirror_reflectance.value"] = 0.5
    parameters.update()
    after, more_operations, _ = look(edited)
    assert operations < more_operations
    assert not np.array_equal(before, after)
    fresh = {**GREY, "mirror_reflectance": 0.5}
    ball = {"type": "sphere", "center": [-0.6, 0, 0.5], "radius": 0.5, "bsdf": fresh}
    assert np.array_equal(after, look(scene(left=ball))[0])


def test_where_nothing_is_seen_in_mirrors_they_are_not_followed(llvm_ad_rgb: str) -> None:
    mirror = {"type": "blinnphong", "diffuse_reflectance": 0.0, "mirror_reflectance": 0.5}
    dark = scene(left=None, right=None, lamp=None, floor={"type": "rectangle", "bsdf": mirror})
    assert not dark.integrator().plan(dark).mirrors
    assert not look(dark)[0].any()
