"""A hit is found in the kernel or by Embree: either way the reference agrees."""

from __future__ import annotations

from pathlib import Path

import pytest

from mitsuba_whitted import surfaces
from whitted_validation import validate


@pytest.mark.parametrize("scene", ["shadows", "mirror", "hall_of_mirrors", "inside_mirror_ball", "open_surfaces"])
def test_few_shapes_are_right_one_by_one_and_searched(
    scene: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one_by_one = validate(scene, size=(48, 36), variant="llvm_ad_rgb", cache=tmp_path)
    monkeypatch.setattr(surfaces, "few_of", lambda _rows, _instanced: [])
    searched = validate(scene, size=(48, 36), variant="llvm_ad_rgb", cache=tmp_path)
    assert one_by_one.good, one_by_one.summary
    assert searched.good, searched.summary
