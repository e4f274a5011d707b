# ruff: noqa: E501  # tables of cases, one case a line
"""The strict reader: what it takes, and that it refuses everything else by name, in one line."""

from __future__ import annotations

import math

import pytest

from whitted_reference import NotDefined, SceneError, load
from whitted_reference.scene import BlinnPhong, Diffuse

BALL = '<shape type="sphere" id="ball">{}</shape>'


def sensor(parameters: str = "", film: str = "", kind: str = "perspective") -> str:
    return f"""<sensor type="{kind}">{parameters}<film type="hdrfilm">{film}<integer name="width" value="8"/>
      <integer name="height" value="4"/><rfilter type="box"/></film></sensor>"""


FOV = '<float name="fov" value="90"/>'


# ------------------------------------------------------------------------------------------ the defaults
def test_defaults_are_those_of_the_definition(load_scene):
    scene = load_scene(BALL.format('<bsdf type="blinnphong"/>'))
    settings = scene.settings
    assert (settings.max_depth, settings.ambient, settings.falloff, settings.epsilon) == (
        10,
        (0, 0, 0),
        True,
        None,
    )
    grey, black = (0.5, 0.5, 0.5), (0, 0, 0)
    assert scene.shapes[0].look.material == BlinnPhong(grey, grey, black, black, (32, 32, 32))
    assert scene.sensors[0].sample_count == 4
    assert (scene.sensors[0].near, scene.sensors[0].far) == (math.ldexp(10737418, -30), 1e4)
    assert scene.background == (0, 0, 0)
    assert scene.messages == ()


def test_shape_without_bsdf_is_grey_and_under_an_area_light_black(load_scene):
    assert load_scene(BALL.format("")).shapes[0].look.material == Diffuse((0.5, 0.5, 0.5))
    lamp = load_scene(BALL.format('<emitter type="area"/>'))
    assert lamp.shapes[0].look.material == Diffuse((0, 0, 0))
    assert lamp.shapes[0].look.emission == (1, 1, 1)
    assert lamp.messages == ("area light of `ball` is seen and lights nothing",)


def test_other_integrator_is_drawn_with_defaults_and_one_message(scene_file):
    path = scene_file(BALL.format(""))
    path.write_text(path.read_text().replace('type="whitted"', 'type="path"'))
    scene = load(path)
    assert scene.settings.max_depth == 10
    assert [m for m in scene.messages if "integrator path" in m]


def test_other_film_filter_is_named_in_a_message(load_scene):
    scene = load_scene(BALL.format(""), sensor=sensor(FOV).replace('<rfilter type="box"/>', ""))
    assert ["gaussian" in m for m in scene.messages] == [True]


# --------------------------------------------------------------------------- parameters, ids and includes
def test_defaults_and_given_parameters_are_substituted(scene_file):
    path = scene_file('<default name="r" value="2"/><default name="rr" value="3"/>'
                      + BALL.format('<float name="radius" value="$rr"/>'))  # fmt: skip
    assert load(path).shapes[0].radius == 3
    assert load(path, {"rr": "5"}).shapes[0].radius == 5
    with pytest.raises(SceneError, match="parameter `q` is given but never used"):
        load(path, {"q": "1"})


def test_unset_parameter_is_refused(load_scene):
    with pytest.raises(SceneError, match=r"scene.xml:\d+ <float>: parameter `\$radius` has no value"):
        load_scene(BALL.format('<float name="radius" value="$radius"/>'))


def test_references_and_aliases_find_their_object(load_scene):
    red = '<bsdf type="diffuse" id="red"><rgb name="reflectance" value="1 0 0"/></bsdf><alias id="red" as="rot"/>'
    for name in ("red", "rot"):
        scene = load_scene(red + BALL.format(f'<ref id="{name}"/>'))
        assert scene.shapes[0].look.material == Diffuse((1, 0, 0))
    # A reference may stand before its object.
    assert load_scene(BALL.format('<ref id="red"/>') + red).shapes[0].look.material == Diffuse((1, 0, 0))
    with pytest.raises(SceneError, match="no object has the id `green`"):
        load_scene(BALL.format('<ref id="green"/>'))
    with pytest.raises(SceneError, match="id `ball` is used twice"):
        load_scene(BALL.format("") * 2)


def test_include_merges_a_file_of_the_own_folder(load_scene):
    inner = (
        '<scene version="3.0.0"><bsdf type="diffuse" id="red"><rgb name="reflectance" value="1 0 0"/></bsdf></scene>'
    )
    scene = load_scene('<include filename="inner.xml"/>' + BALL.format('<ref id="red"/>'), files={"inner.xml": inner})
    assert scene.shapes[0].look.material == Diffuse((1, 0, 0))


def test_include_that_includes_itself_is_refused(load_scene):
    inner = '<scene version="3.0.0"><include filename="inner.xml"/></scene>'
    with pytest.raises(SceneError, match="more than 64 nested includes"):
        load_scene('<include filename="inner.xml"/>', files={"inner.xml": inner})


