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


MIRRORS = """<scene version="3.0.0"><integrator type="whitted"><integer name="max_depth" value="8"/></integrator>
  <sensor type="perspective"><float name="fov" value="50"/>
  <float name="principal_point_offset_x" value="PX"/><float name="principal_point_offset_y" value="PY"/>
  <transform name="to_world"><lookat origin="0.3, 0.4, -6" target="0, 0, 0" up="0, 1, 0"/></transform>
  <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/><rfilter type="box"/></film>
  </sensor><emitter type="point" id="lamp"><point name="position" value="2, 4, -5"/></emitter>
  <bsdf type="blinnphong" id="mirror"><float name="mirror_reflectance" value="0.8"/></bsdf>BALLS</scene>"""


@pytest.mark.parametrize(("grid", "offset"), [(3, ("0", "0")), (5, ("0", "0")), (1, ("0.1", "0.0333"))])
def test_mirroring_balls_spread_no_rounding_of_the_place_on_the_film(
    llvm_ad_rgb: str, tmp_path: Path, grid: int, offset: tuple[str, str]
) -> None:
    """Thirds and fifths of a pixel, and a shifted middle, are no single numbers; each mirror magnifies their errors."""
    balls = "".join(
        f'<shape type="sphere" id="ball_{i}"><point name="center" value="{x}, {y}, {z}"/><ref id="mirror"/></shape>'
        for i, (x, y, z) in enumerate([(-1.1, 0, 0), (1.1, 0.1, 0.2), (0, 1.6, 0.9), (0.1, -1.7, 0.8)])
    )
    text = MIRRORS.replace("PX", offset[0]).replace("PY", offset[1]).replace("BALLS", balls)
    (tmp_path / "balls.xml").write_text(text)
    verdict = validate(tmp_path / "balls.xml", executor=Here(), variant=llvm_ad_rgb, grid=grid)
    assert verdict.good, verdict.judgement.differences[:3]


@pytest.mark.parametrize("kind", ["polygon", "obj", "rectangle"])
def test_a_wide_wall_in_a_far_scene_is_where_it_is(llvm_ad_rgb: str, tmp_path: Path, kind: str) -> None:
    """Its corners are not moved to the middle of the scene without a rounding; a mirroring ball shows where it is."""
    away = np.array([7003.3, -5001.7, 3002.1])
    corners = away + np.array([[-900.1, -700.3, 4.7], [800.9, -650.7, 3.3], [850.3, 720.1, 6.1], [-870.7, 690.9, 7.5]])
    corners = corners.astype(np.float32)
    corners[3] = corners[0] + (corners[2] - corners[1])
    if kind == "obj":
        lines = [f"v {x!r} {y!r} {z!r}\n" for x, y, z in corners.astype(float).tolist()]
        (tmp_path / "wall.obj").write_text("".join(lines) + "f 1 2 3\nf 1 3 4\n")
        shape = '<string name="filename" value="wall.obj"/><boolean name="face_normals" value="true"/>'
    elif kind == "polygon":
        ring = " ".join(",".join(map(repr, corner)) for corner in corners.astype(float).tolist())
        shape = f'<string name="vertices" value="{ring}"/>'
    else:
        middle, x, y = corners[[0, 2]].mean(axis=0), (corners[1] - corners[0]) / 2, (corners[3] - corners[0]) / 2
        columns = np.array([x, y, np.cross(x, y), middle], float).T
        matrix = " ".join(map(repr, [*columns.ravel().tolist(), 0, 0, 0, 1]))
        shape = f'<transform name="to_world"><matrix value="{matrix}"/></transform>'
    places = ([0.5, 0.3, -9], [0, 0, 0], [3, 4, -6], [-1.5, 0.5, -2])
    eye, middle, lamp, small = (numbers(away + np.array(v)) for v in places)
    (tmp_path / "far.xml").write_text(
        f"""<scene version="3.0.0"><integrator type="whitted"/><sensor type="perspective"><transform name="to_world">
        <lookat origin="{eye}" target="{middle}" up="0, 1, 0"/></transform><film type="hdrfilm">
        <integer name="width" value="24"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>
        <emitter type="point" id="lamp"><point name="position" value="{lamp}"/>
        <float name="intensity" value="40"/></emitter>
        <bsdf type="twosided" id="mirror"><bsdf type="blinnphong"><float name="mirror_reflectance" value="0.6"/></bsdf>
        </bsdf>
        <shape type="sphere" id="ball"><point name="center" value="{middle}"/><ref id="mirror"/></shape>
        <shape type="sphere" id="small"><point name="center" value="{small}"/><float name="radius" value="0.2"/></shape>
        <shape type="{kind}" id="wall">{shape}<ref id="mirror"/></shape></scene>"""
    )
    verdict = validate(tmp_path / "far.xml", executor=Here(), variant=llvm_ad_rgb)
    assert (np.abs(verdict.judgement.picture).max(axis=2) > 0).mean() > 0.5
    assert verdict.good, verdict.judgement.differences[:3]
