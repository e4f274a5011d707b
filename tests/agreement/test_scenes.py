"""Every shipped scene obeys the rules of the house and is drawn."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from whitted_validation import scene_files

SCENES = scene_files.shipped()
GALLERY = """
    lambert blinn_phong shadows mirror gold whitted_1980 triangles polygons mesh smooth_mesh textured
    hall_of_mirrors inside_mirror_ball many_spheres open_surfaces spot no_light empty orthographic instances
    primitives
"""
NAMED = "integrator sensor sampler film rfilter shape bsdf emitter texture"

every_scene = pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.stem)


def value(node: ET.Element, name: str) -> str | None:
    """Read the parameter of that name."""
    parameter = node.find(f"*[@name='{name}']")
    return None if parameter is None else parameter.get("value")


def test_no_scene_is_missing() -> None:
    assert {scene.stem for scene in SCENES} >= set(GALLERY.split())


@every_scene
def test_everything_has_an_id_of_its_own(scene: Path) -> None:
    root = ET.parse(scene).getroot()
    assert root.get("version") == "3.0.0"
    named = [node for kind in NAMED.split() for node in root.iter(kind)]
    assert [node.attrib for node in named if not node.get("id")] == []
    ids = [node.get("id") for node in named]
    assert sorted(set(ids)) == sorted(ids)


@every_scene
def test_film_and_sampler_are_those_that_comparisons_need(scene: Path) -> None:
    root = ET.parse(scene).getroot()
    (integrator,), (sensor,) = root.findall("integrator"), root.findall("sensor")
    film, sampler = sensor.find("film"), sensor.find("sampler")
    assert integrator.get("type") == "whitted"
    assert film is not None
    assert sampler is not None
    assert film.get("type") == "hdrfilm"
    assert (value(film, "width"), value(film, "height")) == ("512", "512")
    assert (value(film, "pixel_format"), value(film, "component_format")) == ("rgb", "float32")
    assert [node.get("type") for node in film.iter("rfilter")] == ["box"]
    assert value(sampler, "sample_count") == "1"


@every_scene
def test_a_comment_at_the_top_says_what_the_scene_shows(scene: Path) -> None:
    assert scene.read_text().startswith("<!--")
    assert scene_files.purpose(scene).endswith(".")


@every_scene
def test_no_scene_needs_anything_but_its_folder(scene: Path) -> None:
    names = ET.parse(scene).getroot().iterfind(".//string[@name='filename']")
    files = [Path(name.get("value", "")) for name in names]
    assert all((scene.parent / file).is_file() and ".." not in file.parts for file in files)


def test_the_folder_is_small_and_holds_scenes_meshes_and_textures_only() -> None:
    files = [file for file in scene_files.SCENES.rglob("*") if file.is_file()]
    assert {file.suffix for file in files} <= {".xml", ".ply", ".obj", ".png", ".md"}
    assert max(file.stat().st_size for file in files) < 700_000
    assert sum(file.stat().st_size for file in files) < 1_500_000


@every_scene
def test_the_picture_is_finite_and_not_negative(any_variant: str, scene: Path) -> None:
    loaded = mi.load_file(str(scene), optimize=False)
    film = mi.traverse(loaded.sensors()[0].film())
    film["size"] = (24, 24)  # also the size at which the scalar variant ends in a second
    film["crop_size"] = (24, 24)
    film.update()
    picture = np.array(mi.render(loaded, spp=1))
    assert picture.shape[:2] == (24, 24)
    assert np.isfinite(picture).all()
    assert (picture >= 0).all()
    assert picture.max() > 0