def test_files_outside_the_folder_need_permission(scene_file, tmp_path_factory, ply):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "t.ply").write_text(ply([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]))
    by_path = '<shape type="ply"><string name="filename" value="{}"/></shape>'
    path = scene_file(by_path.format(f"../{elsewhere.name}/t.ply"))
    with pytest.raises(SceneError, match="lies outside the scene's folder"):
        load(path)
    assert len(load(path, allow_dirs=[elsewhere]).shapes) == 1
    path = scene_file(by_path.format("t.ply"))
    with pytest.raises(SceneError, match=r"file `t\.ply` was not found"):
        load(path)
    assert len(load(path, allow_dirs=[elsewhere]).shapes) == 1


# ------------------------------------------------------------------------------------- transforms, camera
def test_later_transform_elements_multiply_from_the_left(load_scene):
    move = '<transform name="to_world"><translate x="1"/><scale value="2"/></transform>'
    assert load_scene(BALL.format(move)).shapes[0].centre == (2, 0, 0)
    move = '<transform name="to_world"><scale value="2"/><translate x="1"/></transform>'
    assert load_scene(BALL.format(move)).shapes[0].centre == (1, 0, 0)


def test_lookat_points_z_at_the_target_and_x_along_up_cross_z(load_scene):
    scene = load_scene("", sensor=sensor(FOV + """<transform name="to_world">
      <lookat origin="1,2,3" target="1,2,5" up="0,1,0"/></transform>"""))  # fmt: skip
    m = scene.sensors[0].to_world
    assert [m.column(j) for j in range(4)] == [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 2, 3)]


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        (FOV, 90.0),
        (FOV + '<string name="fov_axis" value="y"/>', math.degrees(2 * math.atan(2))),  # 8 x 4 pixels
        (FOV + '<string name="fov_axis" value="smaller"/>', math.degrees(2 * math.atan(2))),
        (FOV + '<string name="fov_axis" value="larger"/>', 90.0),
        (
            FOV + '<string name="fov_axis" value="diagonal"/>',
            math.degrees(2 * math.atan(1 / math.sqrt(1.25))),
        ),
        ("", math.degrees(2 * math.atan(math.hypot(36, 24) / 100 / math.sqrt(1.25)))),
        (
            '<string name="focal_length" value="25mm"/>',
            math.degrees(2 * math.atan(math.hypot(36, 24) / 50 / math.sqrt(1.25))),
        ),
    ],
)
def test_field_of_view_is_measured_along_its_axis(load_scene, parameters, expected):
    # Rounded once to single precision: half a unit in the 24th bit.
    assert load_scene("", sensor=sensor(parameters)).sensors[0].x_fov == pytest.approx(expected, rel=2.0**-24, abs=0)


