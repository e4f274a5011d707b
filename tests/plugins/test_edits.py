"""No stale picture: whatever is edited through `mi.traverse`, the next picture is that of the edited scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

SCENES = Path(__file__).parents[2] / "scenes"
SIZE = 48

EDITED_SCENES = [
    *("spot", "polygons", "smooth_mesh", "gold", "open_surfaces", "textured", "instances", "orthographic", "mesh"),
    "triangles",
]
"""Between them they have every class of object whose keys `mi.traverse` lists in any scene: see the last test."""


def _loaded(name: str) -> tuple[mi.Scene, mi.SceneParameters]:
    scene = mi.load_file(str(SCENES / f"{name}.xml"), optimize=False)
    parameters = mi.traverse(scene)
    for key in parameters.keys():  # noqa: SIM118  # iterating a SceneParameters yields pairs
        if key.endswith("film.size"):
            parameters[key] = [SIZE, SIZE]
    parameters.update()
    return scene, parameters


def _edited_afresh(name: str, *edits: dict[str, Any]) -> mi.Scene:
    scene, parameters = _loaded(name)
    for edit in edits:
        parameters.update(edit)
    return scene


def _bytes(scene: mi.Scene) -> bytes:
    picture = np.array(mi.render(scene))
    assert np.isfinite(picture).all()
    return bytes(str(picture.shape), "ascii") + picture.tobytes()


def _edited(key: str, value: Any) -> Any:
    """Give another value of the same type that the object accepts."""
    name = key.rsplit(".", 1)[-1]
    if isinstance(value, bool):
        return not value
    if dr.is_array_v(value) and not np.size(np.array(value)):
        return value
    if name == "size":
        return [SIZE + 4, SIZE - 8]
    if name == "crop_size":
        return [SIZE // 2, SIZE // 3]
    if name == "crop_offset":
        return [1, 2]  # with the whole film as crop this is refused: see below
    if name == "faces":
        return type(value)(np.array(value).reshape(-1, 3)[::-1, [0, 2, 1]].ravel())
    if "Transform" in type(value).__name__:
        kind = mi.ScalarTransform3f if "3f" in type(value).__name__ else mi.ScalarTransform4f
        if kind is mi.ScalarTransform3f:
            return type(value)(kind(value.matrix) @ kind().translate([0.11, 0.07]))
        matrix = kind(np.array(value.matrix, float).reshape(4, 4))
        return type(value)(kind().translate([0.02, 0.03, -0.01]) @ matrix)
    if name == "data":  # the texels of a bitmap
        return type(value)(np.ascontiguousarray(np.array(value)[::-1]))
    if name == "vertex_normals":
        normals = np.array(value).reshape(-1, 3) + np.array([0.1, -0.05, 0.02])
        return type(value)((normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32).ravel())
    return value * 0.9 + 0.01


_drawn: set[str] = set()
_changed: set[str] = set()
"""Names of the keys whose edit has changed a picture, over all scenes."""


@pytest.mark.parametrize("name", EDITED_SCENES)
def test_after_every_edit_the_picture_is_that_of_a_scene_loaded_and_edited_afresh(llvm_ad_rgb: str, name: str) -> None:
    scene, parameters = _loaded(name)
    before = _bytes(scene)
    changed = set()
    _drawn.add(name)
    for key in list(parameters.keys()):
        original = type(parameters[key])(parameters[key])
        new = _edited(key, original)
        if key.endswith("crop_offset"):
            size_key = key.replace("crop_offset", "crop_size")
            original_size, new_size = list(parameters[size_key]), [SIZE - 8, SIZE - 8]
            edit, undo = {size_key: new_size, key: new}, {key: original, size_key: original_size}
        else:
            edit, undo = {key: new}, {key: original}
        normals_key = key.replace("vertex_positions", "vertex_normals")
        if normals_key != key:  # else Mitsuba computes them anew, summing in the order of its threads: other bytes
            undo[normals_key] = type(parameters[normals_key])(parameters[normals_key])
            edit[normals_key] = _edited(normals_key, undo[normals_key])
        if key.endswith("film.size"):
            undo[key.replace("film.size", "film.crop_size")] = [SIZE, SIZE]
        expected = _bytes(_edited_afresh(name, edit))
        parameters.update(edit)
        assert _bytes(scene) == expected, f"stale after an edit of {key}"
        if expected != before:
            changed.add(key.rsplit(".", 1)[-1])
        parameters.update(undo)
        set_back = _bytes(scene)
        if set_back != before:  # Mitsuba rounds what it derives from an edited value otherwise than at load
            assert set_back == _bytes(_edited_afresh(name, edit, undo)), f"stale after {key} was set back"
            scene, parameters = _loaded(name)
            assert _bytes(scene) == before
    _changed.update(changed)


def test_the_edits_were_such_that_pictures_changed(llvm_ad_rgb: str) -> None:
    if len(_drawn) < len(EDITED_SCENES):
        pytest.skip("only with all edited scenes before it")
    assert _changed >= {
        *("to_world", "value", "position", "cutoff_angle", "beam_width", "faces", "vertex_positions", "vertex_normals"),
        *("vertex_texcoords", "data", "to_uv", "x_fov", "size", "crop_size", "crop_offset"),
        *("principal_point_offset_x", "principal_point_offset_y"),
    }


def test_the_edited_scenes_hold_every_class_and_key_that_any_scene_holds(llvm_ad_rgb: str) -> None:
    def keys_of(names: list[str]) -> set[tuple[str, str]]:
        return {
            (node.class_name(), key.rsplit(".", 1)[-1])
            for name in names
            for key, (_, _, node, _) in _loaded(name)[1].properties.items()
        }

    assert keys_of([path.stem for path in SCENES.glob("*.xml")]) <= keys_of(EDITED_SCENES)


def _ball(**blinnphong: Any) -> mi.Scene:
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "whitted"},
            "camera": {
                "type": "perspective",
                "film": {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 1},
            },
            "ball": {"type": "sphere", "center": [0, 0, 4], "bsdf": {"type": "blinnphong", **blinnphong}},
            "lamp": {"type": "point", "position": [3, 3, 0], "intensity": 20.0},
            "sky": {"type": "constant", "radiance": 0.25},
        }
    )


def test_a_mirror_that_appears_or_vanishes_is_planned_anew(llvm_ad_rgb: str) -> None:
    scene = _ball()
    parameters = mi.traverse(scene)
    plain = _bytes(scene)
    assert not scene.integrator().plan(scene).mirrors
    parameters["ball.bsdf.mirror_reflectance.value"] = mi.Float(0.5)
    parameters.update()
    assert scene.integrator().plan(scene).mirrors
    assert _bytes(scene) == _bytes(_ball(mirror_reflectance=0.5)) != plain
    parameters["ball.bsdf.mirror_reflectance.value"] = mi.Float(0)
    parameters.update()
    assert _bytes(scene) == plain


def test_two_edits_before_one_picture_both_count(llvm_ad_rgb: str) -> None:
    scene = _ball()
    _bytes(scene)
    parameters = mi.traverse(scene)
    for radius, k_d in ((0.7, 0.2), (0.8, 0.9)):
        parameters["ball.to_world"] = mi.ScalarTransform4f().translate([0, 0, 4]).scale(radius)
        parameters.update()
        parameters["ball.bsdf.diffuse_reflectance.value"] = mi.Float(k_d)
        parameters.update()
    expected = _ball(diffuse_reflectance=0.9)
    again = mi.traverse(expected)
    again["ball.to_world"] = mi.ScalarTransform4f().translate([0, 0, 4]).scale(0.8)
    again.update()
    assert _bytes(scene) == _bytes(expected)


@pytest.mark.parametrize("channel", range(3))
def test_an_edit_of_a_single_channel_is_noticed(llvm_ad_rgb: str, channel: int) -> None:
    colour = [0.2, 0.4, 0.6]

    def ball() -> mi.Scene:
        return _ball(diffuse_reflectance={"type": "rgb", "value": colour})

    scene = ball()
    before = _bytes(scene)
    parameters = mi.traverse(scene)
    key = "ball.bsdf.diffuse_reflectance.value"
    parameters[key][channel] = colour[channel] = 0.9
    parameters.set_dirty(key)
    parameters.update()
    assert _bytes(scene) == _bytes(ball()) != before


def test_another_material_given_to_a_shape_is_noticed(llvm_ad_rgb: str) -> None:
    scene = _ball()
    before = _bytes(scene)
    scene.shapes()[0].set_bsdf(mi.load_dict({"type": "blinnphong", "diffuse_reflectance": 0.1}))
    assert _bytes(scene) == _bytes(_ball(diffuse_reflectance=0.1)) != before


def test_a_shape_shared_by_two_scenes_is_edited_in_both(llvm_ad_rgb: str) -> None:
    first = _ball()
    parts = {"camera": first.sensors()[0], "lamp": first.emitters()[0], "ball": first.shapes()[0]}
    second = mi.load_dict({"type": "scene", "integrator": {"type": "whitted"}, **parts})
    before = _bytes(first), _bytes(second)
    parameters = mi.traverse(first)
    parameters["ball.to_world"] = mi.ScalarTransform4f().translate([0.5, 0, 4])
    parameters.update()
    after = _bytes(first), _bytes(second)
    assert after[0] != before[0]
    assert after[1] != before[1]
    moved = mi.load_dict({"type": "sphere", "center": [0.5, 0, 4], "bsdf": {"type": "blinnphong"}})
    third = mi.load_dict({"type": "scene", "integrator": {"type": "whitted"}, **parts, "ball": moved})
    assert after[1] == _bytes(third)


def test_shapes_keep_their_ids(llvm_ad_rgb: str) -> None:
    scene, _ = _loaded("instances")
    ids = [shape.id() for shape in scene.shapes()]
    _bytes(scene)
    assert [shape.id() for shape in scene.shapes()] == ids


@pytest.mark.parametrize("name", ["whitted_1980", "mirror", "textured"])
def test_an_edited_value_makes_no_new_kernel(llvm_ad_rgb: str, name: str) -> None:
    # By the kernels' hashes: a cache on disk would hide that a second kernel was ever compiled.
    scene, parameters = _loaded(name)
    names = ("value", "to_world", "position", "x_fov")
    keys = [key for key in parameters.keys() if key.rsplit(".", 1)[-1] in names]  # noqa: SIM118
    hashes = set()
    for _ in range(12):
        for key in keys:
            parameters[key] = _edited(key, type(parameters[key])(parameters[key]))
        parameters.update()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.kernel_history_clear()
            dr.eval(mi.render(scene))
            dr.sync_thread()
            kernels = dr.kernel_history([dr.KernelType.JIT])
        hashes |= {kernel["hash"] for kernel in kernels if kernel["size"] == SIZE * SIZE}
    assert len(hashes) == 1
