"""What the integrator does not draw it refuses: one line that names the object, and what is wrong with it."""

import dataclasses
import re

import mitsuba as mi
import numpy as np
import pytest

from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.materials import Materials
from mitsuba_whitted.scene_graph import SceneGraph

NAN, INFINITE = float("nan"), float("inf")
HALF = '<bsdf type="blinnphong" id="half"/>'
SPHERE = '<shape type="sphere" id="egg"><transform name="to_world"><translate z="4"/></transform>{bsdf}</shape>'


def worn(bsdf):
    return SPHERE.format(bsdf=bsdf)


def reflecting(texture):
    return worn(f'<bsdf type="blinnphong" id="paint">{texture}</bsdf>')


def message_of(error):
    """Give the plugin's own message: `mi.render` wraps errors in one of its own where it records for derivatives."""
    return str(error.__cause__ or error)


def refused(see, *arguments, names, says="", **kwargs):
    """Check that drawing is refused in one line that holds the names, each in backticks, and the words."""
    with pytest.raises((ValueError, RuntimeError)) as caught:
        see(*arguments, **kwargs)
    message = message_of(caught.value)
    assert "\n" not in message.strip(), message
    for name in names:
        assert f"`{name}`" in message, message
    assert re.search(says, message), message


# ------------------------------------------------------------------------------------------------------ materials
OTHER_BSDFS = [
    '<bsdf type="dielectric" id="odd"/>',
    '<bsdf type="thindielectric" id="odd"/>',
    '<bsdf type="roughconductor" id="odd"/>',
    '<bsdf type="roughdielectric" id="odd"/>',
    '<bsdf type="plastic" id="odd"/>',
    '<bsdf type="roughplastic" id="odd"/>',
    '<bsdf type="principled" id="odd"/>',
    '<bsdf type="null" id="odd"/>',
    '<bsdf type="conductor" id="odd"><string name="material" value="Au"/></bsdf>',
    '<bsdf type="mask" id="odd"><bsdf type="diffuse"/></bsdf>',
    f'<bsdf type="blendbsdf" id="odd"><float name="weight" value="0.5"/>{2 * HALF.replace("half", "")}</bsdf>',
]


@pytest.mark.parametrize("bsdf", OTHER_BSDFS, ids=lambda bsdf: bsdf.split('"')[1])
def test_other_materials_are_refused_by_name(any_rgb, see, bsdf):
    refused(see, worn(bsdf), names=["odd", "egg"])


def test_other_materials_are_refused_inside_twosided(any_variant, see):
    nested = '<bsdf type="roughconductor" id="odd"/>'
    refused(see, worn(f'<bsdf type="twosided" id="pair">{HALF}{nested}</bsdf>'), names=["egg"], says="odd|pair")


def test_other_materials_are_refused_inside_instances(llvm_ad_rgb, see):
    group = f"""<shape type="shapegroup" id="group">{worn('<bsdf type="plastic" id="odd"/>')}</shape>
      <shape type="instance" id="copy"><ref id="group"/></shape>"""
    refused(see, group, names=["odd"])


@pytest.mark.parametrize(
    ("texture", "says"),
    [
        ('<float name="diffuse_reflectance" value="1.5"/>', "diffuse_reflectance.*1.5"),
        ('<rgb name="specular_reflectance" value="0, -0.25, 0"/>', "specular_reflectance.*-0.25"),
        ('<float name="mirror_reflectance" value="nan"/>', "mirror_reflectance.*nan"),
        ('<float name="exponent" value="-1"/>', "exponent.*-1"),
        ('<float name="exponent" value="2e7"/>', "exponent.*(2e.07|20000000)"),
    ],
)
def test_coefficients_out_of_range_are_refused(any_rgb, scene_of, texture, says):
    # Already when the scene is loaded: Mitsuba wraps the message in its own.
    with pytest.raises(RuntimeError, match=says) as caught:
        scene_of(reflecting(texture))
    assert "`paint`" in str(caught.value)


def test_diffuse_and_conductor_are_held_to_the_same_range(any_rgb, see):
    for kind, name in (("diffuse", "reflectance"), ("conductor", "specular_reflectance")):
        scene = worn(f'<bsdf type="{kind}" id="odd"><float name="{name}" value="1.5"/></bsdf>')
        refused(see, scene, names=["odd"], says="1.5")


@pytest.mark.parametrize(
    ("kind", "to_uv", "says"),
    [
        ("bitmap", [0, 3], "bitmap whose to_uv is singular"),
        ("bitmap", [np.inf, 3], "to_uv that is not finite"),
        ("checkerboard", [np.nan, 3], "to_uv that is not finite"),
    ],
)
def test_textures_that_are_nowhere_are_refused(llvm_ad_rgb, kind, to_uv, says):
    texture = {"type": kind, "to_uv": mi.ScalarTransform3f().scale(to_uv)}
    if kind == "bitmap":
        texture["bitmap"] = mi.Bitmap(np.zeros((2, 2, 3), np.float32))
    bsdf = {"type": "blinnphong", "diffuse_reflectance": texture, "id": "paint"}
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere", "bsdf": bsdf}})
    with pytest.raises(SceneError, match=f"`paint`.*diffuse reflectance has a {says}"):
        Materials(SceneGraph(scene))