# ------------------------------------------------------------------------------------------------ refusals
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (BALL.format('<float name="radiu" value="1"/>'), "<float> of `sphere` `ball`: parameter `radiu` is unknown"),
        (BALL.format('<integer name="flip_normals" value="1"/>'), "`flip_normals` must be given as <boolean>"),
        (BALL.format('<boolean name="flip_normals" value="yes"/>'), "`flip_normals` is `yes`; allowed: true, false"),
        (BALL.format('<float name="radius" value="1,5"/>'), "`1,5` is not a finite decimal number"),
        (BALL.format('<float name="radius" value="1_0"/>'), "`1_0` is not a finite decimal number"),
        (BALL.format('<float name="radius" value="1"/>' * 2), "parameter `radius` is given twice"),
        (BALL.format('<float name="radius"/>'), "attribute `value` is missing"),
        (BALL.format('<float name="radius" value="1" unit="m"/>'), "attribute `unit` is unknown"),
        (BALL.format('<bsdf type="diffuse"/><bsdf type="diffuse"/>'), "2 bsdfs; allowed: 1"),
        (BALL.format('<colour name="c" value="1"/>'), "element <colour> is unknown here"),
        (BALL.format("some text"), "text `some text` between elements is not allowed"),
        (BALL.format('<transform name="to_world"><move x="1"/></transform>'), "element is unknown in <transform>"),
        (BALL.format('<transform name="to_world"><rotate x="1" y="1" angle="9"/></transform>'), "has length 1.414214"),
        (BALL.format('<transform name="to_world"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1"/></transform>'),
         "the last row is [0.0, 0.0, 1.0, 1.0]; allowed: 0 0 0 1"),
        (BALL.format('<transform name="to_world"><matrix value="1 2"/></transform>'), "holds 2 numbers; allowed: 9 or 16"),
        (BALL.format('<transform name="to_world"><lookat origin="0,0,0" target="0,0,1"/></transform>'),
         "attribute `up` is missing"),
        (BALL.format('<transform name="to_world"><lookat origin="0,0,0" target="0,1,0" up="0,1,0"/></transform>'),
         "up is zero or parallel"),
        (BALL.format('<bsdf type="blinnphong"><float name="diffuse_reflectance" value="1.5"/></bsdf>'),
         "`diffuse_reflectance` holds 1.5; allowed: 0 to 1"),
        (BALL.format('<bsdf type="blinnphong"><rgb name="mirror_reflectance" value="0 -1 0"/></bsdf>'),
         "`mirror_reflectance` holds -1; allowed: 0 to 1"),
        (BALL.format('<bsdf type="blinnphong"><float name="exponent" value="2e7"/></bsdf>'),
         "`exponent` holds 2e+07; allowed: 0 to 1e+07"),
        (BALL.format('<bsdf type="twosided"/>'), "0 nested bsdfs; allowed: 1 or 2"),
        ('<emitter type="point"><rgb name="intensity" value="-1"/></emitter>', "holds -1; allowed: 0 to inf"),
        ('<emitter type="spot"><float name="beam_width" value="30"/></emitter>', "`beam_width` is 30; allowed: 0 to 20"),
        ('<emitter type="directional"><vector name="direction" value="0,0,0"/></emitter>', "has no direction"),
        ('<emitter type="constant"/><emitter type="constant"/>', "a second background"),
        ('<integrator type="whitted"/>', "a second integrator"),
    ],
)  # fmt: skip
def test_wrong_input_is_refused_by_name(load_scene, body, message):
    with pytest.raises(SceneError) as error:
        load_scene(body)
    assert not isinstance(error.value, NotDefined)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith("scene.xml:")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<emitter type="envmap" id="sky"/>', "not judged: emitter envmap `sky`"),
        ('<shape type="sdfgrid" id="fog"/>', "not judged: shape sdfgrid `fog`"),
        (BALL.format('<bsdf type="plastic" id="cup"/>'), "not judged: bsdf plastic `cup`"),
        (
            BALL.format('<bsdf type="conductor"><string name="material" value="Au"/></bsdf>'),
            "metal's spectrum",
        ),
        (
            BALL.format('<bsdf type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf>'),
            "spectrum `reflectance`",
        ),
        (
            BALL.format('<bsdf type="diffuse"><texture type="volume" name="reflectance"/></bsdf>'),
            "texture volume",
        ),
        (BALL.format('<emitter type="directionalarea"/>'), "emitter directionalarea"),
        (
            '<emitter type="spot"><texture name="texture" type="checkerboard"/></emitter>',
            "textured spot light",
        ),
    ],
)
def test_what_the_picture_does_not_define_is_not_judged(load_scene, body, message):
    with pytest.raises(NotDefined) as error:
        load_scene(body)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("integrator", "message"),
    [
        ('<boolean name="hide_emitters" value="true"/>', "hide_emitters is true; allowed: false"),
        ('<string name="falloff" value="linear"/>', "`falloff` is `linear`; allowed: inverse_square, none"),
        ('<float name="epsilon" value="-1"/>', "`epsilon` is -1; allowed: 0 to inf"),
        ('<float name="max_depth" value="3"/>', "`max_depth` must be given as <integer>"),
        ('<float name="target_error" value="0.1"/>', "target_error"),
    ],
)
def test_wrong_integrator_parameters_are_refused(load_scene, integrator, message):
    with pytest.raises(SceneError) as error:
        load_scene(BALL.format(""), integrator)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (sensor('<float name="fov" value="180"/>'), "field of view is 180 degrees"),
        (sensor(FOV + '<string name="focal_length" value="50mm"/>'), "both `fov` and `focal_length`"),
        (sensor(FOV + '<string name="fov_axis" value="z"/>'), "fov_axis is `z`"),
        (sensor(FOV + '<float name="near_clip" value="0"/>'), "near_clip 0"),
        (
            sensor(FOV + '<float name="near_clip" value="5"/><float name="far_clip" value="5"/>'),
            "near_clip 5",
        ),
        (sensor(FOV + '<transform name="to_world"><scale value="1.01"/></transform>'), "camera scale"),
        (
            sensor(FOV, '<integer name="crop_width" value="9"/>'),
            "crop 9 x 4 at (0, 0) leaves the film of 8 x 4",
        ),
        (
            sensor('<float name="principal_point_offset_x" value="0.1"/>', kind="orthographic"),
            "principal_point_offset_x",
        ),
        (sensor(FOV, kind="thinlens"), "not judged: sensor thinlens"),
    ],
)
def test_wrong_cameras_are_refused(load_scene, text, message):
    with pytest.raises(SceneError) as error:
        load_scene(BALL.format(""), sensor=text)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<scene", "scene.xml:1: "),
        ('<scene version="2.0.0"/>', "version `2.0.0`; allowed: 3.x.y"),
        ('<shape type="sphere" version="3.0.0"/>', "the outermost element must be <scene>"),
        (
            '<!DOCTYPE scene [<!ENTITY a "b">]><scene version="3.0.0"/>',
            "a document type (DTD) is not allowed",
        ),
        ('<scene version="3.0.0">' + "<a>" * 70 + "</a>" * 70 + "</scene>", "more than 64 nested elements"),
    ],
)
def test_files_that_are_not_scenes_are_refused(tmp_path, text, message):
    path = tmp_path / "scene.xml"
    path.write_text(text)
    with pytest.raises(SceneError) as error:
        load(path)
    assert message in str(error.value)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"nothing\.xml: no such file"):
        load(tmp_path / "nothing.xml")
