"""Same scene, same bytes: repeated, on any number of threads, in other processes, and whatever was drawn before."""

import hashlib
import subprocess
import sys

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

# Every kind of shape and light, a mirror, textures, 4 bounces; large enough to be cut into many pieces of work.
SCENE = """
<scene version="3.0.0">
  <integrator type="whitted"><integer name="max_depth" value="6"/><float name="ambient" value="0.1"/></integrator>
  <sensor type="perspective"><float name="fov" value="60"/>
    <film type="hdrfilm"><integer name="width" value="{size}"/><integer name="height" value="{size}"/>
      <string name="component_format" value="float32"/><rfilter type="{rfilter}"/></film></sensor>
  <bsdf type="blinnphong" id="chrome"><float name="diffuse_reflectance" value="0.2"/>
    <float name="specular_reflectance" value="0.7"/><float name="mirror_reflectance" value="0.6"/></bsdf>
  <bsdf type="twosided" id="board"><bsdf type="blinnphong"><texture type="checkerboard" name="diffuse_reflectance">
    <transform name="to_uv"><scale value="16"/></transform></texture>
    <float name="mirror_reflectance" value="0.2"/></bsdf></bsdf>
  <shape type="rectangle"><transform name="to_world"><scale value="8"/><rotate x="1" angle="-90"/>
    <translate y="-1" z="5"/></transform><ref id="board"/></shape>
  <shape type="sphere"><point name="center" value="-1, 0, 5"/><ref id="chrome"/></shape>
  <shape type="sphere"><point name="center" value="1, 0.3, 6"/><ref id="chrome"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="30"/>
    <translate x="1.2" y="-0.5" z="4"/></transform><ref id="chrome"/></shape>
  <shape type="cylinder"><point name="p0" value="0, -1, 7"/><point name="p1" value="0, 1, 7"/>
    <float name="radius" value="0.3"/><ref id="board"/></shape>
  <shape type="polygon"><string name="vertices" value="-3,0,7 -2,0,7 -2,2,7 -2.5,1,7 -3,2,7"/><ref id="board"/></shape>
  <emitter type="point"><point name="position" value="-3, 5, 1"/><float name="intensity" value="20"/></emitter>
  <emitter type="directional"><vector name="direction" value="1, -2, 1"/><float name="irradiance" value="0.4"/>
    </emitter>
  <emitter type="spot"><transform name="to_world"><lookat origin="3, 4, 2" target="0, 0, 5" up="0, 0, 1"/></transform>
    <float name="intensity" value="20"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.2, 0.3, 0.5"/></emitter>
</scene>
"""

IN_A_PROCESS_OF_ITS_OWN = f"""
import hashlib, sys
import mitsuba_whitted
import drjit as dr
import mitsuba as mi
import numpy as np

variant, threads, size, spp, rfilter = sys.argv[1:]
mi.set_variant(variant)
dr.set_thread_count(int(threads))
scene = mi.load_string({SCENE!r}.format(size=size, rfilter=rfilter), optimize=False)
print(hashlib.sha256(np.array(mi.render(scene, spp=int(spp))).tobytes()).hexdigest())
"""


def load(size=96, rfilter="box"):
    return mi.load_string(SCENE.format(size=size, rfilter=rfilter), optimize=False)


def draw(scene, spp=1):
    return np.array(mi.render(scene, spp=spp)).tobytes()


@pytest.fixture
def threads():
    """Set the number of threads, and give it back afterwards."""
    before = dr.thread_count()
    yield dr.set_thread_count
    dr.set_thread_count(before)


@pytest.mark.parametrize("spp", [1, 4])
def test_the_same_scene_gives_the_same_bytes_again(any_variant, spp):
    size = 12 if any_variant == "scalar_rgb" else 96
    scene = load(size)
    first = draw(scene, spp)
    assert all(draw(scene, spp) == first for _ in range(3))
    assert all(draw(load(size), spp) == first for _ in range(2))
    assert len(set(first)) > 16  # it is no empty picture


@pytest.mark.parametrize("rfilter", ["box", "tent", "gaussian"])
@pytest.mark.parametrize("spp", [1, 4])
def test_the_number_of_threads_does_not_matter(llvm_ad_rgb, threads, rfilter, spp):
    # Mitsuba's own tent and gaussian filters add up samples in the order in which threads come.
    pictures = set()
    for count in (1, 2, 3, 1):
        threads(count)
        pictures.add(draw(load(rfilter=rfilter), spp))
    assert len(pictures) == 1


def test_the_number_of_threads_does_not_matter_without_a_compiler(scalar_rgb, threads):
    pictures = set()
    for count in (1, 2):
        threads(count)
        pictures.add(draw(load(16)))
    assert len(pictures) == 1


@pytest.mark.parametrize(
    ("variant", "size", "spp", "rfilter"),
    [("llvm_ad_rgb", 96, 1, "box"), ("llvm_ad_rgb", 48, 4, "gaussian"), ("scalar_rgb", 16, 1, "box")],
)
def test_other_processes_draw_the_same_bytes(request, variant, size, spp, rfilter):
    request.getfixturevalue(variant)
    here = hashlib.sha256(draw(load(size, rfilter), spp)).hexdigest()
    for count in (1, 2):
        arguments = [variant, str(count), str(size), str(spp), rfilter]
        there = subprocess.run(
            [sys.executable, "-c", IN_A_PROCESS_OF_ITS_OWN, *arguments],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        assert here in there.stdout


def test_what_was_drawn_before_does_not_matter(llvm_ad_rgb):
    # Another size and another number of samples of the same scene, another scene, another variant.
    scene = load()
    first = draw(scene)
    draw(scene, 9)
    draw(load(31))
    draw(mi.load_dict({"type": "scene", "integrator": {"type": "whitted"}, "camera": {"type": "perspective"}}))
    mi.set_variant("scalar_rgb")
    draw(load(4))
    mi.set_variant("llvm_ad_rgb")
    assert draw(scene) == first
    assert draw(load()) == first


def test_pictures_in_flight_do_not_disturb_each_other(llvm_ad_rgb):
    scenes = [load(), load(), load(48)]
    alone = [draw(scene) for scene in scenes]
    at_once = [mi.render(scene, spp=1) for scene in scenes]
    assert [np.array(picture).tobytes() for picture in at_once] == alone


def test_a_window_of_the_film_holds_the_bytes_of_the_whole(llvm_ad_rgb):
    # The centre of the film is a whole number of pixels from both corners: the distance from it is exact.
    scene = load()
    whole = np.array(mi.render(scene, spp=1))
    film = mi.traverse(scene.sensors()[0].film())
    film["crop_size"] = (17, 13)
    film["crop_offset"] = (40, 50)
    film.update()
    assert np.array_equal(np.array(mi.render(scene, spp=1)), whole[50:63, 40:57])
