"""How far off a triangle a ray starts that leaves it: as far as rounding of that triangle demands, and no farther."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

U = 2.0**-24

SENSOR = """<sensor type="orthographic"><float name="near_clip" value="1e-6"/>
  <transform name="to_world">{view}</transform><film type="hdrfilm">
  <integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>"""


def picture(folder: Path, view: str, mesh: str, sun: str) -> np.ndarray:
    """Draw a white mesh in the light of a sun of irradiance 2."""
    (folder / "mesh.obj").write_text(mesh)
    scene = f"""<scene version="3.0.0"><integrator type="whitted"/>{SENSOR.format(view=view)}
      <emitter type="directional"><vector name="direction" value="{sun}"/><rgb name="irradiance" value="2"/></emitter>
      <shape type="obj"><string name="filename" value="mesh.obj"/><boolean name="face_normals" value="true"/>
      <bsdf type="twosided"><bsdf type="blinnphong"/></bsdf></shape></scene>"""
    (folder / "scene.xml").write_text(scene)
    return np.array(mi.render(mi.load_file(str(folder / "scene.xml"), optimize=False), spp=1))


@pytest.mark.parametrize("size", [1.0, 1e5])
@pytest.mark.parametrize("covered", [True, False])
def test_a_lid_throws_its_shadow_however_large_the_mesh(
    llvm_ad_rgb: str, tmp_path: Path, covered: bool, size: float
) -> None:
    """Over a slope hangs a lid, 1/1024 above it, and the camera looks down from between; far off lies a triangle."""
    corners = [(-1, -1, -1), (1, -1, 1), (1, 1, 1), (-1, 1, -1)]  # z = x
    lid = [(x - 2.0**-10, y, z + 2.0**-10) for x, y, z in corners]
    far = [(size, size, -size), (size, 2 * size, -size), (2 * size, size, -size)]
    mesh = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in [*corners, *lid, *far])
    mesh += "f 1 2 3\nf 1 3 4\nf 9 10 11\n" + covered * "f 5 6 7\nf 5 7 8\n"
    eye = 2.0**-12
    view = f'<scale value="0.25"/><lookat origin="{-eye}, 0, {eye}" target="1, 0, -1" up="0, 1, 0"/>'
    seen = picture(tmp_path, view, mesh, "1, 0, -1")
    # k_d I (n.l) = 1; n, l and the two products round.
    assert (seen == 0).all() if covered else (np.abs(seen - 1) <= 16 * U).all()


def test_a_thin_triangle_does_not_shadow_itself(llvm_ad_rgb: str, tmp_path: Path) -> None:
    """It is 2000 times as long as it is high, and turned so that none of its numbers is exact."""
    turn = np.array(mi.ScalarTransform4f().rotate([1, 2, 3], 33).matrix, float)[:3, :3]
    height = 1e-3
    vertices = np.array([[-1, 0, 0], [1, 0, 0], [0.2, height, 0]]) @ turn.T
    mesh = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist()) + "f 1 2 3\n"
    middle, eye = turn @ [0.2, height / 2, 0], turn @ [0.2, height / 2, -3]
    up = turn @ [0, 1, 0]
    origin, target, upward = (", ".join(map(repr, vector.tolist())) for vector in (eye, middle, up))
    view = f'<scale value="{height / 8}"/><lookat origin="{origin}" target="{target}" up="{upward}"/>'
    sun = ", ".join(map(repr, (turn @ [0.1, -0.2, 1]).tolist()))
    assert (picture(tmp_path, view, mesh, sun) > 0).all()
