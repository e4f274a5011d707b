"""What is done otherwise where OptiX searches, as far as it can be tried without a GPU."""

from __future__ import annotations

from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_whitted import accel, scene_graph
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.precise import rcp

SCENES = Path(__file__).parents[2] / "scenes"


@pytest.mark.parametrize("name", ["primitives", "instances", "mesh", "many_spheres"])
def test_shapes_told_by_object_are_those_told_by_number(
    llvm_ad_rgb: str, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    # Embree tells both; each kind of shape in the search is among these scenes, ellipsoids and a soup as well.
    file = str(SCENES / f"{name}.xml")
    by_number = np.array(mi.render(mi.load_file(file), spp=1))
    monkeypatch.setattr(accel, "searched_by_optix", lambda: True)
    by_object = np.array(mi.render(mi.load_file(file), spp=1))
    assert by_number.std() > 0
    assert np.array_equal(by_number, by_object)


def test_a_second_group_is_refused_where_nobody_tells_them_apart(
    llvm_ad_rgb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    groups = {name: {"type": "shapegroup", "shape": {"type": "sphere"}} for name in ("one", "two")}
    instances = {f"of_{name}": {"type": "instance", "group": {"type": "ref", "id": name}} for name in groups}
    scene = mi.load_dict({"type": "scene", **groups, **instances})
    monkeypatch.setattr(scene_graph, "searched_by_optix", lambda: True)
    with pytest.raises(SceneError, match=r"2 shape groups: llvm_ad_rgb does not tell which .* use one, or a variant"):
        scene_graph.SceneGraph(scene)


def test_a_double_is_divided_as_numpy_does(any_rgb: str) -> None:
    values = np.random.default_rng(3).uniform(-4, 4, 1000)
    found = np.array(rcp(mi.Float64(values))) if dr.is_jit_v(mi.Float) else [rcp(value) for value in values.tolist()]
    assert np.array_equal(found, 1 / values)
