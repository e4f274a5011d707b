"""Shapes on which float32 loses most: the rounding model has to know it, and the verdict is good."""

from __future__ import annotations

import math
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from whitted_validation.validation import Here, Verdict, validate

TURN = np.array(
    [[0.8504, -0.3827, 0.3613], [0.4597, 0.8770, -0.1421], [-0.2625, 0.2869, 0.9213]]
)  # nearly a rotation, about no axis of the coordinates

LIGHT = """<emitter type="directional" id="sun"><vector name="direction" value="{sun}"/>
  <rgb name="irradiance" value="1"/></emitter>
  <emitter type="constant" id="sky"><rgb name="radiance" value="0.25, 0.5, 0.75"/></emitter>"""

GLOSSY = """<bsdf type="twosided"><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/>
  <float name="specular_reflectance" value="0.3"/></bsdf></bsdf>"""

PICTURED = """<boolean name="face_normals" value="true"/>
  <bsdf type="twosided"><bsdf type="blinnphong"><texture type="bitmap" name="diffuse_reflectance">
  <string name="filename" value="picture.png"/></texture></bsdf></bsdf>"""


def numbers(vector: np.ndarray) -> str:
    return ", ".join(map(repr, np.asarray(vector, float).tolist()))


def judged(folder: Path, shape: str, middle: np.ndarray, width: float, variant: str) -> Verdict:
    """Look at a shape that lies across TURN's third axis, at a window of this width."""
    origin, target, up, sun = (
        numbers(TURN @ v) for v in (middle - [0, 0, 3], middle, np.array([0, 1, 0]), np.array([0.1, -0.2, 1]))
    )
    (folder / "scene.xml").write_text(
        f"""<scene version="3.0.0"><integrator type="whitted"><rgb name="ambient" value="0.3"/></integrator>
        <sensor type="perspective"><float name="fov" value="{math.degrees(width / 3)!r}"/><transform name="to_world">
        <lookat origin="{origin}" target="{target}" up="{up}"/></transform><film type="hdrfilm">
        <integer name="width" value="24"/><integer name="height" value="18"/><rfilter type="box"/></film></sensor>
        {LIGHT.format(sun=sun)}{shape}</scene>"""
    )
    verdict = validate(folder / "scene.xml", executor=Here(), variant=variant)
    mi.set_log_level(mi.LogLevel.Warn)
    return verdict


@pytest.mark.parametrize("height", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("look", [GLOSSY, PICTURED], ids=["glossy", "pictured"])
def test_weights_in_a_thin_triangle_are_as_inexact_as_it_is_thin(
    llvm_ad_rgb: str, tmp_path: Path, height: float, look: str
) -> None:
    """Normals, or coordinates, change along it only, so that nothing but the weights' own error shows."""
    xs = np.array([-1.0, 1.0, 0.2])
    corners = np.array([xs, [0, 0, height], [0, 0, 0]])
    normals = np.array([0.3 * xs, [0.1] * 3, [-1.0] * 3])
    turned = [(word, row) for word, matrix in (("v", corners), ("vn", normals)) for row in (TURN @ matrix).T.tolist()]
    lines = [f"{word} {x!r} {y!r} {z!r}\n" for word, (x, y, z) in turned]
    lines += [f"vt {0.5 + 0.4 * x!r} 0.5\n" for x in xs.tolist()]
    (tmp_path / "needle.obj").write_text("".join(lines) + "f 1/1/1 2/2/2 3/3/3\n")
    ramp = np.repeat(np.arange(0, 256, 8, dtype=np.uint8)[None, :, None], 4, axis=0)
    mi.Bitmap(ramp).write(str(tmp_path / "picture.png"))
    shape = f'<shape type="obj" id="needle"><string name="filename" value="needle.obj"/>{look}</shape>'
    verdict = judged(tmp_path, shape, np.array([0.2, height / 2, 0]), height / 2, llvm_ad_rgb)
    assert verdict.good, verdict.judgement.differences[:3]