# --------------------------------------------------------------------------------------------------------- shapes
def drawn(*things):
    """Draw a scene of dictionaries."""
    film = {"type": "hdrfilm", "width": 1, "height": 1, "filter": {"type": "box"}}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "whitted"},
            "camera": {"type": "perspective", "film": film},
            **dict(things),
        },
        optimize=False,
    )
    return np.array(mi.render(scene, spp=1))


def test_curves_are_refused(llvm_ad_rgb, see, tmp_path):
    (tmp_path / "curve.txt").write_text("-1 0 4 0.1\n0 0 4 0.1\n1 0 4 0.1\n2 0 4 0.1\n")
    for kind in ("linearcurve", "bsplinecurve"):
        body = f"""<shape type="{kind}" id="hair"><string name="filename" value="{tmp_path}/curve.txt"/></shape>"""
        refused(see, body, names=["hair"])


def test_signed_distance_grids_are_refused(llvm_ad_rgb):
    grid = {
        "type": "sdfgrid",
        "id": "cloud",
        "grid": mi.TensorXf(np.linspace(-1, 1, 8, dtype=np.float32).reshape(2, 2, 2, 1)),
    }
    with pytest.raises(RuntimeError) as caught:
        drawn(("cloud", grid))
    assert "`cloud`" in message_of(caught.value)


@pytest.mark.parametrize("radius", [0, INFINITE, NAN])
def test_a_ball_without_a_proper_radius_is_refused(any_rgb, see, radius):
    body = f'<shape type="sphere" id="egg"><float name="radius" value="{radius}"/></shape>'
    refused(see, body, names=["egg"])


@pytest.mark.parametrize("kind", ["sphere", "rectangle", "disk", "cube", "cylinder"])
@pytest.mark.parametrize("element", ['<scale value="1, 0, 1"/>', '<translate x="nan"/>', '<translate x="inf"/>'])
def test_a_singular_or_infinite_to_world_is_refused(llvm_ad_rgb, scene_of, kind, element):
    # Mitsuba itself refuses some of these while it loads, without the id.
    body = f'<shape type="{kind}" id="egg"><transform name="to_world">{element}</transform></shape>'
    with pytest.raises((ValueError, RuntimeError)) as caught:
        np.array(mi.render(scene_of(body), spp=1))
    message = message_of(caught.value)
    assert "`egg`" in message or "parser.cpp" in message


PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 4
1 0 4
0 {y} 4
3 0 1 2
"""


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_mesh_with_a_vertex_that_is_no_number_is_refused(any_rgb, scene_of, tmp_path, value):
    # Mitsuba may refuse the file while it loads, and names it then; a vertex may also be edited later.
    (tmp_path / "bad.ply").write_text(PLY.format(y=value))
    (tmp_path / "good.ply").write_text(PLY.format(y=1))
    body = f'<shape type="ply" id="egg"><string name="filename" value="{tmp_path}/{{}}.ply"/></shape>'
    with pytest.raises((ValueError, RuntimeError)) as caught:
        np.array(mi.render(scene_of(body.format("bad")), spp=1))
    assert re.search("`egg`|bad.ply", message_of(caught.value))

    scene = scene_of(body.format("good"))
    parameters = mi.traverse(scene)
    positions = np.array(parameters["egg.vertex_positions"])
    positions[4] = float(value)
    parameters["egg.vertex_positions"] = type(parameters["egg.vertex_positions"])(positions)
    parameters.update()
    with pytest.raises((ValueError, RuntimeError)) as caught:
        np.array(mi.render(scene, spp=1))
    assert "`egg`" in message_of(caught.value)


def test_triangles_without_area_are_allowed_and_never_hit(any_rgb, see, tmp_path):
    (tmp_path / "flat.obj").write_text("v -1 0 4\nv 1 0 4\nv 0 0 4\nv 0 1 4\nf 1 2 3\nf 1 1 4\n")
    body = f"""<shape type="obj" id="flat"><string name="filename" value="{tmp_path}/flat.obj"/>{HALF}</shape>
      <emitter type="constant" id="sky"><float name="radiance" value="2"/></emitter>"""
    assert np.all(see(body, size=(3, 3)) == 2)


# --------------------------------------------------------------------------------------------------------- lights
@pytest.mark.parametrize(
    ("kind", "parameter"), [("point", "intensity"), ("directional", "irradiance"), ("spot", "intensity")]
)
@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_a_light_of_no_proper_strength_is_refused(any_rgb, see, kind, parameter, value):
    body = f'<emitter type="{kind}" id="lamp"><rgb name="{parameter}" value="1, {value}, 1"/></emitter>'
    refused(see, body, names=["lamp"], says=parameter)


@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_a_background_of_no_proper_strength_is_refused(any_rgb, see, value):
    body = f'<emitter type="constant" id="sky"><rgb name="radiance" value="1, {value}, 1"/></emitter>'
    refused(see, body, names=["sky"])


@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_an_area_light_of_no_proper_strength_is_refused(any_rgb, see, value):
    glow = f'<emitter type="area" id="glow"><rgb name="radiance" value="1, {value}, 1"/></emitter>'
    refused(see, worn(glow), names=[], says="`glow`|`egg`")


def test_a_point_light_nowhere_is_refused(any_rgb, see):
    body = '<emitter type="point" id="lamp"><point name="position" value="0, nan, 0"/></emitter>'
    refused(see, body, names=["lamp"])


def test_a_slide_projected_by_a_spot_light_is_refused(any_rgb, see):
    body = """<emitter type="spot" id="lamp"><texture type="checkerboard" name="texture" id="slide"/></emitter>"""
    refused(see, body, names=["lamp"], says="texture")


# ------------------------------------------------------------------------------------------------------- sensors
@pytest.mark.parametrize("scale", ["2, 2, 2", "1, 1, 1.002", "1, 0.99, 1"])
def test_a_camera_that_is_scaled_is_refused(any_rgb, see, scale):
    # By Mitsuba itself.
    scaled = PERSPECTIVE.replace("{film}", f'<transform name="to_world"><scale value="{scale}"/></transform>{{film}}')
    with pytest.raises((ValueError, RuntimeError), match=r"[Ss]cale"):
        see("", sensor=scaled)


def test_a_camera_scaled_by_less_than_a_thousandth_is_allowed(any_rgb, see):
    # Mitsuba compares the squared length, so that 1.0004 is the next below its limit.
    scaled = PERSPECTIVE.replace("{film}", '<transform name="to_world"><scale value="1.0004"/></transform>{film}')
    assert np.all(see("", sensor=scaled) == 0)


PERSPECTIVE = '<sensor type="perspective" id="camera">{film}</sensor>'


# ---------------------------------------------------------------------------------------------------- parameters
@pytest.mark.parametrize(
    ("parameter", "says"),
    [
        ('<integer name="max_depth" value="-2"/>', "integrator `.*max_depth -2.*-1"),
        ('<string name="falloff" value="linear"/>', "falloff .linear.*inverse_square.*none"),
        ('<float name="epsilon" value="0"/>', "epsilon 0.*above 0"),
        ('<float name="epsilon" value="-0.001"/>', "epsilon -0.001.*above 0"),
        ('<float name="epsilon" value="nan"/>', "epsilon nan"),
        ('<float name="epsilon" value="inf"/>', "epsilon inf"),
        ('<boolean name="hide_emitters" value="true"/>', "hide_emitters must be false"),
        ('<rgb name="ambient" value="0, -1, 0"/>', "ambient.*-1"),
        ('<rgb name="ambient" value="0, nan, 0"/>', "ambient.*nan"),
        ('<rgb name="ambient" value="0, inf, 0"/>', "ambient.*inf"),
        ('<texture type="checkerboard" name="ambient"/>', "ambient"),
        ('<integer name="max_dept" value="3"/>', "max_dept"),
        ('<boolean name="enable_shadow" value="true"/>', "enable_shadow"),
        ('<float name="max_depth" value="2.5"/>', "max_depth"),
    ],
)
def test_parameters_out_of_range_are_refused_when_the_scene_is_loaded(any_rgb, scene_of, parameter, says):
    with pytest.raises(RuntimeError, match=says):
        scene_of("", parameter)


@pytest.mark.parametrize(
    "setting",
    [
        {"max_depth": -2},
        {"max_depth": True},
        {"max_depth": 2.5},
        {"ambient": (0.0, NAN, 0.0)},
        {"ambient": 0.1},
        {"falloff": "linear"},
        {"epsilon": 0.0},
        {"epsilon": NAN},
        {"target_error": -1.0},
        {"target_error": NAN},
        {"target_error": INFINITE},
    ],
)
def test_settings_out_of_range_are_refused_in_code_too(any_rgb, scene_of, setting):
    settings = scene_of("").integrator().settings
    (name,) = setting
    with pytest.raises(SceneError, match=name):
        dataclasses.replace(settings, **setting)


def test_hide_emitters_may_be_named_false(any_rgb, see):
    assert np.all(see("", '<boolean name="hide_emitters" value="false"/>') == 0)


# ------------------------------------------------------------------------------------------------ after a refusal
def test_a_scene_can_be_mended_after_a_refusal(llvm_ad_rgb, scene_of):
    sun = """<emitter type="directional" id="lamp"><vector name="direction" value="0, 0, 1"/>
      <float name="irradiance" value="1"/></emitter>"""
    scene = scene_of(worn(HALF) + sun)
    parameters = mi.traverse(scene)
    good = np.array(mi.render(scene, spp=1))
    (key,) = (key for key in parameters.keys() if key.endswith("irradiance.value"))  # noqa: SIM118 (no plain dict)
    parameters[key] = -1.0
    parameters.update()
    with pytest.raises(RuntimeError) as caught:
        mi.render(scene, spp=1)
    assert "`lamp`" in message_of(caught.value)
    parameters[key] = 1.0
    parameters.update()
    assert np.array_equal(np.array(mi.render(scene, spp=1)), good)
    assert good.max() > 0
