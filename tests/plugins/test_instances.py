"""Instances: drawn as what they place, however small, thin or many."""

from __future__ import annotations

import gc
import time
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_whitted.camera import camera_ray
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.surfaces import Surfaces


def _scene(contents: dict[str, Any]) -> mi.Scene:
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "whitted", "ambient": 0.5},
            "camera": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([2, 1.5, 4.5], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 48, "height": 48, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 1},
            },
            "lamp": {"type": "point", "position": [3, 3, 3], "intensity": 20.0},
            **contents,
        }
    )


def _grouped(shape: dict[str, Any], *placed: mi.ScalarTransform4f) -> dict[str, Any]:
    instances = {
        f"instance_{i}": {"type": "instance", "to_world": to_world, "group": {"type": "ref", "id": "group"}}
        for i, to_world in enumerate(placed)
    }
    return {"group": {"type": "shapegroup", "shape": shape}, **instances}


@pytest.mark.parametrize("name", ["sphere", "cube", "rectangle", "disk", "cylinder"])
@pytest.mark.parametrize("exponent", [-12, -4, 0, 8])
def test_an_enlarged_and_shrunk_shape_is_the_shape(llvm_ad_rgb: str, name: str, exponent: int) -> None:
    # Powers of two are exact, so that only the roundings of a hit differ, two times 64 u of values below 4: more only
    # where a ray passes an edge, at most the 1 % of the pixels that the outline of anything here crosses.
    scale = 2.0**exponent
    inner = {"type": name, "to_world": mi.ScalarTransform4f().scale(1 / scale)}
    plain = np.array(mi.render(_scene({"shape": {"type": name}})))
    placed = np.array(mi.render(_scene(_grouped(inner, mi.ScalarTransform4f().scale(scale)))))
    differs = np.abs(plain - placed).max(axis=2) > 2 * 64 * 2.0**-24 * 4
    assert plain.max() > 0
    assert differs.mean() <= 0.01


def test_an_ellipsoid_is_a_stretched_sphere(llvm_ad_rgb: str) -> None:
    # The outline of x^2 / a^2 + y^2 / b^2 + z^2 / c^2 = 1 along z is the ellipse of half-axes a and b.
    a, b, c = np.float32([0.9, 0.3, 0.05]).astype(float).tolist()
    scene = _scene(_grouped({"type": "sphere"}, mi.ScalarTransform4f().scale([a, b, c])))
    surfaces = Surfaces(SceneGraph(scene))
    grid = np.meshgrid(np.linspace(-1, 1, 301), np.linspace(-0.5, 0.5, 301))
    x, y = (axis.ravel().astype(np.float32) for axis in grid)
    ray = camera_ray(mi.Point3f(mi.Float(x), mi.Float(y), mi.Float(3)), mi.Vector3f(0, 0, -1), 0, dr.inf)
    found = surfaces.first_hit(ray, mi.Bool(True))
    hit = surfaces.hit(found, ray, with_uv=False)
    dr.eval(tuple(found), tuple(hit))
    inside = (x.astype(float) / a) ** 2 + (y.astype(float) / b) ** 2
    # Along z nothing but x / a and y / b rounds, each by the inverse of the matrix and the product, then their squares
    # and the sum: 7 u. So near to the outline are only the points of the grid that lie on it, but for their rounding.
    sure = np.abs(inside - 1) > 7 * 2.0**-24
    assert (np.abs(inside[~sure] - 1) <= 4 * 2.0**-24).all()
    assert np.array_equal(np.array(found.valid)[sure], (inside < 1)[sure])
    met = np.array(found.valid) & (inside < 0.9)
    z = c * np.sqrt(1 - inside[met])
    # 16 roundings in the group, of coordinates up to 1 / (1 - 0.9)^(1/2), and back.
    assert np.abs(np.array(hit.p)[2][met] - z).max() <= 2 * 16 * 2.0**-24 * 1 / 0.1**0.5


