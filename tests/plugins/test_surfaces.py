"""Hits: where they are, with which normals and texture coordinates, and how exact."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_whitted.camera import any_ray
from mitsuba_whitted.few import MOST_ALONE
from mitsuba_whitted.ray import Found
from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.surfaces import Hit, Surfaces

U = 2.0**-24
V = 2.0**-53
SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {"type": "sphere"},
    "rectangle": {"type": "rectangle"},
    "disk": {"type": "disk"},
    "cylinder": {"type": "cylinder"},
    "cube": {"type": "cube"},
}


def _hits(scene: mi.Scene, ray: mi.Ray3f) -> tuple[Found, Hit]:
    surfaces = Surfaces(SceneGraph(scene))
    our_ray = any_ray(ray, mi.Vector3f(0))
    found = surfaces.first_hit(our_ray, mi.Bool(True))
    hit = surfaces.hit(found, our_ray, with_uv=True)
    dr.eval(tuple(found), tuple(hit))  # while the shapes live that Embree asks
    return found, hit


def _unit(vectors: Any) -> Any:
    return np.array(vectors) / np.linalg.norm(vectors, axis=0)


def _rays(count: int, distance: float, seed: int) -> mi.Ray3f:
    """Rays from a sphere of radius `distance` to points of the unit ball about the origin."""
    rng = np.random.default_rng(seed)
    origin = rng.normal(size=(3, count))
    origin *= distance / np.linalg.norm(origin, axis=0)
    target = rng.uniform(-0.9, 0.9, size=(3, count))
    d = target - origin
    d /= np.linalg.norm(d, axis=0)
    return mi.Ray3f(mi.Point3f(origin.astype(np.float32)), mi.Vector3f(d.astype(np.float32)))


def _rotation() -> mi.ScalarTransform4f:
    axis = np.array([1.0, 2.0, -1.0])
    return mi.ScalarTransform4f().rotate(list(axis / np.linalg.norm(axis)), 40)


@pytest.mark.parametrize("placed", ["plain", "turned", "mirrored", "instance", "mirrored instance"])
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_a_hit_is_where_mitsuba_has_it(llvm_ad_rgb: str, name: str, flip: bool, placed: str) -> None:
    # Both sides round: Mitsuba's point and ours are each off by at most 16 roundings of the distance (5 here,
    # coordinates included) along the ray and, by the slope of the surface, 1/cos times that across; only hits with
    # cos > 0.1 are compared. A normal turns by at most the same over the smallest radius, 0.5.
    bound = 2 * 16 * U * 5 / 0.1 / 0.5
    to_world = _rotation() if placed != "plain" else mi.ScalarTransform4f()
    if "mirrored" in placed:
        to_world = to_world @ mi.ScalarTransform4f().scale([1, -1, 1])
    to_world = to_world @ mi.ScalarTransform4f().scale(0.8)
    shape = dict(SHAPES[name])
    if flip:
        shape["flip_normals"] = True
    if "instance" in placed:
        contents = {
            "group": {"type": "shapegroup", "other": {"type": "rectangle", "to_world": _far_away()}, "member": shape},
            "instance": {"type": "instance", "to_world": to_world, "group": {"type": "ref", "id": "group"}},
        }
    else:
        contents = {"shape": {**shape, "to_world": to_world}, "other": {"type": "sphere", "to_world": _far_away()}}
    scene = mi.load_dict({"type": "scene", **contents})
    ray = _rays(4000, 4.0, seed=7)
    found, hit = _hits(scene, ray)
    si = scene.ray_intersect(ray)
    assert np.array_equal(np.array(found.valid), np.array(si.is_valid()))
    safe = np.array(si.is_valid() & (dr.abs(dr.dot(si.n, ray.d)) > 0.1))
    assert safe.sum() > 200

    n_g = _unit(np.array(hit.n_g)[:, safe])
    their_n_g = np.array(si.n)[:, safe]
    n, their_n = _unit(np.array(hit.n)[:, safe]), np.array(si.sh_frame.n)[:, safe]
    their_n_g *= np.sign((their_n_g * their_n).sum(axis=0))  # the model turns it to the side of n
    assert np.abs(np.array(hit.p)[:, safe] - np.array(si.p)[:, safe]).max() <= bound
    assert np.abs(n_g - their_n_g).max() <= bound
    assert np.abs(n - their_n).max() <= bound
    uv_error = np.abs(np.array(hit.uv)[:, safe] - np.array(si.uv)[:, safe])
    wrapped = np.minimum(uv_error, np.abs(1 - uv_error))  # u = 0 and u = 1 are one line of a sphere
    # A coordinate changes by at most as much as the point in the shape's own space, 0.8 times as large outside; an
    # azimuth by that over 2 pi times the distance from the axis.
    axis = 1.0 if name in ("rectangle", "cube") else _from_axis(to_world, np.array(hit.p)[:, safe])
    assert (wrapped <= bound / 0.8 / np.minimum(axis, 1)).all()


def _from_axis(to_world: mi.ScalarTransform4f, p: np.ndarray) -> np.ndarray:
    local = np.linalg.inv(np.array(to_world.matrix, float)) @ np.array([*p, np.ones(p.shape[1])])
    distance: np.ndarray = np.hypot(local[0], local[1])
    return distance


@pytest.mark.parametrize("name", ["sphere", "rectangle", "disk", "cylinder"])
def test_texture_coordinates_are_those_of_the_hit_point_in_double(llvm_ad_rgb: str, name: str) -> None:
    to_world = mi.ScalarTransform4f().translate([0.1, 0.2, -0.3]) @ _rotation() @ mi.ScalarTransform4f().scale(0.7)
    scene = mi.load_dict({"type": "scene", "shape": {**SHAPES[name], "to_world": to_world}})
    found, hit = _hits(scene, _rays(4000, 4.0, seed=9))
    met = np.array(found.valid)
    assert met.sum() > 200
    matrix = np.array(to_world.matrix, np.float32).astype(float)
    off = np.array(hit.p, float)[:, met] - matrix[:3, 3, None]
    if name in ("rectangle", "disk"):
        x, y, z = np.linalg.solve(matrix[:3, :3], off)
    else:  # angles about the columns of the matrix; about those of a tube, what of them is square to its axis
        axes = matrix[:3, :3] / 0.7
        if name == "cylinder":
            along = axes[:, 2] / (axes[:, 2] @ axes[:, 2])
            axes[:, :2] -= np.outer(along, axes[:, 2] @ axes[:, :2])
            axes[:, 2] = along
        x, y, z = axes.T @ off / 0.7
    turn, radius = np.arctan2(y, x) / (2 * np.pi) % 1, np.hypot(x, y)
    expected = {
        "sphere": (turn, np.arctan2(radius, z) / np.pi),
        "rectangle": ((x + 1) / 2, (y + 1) / 2),
        "disk": (radius, turn),
        "cylinder": (turn, z),
    }[name]
    # On both sides LOCAL and COORDINATE of `whitted_validation.roundoffs`, of a size of at most sqrt 3.
    limit = 2 * V * (12 * np.sqrt(3) / np.minimum(radius, 1) + 16)
    error = np.abs(np.array(hit.uv, float)[:, met] - np.array(expected))
    assert (np.minimum(error, 1 - error) <= limit).all()


def _far_away() -> mi.ScalarTransform4f:
    return mi.ScalarTransform4f().translate([50, 50, 50])


@pytest.mark.parametrize("radii_away", [3, 100, 1e4])
def test_the_normal_of_a_sphere_does_not_lose_digits_with_distance(llvm_ad_rgb: str, radii_away: float) -> None:
    # In double on both sides. The foot f of the perpendicular carries at most 7 roundings (d 2, difference 1, product
    # 3, sum 1) of the distance; half a chord the same by |f| / chord <= 2 for the hits kept here, and 4 of its own.
    # So 21 v of the distance and 4 of the radius, the foot computed here as much again.
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere"}})
    rng = np.random.default_rng(3)
    direction = rng.normal(size=(3, 4000))
    origin = (direction / np.linalg.norm(direction, axis=0) * radii_away).astype(np.float32).astype(np.float64)
    inside = rng.normal(size=(3, 4000))
    d = inside / np.linalg.norm(inside, axis=0) * rng.uniform(0, 0.85, 4000) - origin
    d = (d / np.linalg.norm(d, axis=0)).astype(np.float32).astype(np.float64)
    found, hit = _hits(scene, mi.Ray3f(mi.Point3f(origin), mi.Vector3f(d)))

    unit = d / np.linalg.norm(d, axis=0)
    foot = origin - (origin * unit).sum(axis=0) * unit
    off = np.linalg.norm(foot, axis=0)
    kept = np.array(found.valid) & (off < 0.89)
    assert kept.sum() > 1000
    exact = foot - np.sqrt(np.maximum(1 - off**2, 0)) * unit
    assert np.abs(np.array(hit.n) - exact)[:, kept].max() <= 2 * (21 * radii_away + 4) * V


def test_a_point_on_a_plane_is_on_the_plane_however_far_the_ray_came(llvm_ad_rgb: str) -> None:
    to_world = mi.ScalarTransform4f().translate([0.3, -0.2, 0.1]) @ _rotation() @ mi.ScalarTransform4f().scale(3)
    scene = mi.load_dict({"type": "scene", "floor": {"type": "rectangle", "to_world": to_world}})
    matrix = np.array(to_world.matrix, np.float32).astype(float)
    normal = _unit(np.cross(matrix[:3, 0], matrix[:3, 1]))
    for distance in (4.0, 1e3, 1e5):
        ray = _rays(4000, distance, seed=5)
        found, hit = _hits(scene, ray)
        p = np.array(hit.p, float)[:, np.array(found.valid)]
        assert p.shape[1] > 500
        off = np.abs(normal @ (p - matrix[:3, 3, None]))
        # Distance from the plane 5 roundings, slope 6, both of what n and the ray's coordinates make of the distance
        # (`whitted_validation.roundoffs`); the point 2 and the product here 4, of coordinates below 5.
        assert off.max() <= 3 * (11 * (distance + 5) + 6 * 5) * V


def test_faces_have_the_normal_of_their_exact_vertices(llvm_ad_rgb: str) -> None:
    # A sliver of aspect ratio 1e-5: from float32 edges its normal would be off by u / 1e-5.
    mesh = mi.Mesh("sliver", 3, 1)
    vertices = np.array([[0, 0, 0], [1, 0.3, 0.2], [0.5, 0.15 + 1e-5, 0.1]], np.float32)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = vertices.ravel()
    parameters["faces"] = np.array([0, 1, 2], np.uint32)
    parameters.update()
    scene = mi.load_dict({"type": "scene", "mesh": mesh})
    exact = np.cross(*(vertices[1:].astype(float) - vertices[0].astype(float)))
    exact /= np.linalg.norm(exact)
    centre = vertices.astype(float).mean(axis=0)
    ray = mi.Ray3f(mi.Point3f((centre + 2 * exact)[:, None]), mi.Vector3f(-exact[:, None]))
    found, hit = _hits(scene, ray)
    assert np.array(found.valid).all()
    # Edges are exact; products, their difference, the squares and the root of a unit vector: on both sides.
    assert np.abs(np.array(hit.n).ravel() - exact).max() <= 2 * 8 * V / 1e-5


@pytest.mark.parametrize("name", ["sphere", "cylinder"])
def test_a_round_surface_seen_from_outside_faces_whoever_sees_it(llvm_ad_rgb: str, name: str) -> None:
    # Rays within a few u of the outline of radius 1, where Embree's hit may lie beside the exact surface.
    scene = mi.load_dict({"type": "scene", "shape": {"type": name}})
    rng = np.random.default_rng(11)
    count = 200_000
    turn, tilt = rng.uniform(0, 2 * np.pi, count), rng.uniform(-0.5, 0.5, count)
    side = np.array([np.cos(turn), np.sin(turn), np.zeros(count)])
    ahead = np.array([-np.sin(turn) * np.cos(tilt), np.cos(turn) * np.cos(tilt), np.sin(tilt)])
    touching = side * (1 + rng.uniform(-8, 8, count) * U) + np.array([0, 0, 0.5])[:, None] * (name == "cylinder")
    ray = mi.Ray3f(mi.Point3f((touching - 2 * ahead).astype(np.float32)), mi.Vector3f(ahead.astype(np.float32)))
    found, hit = _hits(scene, ray)
    met = np.array(found.valid)
    assert 1000 < met.sum() < count
    # Two thirds of the tube's rays come from outside; the others leave it through an open end.
    assert (np.array(dr.dot(hit.n, any_ray(ray, mi.Vector3f(0)).d))[met] < 0).all()


def test_an_arc_tangent_in_double_is_off_by_eight_roundings_at_most(llvm_ad_rgb: str) -> None:
    # What the rounding model takes Dr.Jit's polynomial for, that of numpy included.
    y, x = np.random.default_rng(0).normal(size=(2, 1_000_000))
    ours, exact = np.array(dr.atan2(mi.Float64(y), mi.Float64(x))), np.arctan2(y, x)
    assert np.abs(ours / exact - 1).max() <= 8 * V


@pytest.mark.parametrize(("other", "alike"), [({"type": "sphere"}, False), ({"type": "cube"}, True)])
def test_embree_is_told_that_rays_are_alike_but_where_it_holds_only_spheres(
    llvm_ad_rgb: str, monkeypatch: pytest.MonkeyPatch, other: dict[str, Any], alike: bool
) -> None:
    spheres = {f"ball_{i}": {"type": "sphere", "center": [3 * i, 0, 0]} for i in range(MOST_ALONE)}
    scene = mi.load_dict({"type": "scene", **spheres, "other": {**other, "to_world": _far_away()}})
    asked = mi.Scene.ray_intersect_preliminary
    told = []

    def ask(self: Any, ray: Any, *, coherent: bool, active: Any) -> Any:
        told.append(coherent)
        return asked(self, ray, coherent=coherent, active=active)

    monkeypatch.setattr(mi.Scene, "ray_intersect_preliminary", ask)
    _hits(scene, _rays(4, 4.0, seed=1))
    assert told == [alike]
