"""A failing scene is cut down to what fails."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mitsuba as mi
import pytest

from whitted_validation.random_scenes import cut_down
from whitted_validation.shrink import shrunk
from whitted_validation.validation import Here, validate

mi.set_variant("scalar_rgb")  # the plugin's modules name Mitsuba's types

from mitsuba_whitted import precise  # noqa: E402

TEXT = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/><film type="hdrfilm">
  <integer name="width" value="8"/></film></sensor><shape type="cube" id="a"><transform name="to_world">
  <scale value="2"/><rotate x="1" angle="5"/></transform></shape><shape type="disk" id="b"/>
  <shape type="cube" id="c"/></scene>"""


def test_what_is_not_needed_goes_and_film_and_sensor_stay() -> None:
    tried: list[str] = []

    def fails(text: str) -> bool:
        tried.append(text)
        return "rotate" in text and 'id="c"' in text

    better: list[str] = []
    small = ET.fromstring(shrunk(TEXT, fails, better.append))
    tags = " ".join(element.tag for element in small.iter())
    assert tags == "scene sensor film integer shape transform rotate shape"
    assert [shape.get("id") for shape in small.iter("shape")] == ["a", "c"]
    assert len(better) == 3  # the disk, the scale, the angle of view
    assert all(fails(text) for text in better)


def test_a_scene_of_which_nothing_can_go_stays() -> None:
    whole = shrunk(TEXT, lambda text: text.count("<") == TEXT.count("<"))
    assert [e.attrib for e in ET.fromstring(whole).iter()] == [e.attrib for e in ET.fromstring(TEXT).iter()]


STILL = """<scene version="3.0.0"><integrator type="whitted"><rgb name="ambient" value="0.2"/></integrator>
  <sensor type="perspective"><transform name="to_world"><lookat origin="0, 2, -6" target="0, 0.5, 0" up="0, 1, 0"/>
  </transform><film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/>
  <rfilter type="box"/></film></sensor>
  <emitter type="directional" id="sun"><vector name="direction" value="0.3, -1, 0.5"/></emitter>
  <emitter type="constant" id="sky"/>
  <shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="6"/>
  </transform></shape><shape type="cube" id="box"><transform name="to_world"><translate x="-2.5"/></transform></shape>
  <shape type="sphere" id="ball"><point name="center" value="0, 1, 0"/>
  <bsdf type="blinnphong"><float name="mirror_reflectance" value="0.3"/></bsdf></shape>
  <shape type="disk" id="lid"><transform name="to_world"><translate x="2.5" y="1"/></transform></shape></scene>"""


def test_a_fault_of_the_plugin_leaves_the_shape_that_shows_it(
    llvm_ad_rgb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Balls shaded as if they were a fiftieth greater: of five things one ball is left, and what makes it seen."""
    old = precise.sphere_normal
    monkeypatch.setattr(precise, "sphere_normal", lambda w, d, r, t: old(w, d, 1.02 * r, t))
    file = tmp_path / "still.xml"
    file.write_text(STILL)
    small = cut_down(file, Here(), llvm_ad_rgb)
    left = ET.parse(small).getroot()
    assert [shape.get("type") for shape in left.iter("shape")] == ["sphere"]
    assert left.find("sensor/film") is not None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["still.xml", "still_small.xml"]
    assert not validate(small, executor=Here(), variant=llvm_ad_rgb).good
    monkeypatch.setattr(precise, "sphere_normal", old)
    assert validate(small, executor=Here(), variant=llvm_ad_rgb).good
    mi.set_log_level(mi.LogLevel.Warn)
