"""Faults of rounding: what must not be in single precision, and what the judge must know of what is.

Each scene is judged without a fault, when it must be good, and with it, when it must not.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import pytest

from whitted_reference.ray_tree import Recorder
from whitted_validation import alternatives, bounds, scene_files, textures, validation, verdict
from whitted_validation.validation import Here

mi.set_variant("scalar_rgb")  # the plugin's modules name Mitsuba's types

from mitsuba_whitted import precise  # noqa: E402
from mitsuba_whitted.camera import Camera  # noqa: E402
from mitsuba_whitted.surfaces import Surfaces  # noqa: E402

pytestmark = [pytest.mark.slow]

Fault = tuple[Any, str, Callable[[Any], Any]]  # owner, name of a function, and what takes its place

FILM = """<film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/>
  <rfilter type="box"/></film>"""

# Eight mirroring balls in the corners of a cube, and the eye between them: every ball that a ray meets spreads its
# errors several times.
MIRRORS = f"""<scene version="3.0.0"><integrator type="whitted"><integer name="max_depth" value="12"/></integrator>
  <sensor type="perspective"><float name="fov" value="70"/><transform name="to_world">
  <lookat origin="0.03, 0.04, -0.1" target="0.1, 0.2, 1" up="0, 1, 0"/></transform>{FILM}</sensor>
  <emitter type="point" id="lamp"><point name="position" value="0.1, 0.05, -0.2"/></emitter>
  <bsdf type="blinnphong" id="mirror"><float name="mirror_reflectance" value="0.9"/></bsdf>
  {
    "".join(
        f'<shape type="sphere" id="ball{x}{y}{z}"><point name="center" value="{x}, {y}, {z}"/>'
        '<float name="radius" value="0.95"/><ref id="mirror"/></shape>'
        for x in (-1, 1)
        for y in (-1, 1)
        for z in (-1, 1)
    )
}</scene>"""

PICTURE = f"""<scene version="3.0.0"><integrator type="whitted"/><sensor type="perspective"><transform name="to_world">
  <lookat origin="0.3, 0.2, -2" target="0.1, 0, 0" up="0, 1, 0"/></transform>{FILM}</sensor>
  <emitter type="directional" id="sun"><vector name="direction" value="0.2, -0.3, 1"/></emitter>
  <shape type="rectangle" id="wall"><transform name="to_world"><rotate y="1" angle="170"/></transform>
  <bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="textures/planet.png"/>
  <transform name="to_uv"><scale value="PERIODS"/></transform></texture></bsdf></shape></scene>"""

# Its corners are at 3/4, so that its sides would run through the middles of pixels, were 0.53033 and the sine of 45
# degrees not rounded.
DIAMOND = """<scene version="3.0.0"><integrator type="whitted"/><sensor type="orthographic"><transform name="to_world">
  <lookat origin="0, 0, -3" target="0, 0, 0" up="0, 1, 0"/></transform><film type="hdrfilm">
  <integer name="width" value="32"/><integer name="height" value="32"/><rfilter type="box"/></film></sensor>
  <emitter type="constant" id="sky"/><shape type="rectangle" id="diamond"><transform name="to_world">
  <rotate y="1" angle="180"/><rotate z="1" angle="45"/><scale value="0.53033"/></transform></shape></scene>"""


def is_good(folder: Path, text: str) -> bool:
    """Judge a scene, with all faults that there are."""
    shutil.copytree(scene_files.SCENES / "textures", folder / "textures", dirs_exist_ok=True)
    (folder / "scene.xml").write_text(text)
    bounds._tools.cache_clear()
    verdict._witnesses.cache_clear()
    judgement = validation.validate(folder / "scene.xml", executor=Here(), variant="llvm_ad_rgb").judgement
    mi.set_log_level(mi.LogLevel.Warn)
    assert (judgement.picture > 0).any()
    return judgement.good


FAULTS: dict[str, tuple[str, Fault]] = {
    "hit points in single": (
        MIRRORS,
        (Surfaces, "hit", lambda f: lambda *a: (h := f(*a))._replace(p=mi.Point3d(mi.Point3f(h.p)))),
    ),
    "normals in single": (
        MIRRORS,
        (Surfaces, "hit", lambda f: lambda *a: (h := f(*a))._replace(n=mi.Normal3d(mi.Normal3f(h.n)))),
    ),
    "camera rays in single": (
        MIRRORS,
        (Camera, "rays", lambda f: lambda *a: (ray := f(*a))._replace(d=mi.Vector3d(mi.Vector3f(ray.d)))),
    ),
    "mirrored rays in single": (MIRRORS, (precise, "mirrored", lambda f: lambda *a: mi.Vector3f(f(*a)))),
    "texture coordinates in single": (
        PICTURE.replace("PERIODS", "5"),
        (Surfaces, "_texture_coordinates", lambda f: lambda *a: mi.Point2d(mi.Point2f(f(*a)))),
    ),
    # And what the judge does not take into account.
    # A hundred million periods: even in double a texel is then a few thousand roundings wide.
    "no slopes of textures": (PICTURE.replace("PERIODS", "1e8"), (textures.Slopes, "error", lambda _: lambda *a: 0.0)),
    "no doubt of decisions": (DIAMOND, (alternatives.Alternatives, "_doubtful", lambda _: lambda *a: iter(()))),
    "no other decisions tried": (
        DIAMOND,
        (
            Recorder,
            "record",
            lambda f: lambda self, x, y, i=0, j=0, grid=1, flips=frozenset(): f(self, x, y, i, j, grid),
        ),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_rounding_is_caught(
    llvm_ad_rgb: str, fault: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scene, (owner, name, make) = FAULTS[fault]
    assert is_good(tmp_path, scene)
    monkeypatch.setattr(owner, name, make(getattr(owner, name)))
    assert not is_good(tmp_path, scene)