def test_no_ray_slips_through_an_edge_of_an_instanced_mesh(llvm_ad_rgb: str) -> None:
    # Rays aimed at points on the diagonals of a cube's faces, from outside: each must meet the cube.
    to_world = mi.ScalarTransform4f().rotate([0.36, 0.48, 0.8], 37).scale([0.7, 1.3, 0.9])
    scene = _scene(_grouped({"type": "cube"}, to_world))
    surfaces = Surfaces(SceneGraph(scene))
    matrix = np.array(to_world.matrix, float)
    rng = np.random.default_rng(5)
    count = 100_000
    s = rng.uniform(-0.99, 0.99, count)
    target = matrix[:3, :3] @ np.array([s, rng.choice([-1, 1], count) * s, np.ones(count)])
    origin = matrix[:3, :3] @ np.array([0.3, -0.4, 6.0])
    d = target - origin[:, None]
    d /= np.linalg.norm(d, axis=0)
    ray = camera_ray(mi.Point3f(*map(float, origin)), mi.Vector3f(d.astype(np.float32)), 0, dr.inf)
    found = surfaces.first_hit(ray, mi.Bool(True))
    dr.eval(tuple(found))
    assert np.array(found.valid).all()


def test_two_groups_are_told_apart(any_rgb: str) -> None:
    def look(colour: float) -> dict[str, Any]:
        return {"type": "blinnphong", "diffuse_reflectance": 0.0, "ambient_reflectance": colour}

    scene = _scene(
        {
            "left": {"type": "shapegroup", "shape": {"type": "sphere", "bsdf": look(0.25)}},
            "right": {
                "type": "shapegroup",
                "far": {"type": "disk", "to_world": mi.ScalarTransform4f().translate([0, 0, -9]), "bsdf": look(1.0)},
                "shape": {"type": "cube", "to_world": mi.ScalarTransform4f().scale(0.7), "bsdf": look(0.5)},
            },
            "one": {
                "type": "instance",
                "to_world": mi.ScalarTransform4f().translate([-1, 0, 0]).scale(0.5),
                "group": {"type": "ref", "id": "left"},
            },
            "two": {
                "type": "instance",
                "to_world": mi.ScalarTransform4f().translate([1, 0, 0]),
                "group": {"type": "ref", "id": "right"},
            },
        }
    )
    parameters = mi.traverse(scene)
    parameters["camera.film.size"] = [12, 12]
    parameters.update()
    picture = np.array(mi.render(scene))[..., 0]
    assert {float(value) for value in np.unique(picture)} >= {0.0, 0.125, 0.25}  # I_a = 0.5 times k_a, exactly


@pytest.mark.parametrize("plain", [{}, {"ball": {"type": "sphere", "center": [0.0, 3.0, 0.0], "radius": 0.5}}])
def test_a_group_that_nothing_places_is_not_drawn(any_rgb: str, plain: dict[str, Any]) -> None:
    def seen(contents: dict[str, Any]) -> np.ndarray:
        sky = {"type": "constant"}
        view = {"type": "perspective", "to_world": mi.ScalarTransform4f().look_at([0, 0, 9], [0, 0, 0], [0, 1, 0])}
        film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}
        parts = {"integrator": {"type": "whitted"}, "sensor": {**view, "film": film}, "sky": sky}
        return np.array(mi.render(mi.load_dict({"type": "scene", **parts, **contents}), spp=1))

    group = {"group": {"type": "shapegroup", "member": {"type": "sphere", "radius": 2.0}}}
    assert np.array_equal(seen({**plain, **group}), seen(plain))


def test_many_instances_cost_no_virtual_calls(llvm_ad_rgb: str) -> None:
    # The second picture compiles and calls nothing for each instance: Python's share stays that of a few shapes.
    places = [mi.ScalarTransform4f().translate([i % 20 - 10, i // 20 - 5, 0]).scale(0.2) for i in range(200)]
    scene = _scene(_grouped({"type": "cube"}, *places))
    few = _scene(_grouped({"type": "cube"}, *places[:2]))
    times = []
    for each in (few, scene):
        mi.render(each)
        dr.sync_thread()
        start = time.thread_time()
        mi.render(each)
        times.append(time.thread_time() - start)
        dr.sync_thread()
    assert times[1] < 10 * times[0]  # a call an instance would be a hundred times as much


def test_a_mesh_without_triangles_is_refused_by_name(llvm_ad_rgb: str) -> None:
    scene = _scene({"hollow": mi.Mesh("hollow", 0, 0)})
    with pytest.raises(SceneError, match=r"`hollow`.*no triangle"):
        scene.integrator().render(scene)
    # As long as such a mesh lives Mitsuba draws no scene with shapes: its kernels hold the code of every shape that is
    # alive, and refuse to look things up in an empty array. The traceback of the error keeps it until it is collected.
    del scene
    gc.collect()
