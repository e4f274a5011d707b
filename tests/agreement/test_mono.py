"""Monochrome variants: the same scene with every colour replaced by its luminance."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

import whitted_reference
from whitted_reference import scene
from whitted_reference.float32 import LUMINANCE
from whitted_validation import scene_files
from whitted_validation.cli import run
from whitted_validation.random_scenes import write
from whitted_validation.validation import Here, validate

COLOURS = ["0.5, 0.25, 0.75", "0.1, 0.7, 0.3", "1, 1, 1", "0.123456789, 0.2, 0.987654321", "0.3"]


@pytest.mark.parametrize("colour", COLOURS)
def test_a_colour_becomes_the_number_that_mitsuba_reads(llvm_ad_mono: str, colour: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(
        f"""<scene version="3.0.0"><sensor type="perspective"/>
        <shape type="sphere" id="ball"><bsdf type="diffuse">
        <rgb name="reflectance" value="{colour}"/></bsdf></shape></scene>"""
    )
    shape = whitted_reference.load(file, grey=True).shapes[0]
    assert isinstance(shape, scene.Sphere)
    assert isinstance(shape.look.material, scene.Diffuse)
    theirs = mi.traverse(mi.load_file(str(file), optimize=False))
    assert shape.look.material.reflectance == (float(theirs["ball.bsdf.reflectance.value"][0]),) * 3


@pytest.mark.parametrize("name", ["whitted_1980", "textured", "spot"])
def test_a_shipped_scene_is_judged_in_grey(
    llvm_ad_mono: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run(["validate", name, "-m", llvm_ad_mono, "--size", "32x32"]) == 0
    mi.set_log_level(mi.LogLevel.Warn)


@pytest.mark.parametrize("seed", range(2000, 2006))
def test_a_random_scene_has_no_unexplained_pixel_in_grey(llvm_ad_mono: str, seed: int, tmp_path: Path) -> None:
    verdict = validate(write(tmp_path, seed, 24, 18)[0], executor=Here(), variant=llvm_ad_mono)
    mi.set_log_level(mi.LogLevel.Warn)
    assert verdict.good, verdict.judgement.differences[:3]


def test_the_luminance_of_the_coloured_picture_is_another_picture(llvm_ad_mono: str, tmp_path: Path) -> None:
    """It is not what `mono` could be compared with: of two mirrors in colour the product counts."""
    verdict = validate(scene_files.find("gold"), size=(24, 24), executor=Here(), variant="llvm_ad_rgb")
    grey = verdict.judgement.picture @ np.array(LUMINANCE)
    np.save(tmp_path / "grey.npy", np.repeat(grey[:, :, None], 3, axis=2))
    other = validate(
        scene_files.find("gold"), size=(24, 24), executor=Here(), variant=llvm_ad_mono, against=tmp_path / "grey.npy"
    )
    mi.set_log_level(mi.LogLevel.Warn)
    assert not other.good
