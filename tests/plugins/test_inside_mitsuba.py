"""The integrator inside Mitsuba: below other integrators, on merged scenes, from its manual page."""

import ast
import re
import textwrap

import mitsuba as mi
import numpy as np

SHINY = """<bsdf type="blinnphong" id="shiny"><float name="diffuse_reflectance" value="0.5"/>
  <float name="specular_reflectance" value="0.25"/><float name="mirror_reflectance" value="0.125"/></bsdf>"""
HALF = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/></bsdf>'
SKY = '<emitter type="constant" id="sky"><float name="radiance" value="8"/></emitter>'
SUN = """<emitter type="directional" id="sun"><vector name="direction" value="0, 0, 1"/>
  <float name="irradiance" value="2"/></emitter>"""
SENSOR = """<sensor type="perspective"><float name="fov" value="90"/><film type="hdrfilm">
  <integer name="width" value="{size}"/><integer name="height" value="{size}"/><rfilter type="box"/></film></sensor>"""


def wall(inside=HALF):
    return f"""<shape type="rectangle" id="wall"><transform name="to_world"><scale value="-64, 64, -64"/>
      <translate z="4"/></transform>{inside}</shape>"""


def inside(kind, parameters):
    return mi.load_string(
        f"""<scene version="3.0.0"><integrator type="{kind}">{parameters}<integrator type="whitted" id="inner">
        <float name="ambient" value="0.125"/></integrator></integrator>
        {SENSOR.format(size=4)}{wall(SHINY)}{SUN}</scene>""",
        optimize=False,
    )


def test_aov_adds_its_channels_to_the_picture(any_rgb):
    # Mitsuba sends random rays here; ambient and diffuse are the same for all of them, the highlight is left below 1.
    scene = inside("aov", '<string name="aovs" value="dist:depth, n:sh_normal"/>')
    picture = np.array(mi.render(scene, spp=4))
    assert picture.shape == (4, 4, 7)
    assert np.all(picture[..., :3] > 0.5 * 0.125 + 0.5 * 2)
    assert np.all(picture[..., :3] <= 0.5 * 0.125 + 0.5 * 2 + 0.25 * 2)
    assert np.all(picture[..., 3] >= 4 * (1 - 4 * 2.0**-24))
    assert np.array_equal(picture[..., 4:], np.broadcast_to([0, 0, -1], (4, 4, 3)))


def test_moment_draws_the_picture_ray_by_ray(llvm_ad_rgb):
    picture = np.array(mi.render(inside("moment", ""), spp=4))
    first = picture[..., :3]
    assert np.all(first > 0.5 * 0.125 + 0.5 * 2)
    assert np.isfinite(picture).all()


def test_sample_follows_a_single_ray(llvm_ad_rgb, scene_of):
    scene = scene_of(wall(SHINY) + SUN + SKY)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, 2)
    rays = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(0, [0, 1], 0), mi.Vector3f(0, 0, [4, -1])))  # no unit length needed
    colour, hit, channels = scene.integrator().sample(scene, sampler, rays)
    assert np.array_equal(np.array(colour), np.repeat([[1 + 0.5 + 1, 8]], 3, axis=0))
    assert np.array_equal(np.array(hit), [True, False])
    assert channels == []


def test_a_scene_that_mitsuba_has_merged_is_the_same_picture(any_rgb, tmp_path):
    floors = "".join(
        f"""<shape type="rectangle" id="floor{i}"><transform name="to_world"><scale value="-1, 1, -1"/>
        <translate x="{3 * i - 3}" z="4"/></transform><ref id="shiny"/></shape>"""
        for i in range(3)
    )
    file = tmp_path / "scene.xml"
    file.write_text(
        f"""<scene version="3.0.0"><integrator type="whitted"/>{SENSOR.format(size=8)}{SHINY}{floors}
        {SUN}{SKY}</scene>"""
    )
    merged, plain = mi.load_file(str(file)), mi.load_file(str(file), optimize=False)
    assert len(merged.shapes()) == 1
    assert len(plain.shapes()) == 3
    pictures = [np.array(mi.render(scene, spp=1)) for scene in (merged, plain)]
    assert np.array_equal(*pictures)
    assert len(np.unique(pictures[0])) > 2


def test_what_no_shape_wears_is_not_looked_at(any_rgb, see):
    unused = """<bsdf type="dielectric" id="glass"/><bsdf type="roughconductor" id="brushed"/>
      <texture type="checkerboard" id="board"/><bsdf type="principled" id="paint"/>"""
    assert np.array_equal(see(wall() + SUN + unused), see(wall() + SUN))


# --------------------------------------------------------------------------------------------------- manual page
def page(scene):
    return textwrap.dedent(type(scene.integrator()).__doc__)


def test_the_manual_pages_xml_loads(any_variant, scene_of):
    snippet = re.search(r"<integrator.*</integrator>", page(scene_of("")), re.DOTALL)[0]
    scene = mi.load_string(f'<scene version="3.0.0">{snippet}{SENSOR.format(size=1)}{wall()}</scene>', optimize=False)
    assert type(scene.integrator()) is type(scene_of("").integrator())
    assert np.all(np.array(mi.render(scene)) > 0)  # it sets an ambient light


def test_the_manual_pages_dictionary_loads(any_variant, scene_of):
    snippet = re.search(r"code-tab:: python\n(.*)", page(scene_of("")), re.DOTALL)[1]
    entries = ast.literal_eval("{" + snippet.strip() + "}")
    assert entries["type"] == "whitted"
    integrator = mi.load_dict(entries)
    assert type(integrator) is type(scene_of("").integrator())


def test_the_manual_page_names_every_parameter(llvm_ad_rgb, scene_of):
    table = page(scene_of(""))
    for name in ("max_depth", "ambient", "falloff", "epsilon", "hide_emitters", "enable_shadows"):
        assert name in table
