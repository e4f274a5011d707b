"""What is seen through the middle of a pixel, on a scene that can be followed by hand."""

from __future__ import annotations

from pathlib import Path

import whitted_reference
from whitted_validation.seen import look
from whitted_validation.validation import Here

# Seen from above by parallel rays, pixels a unit wide: x = 2.5 ... -2.5. The lamp stands far to the left of a wall.
SCENE = """<scene version="3.0.0"><integrator type="whitted"/>
  <sensor type="orthographic"><transform name="to_world"><scale x="3" y="3"/>
    <lookat origin="0, 9, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="1"/><rfilter type="box"/></film>
  </sensor>
  <emitter type="directional" id="sun"><vector name="direction" value="1, -1, 0"/><rgb name="irradiance" value="1"/>
  </emitter>
  <emitter type="directional" id="below"><vector name="direction" value="0, 1, 0"/><rgb name="irradiance" value="1"/>
  </emitter>
  <emitter type="spot" id="torch"><float name="cutoff_angle" value="10"/><transform name="to_world">
    <lookat origin="-2.5, 5, 0" target="-2.5, 0, 0" up="0, 0, 1"/></transform></emitter>
  <shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale x="4"/></transform>
    <bsdf type="blinnphong"><rgb name="mirror_reflectance" value="0.5"/></bsdf></shape>
  <shape type="rectangle" id="wall"><transform name="to_world"><scale y="1.9"/><rotate y="1" angle="90"/></transform>
  </shape>
  <shape type="rectangle" id="turned"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.4"/>
    <translate x="2.5" y="3"/></transform></shape></scene>"""


def test_each_pixel_knows_its_object_lights_and_mirrors(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(SCENE)
    seen = look(whitted_reference.load(file), Here())
    objects = [seen.objects[i] for i in seen.object[0]]
    lights = [seen.light_texts[i] for i in seen.lights[0]]
    # Columns run from x = 2.5 on the left to x = -2.5: the camera's left is +x.
    assert objects == ["turned, from behind", "floor", "floor", "floor", "floor", "floor"]
    shadow = "no light; sun behind wall; below below the horizon; torch shines elsewhere"
    sunny = "lit by sun; below below the horizon; torch shines elsewhere"
    assert lights == ["", shadow, shadow, sunny, sunny, "lit by sun, torch; below below the horizon"]
    assert seen.bounces.tolist() == [[0, 1, 1, 1, 1, 1]]
