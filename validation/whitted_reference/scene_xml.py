"""The strict reader of scene files: Mitsuba's plugins, as far as the written picture defines them.

One small function per plugin takes its parameters from a `Properties` one by one; `done` refuses what is
left over. Nothing is guessed: an unknown plugin or parameter is a `SceneError` that names it, a known
feature that the picture does not define is `NotDefined`. Materials and shapes have files of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from whitted_reference import float32, scene
from whitted_reference.elements import Document, Files
from whitted_reference.errors import SceneError
from whitted_reference.materials_xml import read_material, read_texture
from whitted_reference.properties import Properties, parse_number
from whitted_reference.shapes_xml import read_shapes


# ------------------------------------------------------------------------------------------------ lights
def _light(p: Properties, number: int) -> scene.Light:
    name = p.element.attributes.get("id", f"{p.type}_{number}")
    p.single("sampling_weight", 1.0)
    light: scene.Light
    if p.type == "point":
        if p.has("position") and p.has("to_world"):
            raise p.refuse("both `position` and `to_world`; allowed: one of them")
        position = p.vec("position", (0, 0, 0)) if p.has("position") else p.transform().column(3)
        light = scene.PointLight(name, position, p.colour("intensity", 1.0))
    elif p.type == "spot":
        m = p.transform()
        cutoff = p.single("cutoff_angle", 20.0, 0.0, 180.0)
        if cutoff == 0.0:  # the ramp of a cone without width is not defined
            raise p.refuse("`cutoff_angle` is 0; allowed: above 0, to 180")
        beam = float32.nearest(float32.nearest(cutoff * 3.0) / 4.0)
        beam = p.single("beam_width", beam, 0.0)
        if beam > cutoff:  # compared after rounding: the same decimals twice are allowed
            raise p.refuse(f"`beam_width` is {beam:g}; allowed: 0 to {cutoff:g}")
        if p.has("texture"):
            raise p.not_defined("textured spot light")
        intensity = p.colour("intensity", 1.0)
        light = scene.SpotLight(name, m.column(3), intensity, m, math.radians(cutoff), math.radians(beam))
    elif p.type == "directional":
        if p.has("direction") and p.has("to_world"):
            raise p.refuse("both `direction` and `to_world`; allowed: one of them")
        if p.has("direction"):
            direction = float32.normalize(float32.normalize(p.vec("direction", (0, 0, 1))))
            if not all(map(math.isfinite, direction)):
                raise p.refuse("`direction` has no direction; allowed: vectors other than 0")
        else:
            direction = p.transform().column(2)
        light = scene.DirectionalLight(name, direction, p.colour("irradiance", 1.0))
    else:
        raise p.not_defined()
    p.done()
    return light


# ------------------------------------------------------------------------------------------------ camera
def _film(p: Properties, messages: list[str]) -> scene.Film:
    if p.type != "hdrfilm":
        raise p.not_defined()
    width, height = p.integer("width", 768, 1), p.integer("height", 576, 1)
    x, y = p.integer("crop_offset_x", 0, 0), p.integer("crop_offset_y", 0, 0)
    crop_width, crop_height = p.integer("crop_width", width, 1), p.integer("crop_height", height, 1)
    if x + crop_width > width or y + crop_height > height:
        raise p.refuse(f"crop {crop_width} x {crop_height} at ({x}, {y}) leaves the film of {width} x {height}")
    for name in ("file_format", "pixel_format", "component_format"):
        p.string(name, "")
    for name in ("banner", "compensate"):
        p.boolean(name, False)
    if p.boolean("sample_border", False):
        raise p.not_defined("film with sample_border")
    filters = p.take_objects("rfilter")
    if [f.type for f in filters] != ["box"]:
        kind = filters[0].type if filters else "gaussian (Mitsuba's default)"
        messages.append(
            f"{p.where}: reconstruction filter {kind} is not drawn here: a pixel is the mean of its samples"
        )
    p.done()
    return scene.Film(width, height, x, y, crop_width, crop_height)


def _sensor(p: Properties, number: int, messages: list[str]) -> scene.Sensor:
    if p.type not in ("perspective", "orthographic"):
        raise p.not_defined()
    films = p.take_objects("film")
    if len(films) > 1:
        raise p.refuse(f"{len(films)} films; allowed: 1")
    film = _film(films[0], messages) if films else scene.Film(768, 576, 0, 0, 768, 576)
    count = 4
    for sampler in p.take_objects("sampler"):
        if sampler.type not in ("independent", "stratified", "multijitter", "orthogonal", "ldsampler"):
            raise sampler.not_defined()
        count = sampler.integer("sample_count", 4, 1)
        sampler.integer("seed", 0, 0)
        sampler.boolean("jitter", True)
        sampler.done()
    x_fov, principal = None, (0.0, 0.0)
    m = p.transform()
    if p.type == "perspective":
        x_fov = _x_fov(p, film.width / film.height)
        principal = p.single("principal_point_offset_x", 0.0), p.single("principal_point_offset_y", 0.0)
        for i in range(3):
            for j in range(i, 3):
                gram = sum(m.matrix[i][k] * m.matrix[j][k] for k in range(3))
                if abs(gram - (i == j)) > CAMERA_SCALE:
                    raise p.refuse(f"camera scale differs from 1 by more than {CAMERA_SCALE}")
    near, far = p.single("near_clip", float32.nearest(1e-2)), p.single("far_clip", 1e4)
    if not 0.0 < near < far:
        raise p.refuse(f"near_clip {near:g}, far_clip {far:g}; allowed: 0 < near_clip < far_clip")
    for ignored in ("focus_distance", "shutter_open", "shutter_close"):
        p.single(ignored, 0.0)
    p.done()
    name = p.element.attributes.get("id", f"sensor_{number}")
    return scene.Sensor(name, m, film, x_fov, principal, near, far, count)


CAMERA_SCALE = 1e-3  # model: "Camera scale must be 1 within 1e-3"


def _x_fov(p: Properties, aspect: float) -> float:
    """Return the horizontal field of view in degrees, found in double precision and rounded once."""
    if p.has("fov") and p.has("focal_length"):
        raise p.refuse("both `fov` and `focal_length`; allowed: one of them")
    if p.has("fov"):
        fov = p.double("fov", 0.0)
        axis = p.string("fov_axis", "x").lower()
        axis = {"smaller": "y" if aspect > 1 else "x", "larger": "x" if aspect > 1 else "y"}.get(axis, axis)
    else:
        text = p.string("focal_length", "50mm").removesuffix("mm")
        length = parse_number(text, f"{p.where} `focal_length`")
        if length <= 0.0:
            raise p.refuse(f"focal_length is {text} mm; allowed: above 0")
        fov = 2.0 * (math.atan(math.sqrt(36 * 36 + 24 * 24) / (2.0 * length)) * (180.0 / math.pi))
        axis = "diagonal"
    half = math.tan(0.5 * (fov * (math.pi / 180.0)))
    if axis == "y":
        fov = 2.0 * math.atan(half * aspect) * (180.0 / math.pi)
    elif axis == "diagonal":
        width = 2.0 * half / math.sqrt(1.0 + 1.0 / (aspect * aspect))
        fov = 2.0 * math.atan(width * 0.5) * (180.0 / math.pi)
    elif axis != "x":
        raise p.refuse(f"fov_axis is `{axis}`; allowed: x, y, diagonal, smaller, larger")
    if not 0.0 < fov < 180.0:
        raise p.refuse(f"the horizontal field of view is {fov:g} degrees; allowed: between 0 and 180")
    return float32.nearest(fov)


# ----------------------------------------------------------------------------------------- the integrator
def _settings(integrators: list[Properties], where: str, messages: list[str]) -> scene.Settings:
    if len(integrators) > 1:
        raise integrators[1].refuse("a second integrator; allowed: 1")
    if not integrators or integrators[0].type != "whitted":
        kind = integrators[0].type if integrators else "none"
        messages.append(f"{where}: integrator {kind}: drawn by `whitted` with its defaults")
        return scene.Settings()
    p = integrators[0]
    if p.has("target_error"):
        raise p.not_defined("target_error")
    if p.boolean("hide_emitters", False):
        raise p.refuse("hide_emitters is true; allowed: false")
    epsilon = p.single("epsilon", 0.0, low=0.0) if p.has("epsilon") else None
    settings = scene.Settings(
        max_depth=p.integer("max_depth", 10, low=-1),
        ambient=p.colour("ambient", 0.0),
        falloff=p.string("falloff", "inverse_square", ("inverse_square", "none")) == "inverse_square",
        epsilon=epsilon,
        enable_ambient=p.boolean("enable_ambient", True),
        enable_diffuse=p.boolean("enable_diffuse", True),
        enable_specular=p.boolean("enable_specular", True),
        enable_shadows=p.boolean("enable_shadows", True),
        enable_mirrors=p.boolean("enable_mirrors", True),
    )
    p.done()
    return settings


# -------------------------------------------------------------------------------------------- the scene
def load(
    path: str | Path,
    parameters: Mapping[str, str] | None = None,
    allow_dirs: Sequence[str | Path] = (),
    grey: bool = False,
) -> scene.Scene:
    """Read a scene file.

    The definition of the picture says of Mitsuba's monochrome variants: "mono is compared with the luminance
    of the same". The same scene, that is, and not the same picture: the picture multiplies coefficients, k_d
    with I and one k_m with the next, and the luminance of a product is not the product of luminances. Mitsuba
    replaces every colour by its luminance as it reads the scene (a bitmap's where it is asked), and draws with
    these; so does `grey`.

    Parameters
    ----------
    path : the XML file
    parameters : values for `$name` in the file; they win over its `<default>`s
    allow_dirs : folders from which files may be read besides the scene's own
    grey : whether every colour stands for its luminance

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        One line that names file, element, value and what is allowed.
    NotDefined
        If the scene holds a feature that the written picture does not define.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f"{path.name}: no such file")
    files = Files(path.parent, [Path(folder) for folder in allow_dirs])
    document = Document(path.resolve(), parameters or {}, files, grey)
    return _read_scene(Properties(document, document.root))


def _read_scene(p: Properties) -> scene.Scene:
    messages: list[str] = []
    for bsdf in p.take_objects("bsdf"):
        read_material(bsdf)
    for texture in p.take_objects("texture"):
        read_texture(texture, math.inf)
    settings = _settings(p.take_objects("integrator"), p.where, messages)
    sensors = tuple(_sensor(child, i, messages) for i, child in enumerate(p.take_objects("sensor")))
    background, lights = None, []
    for i, child in enumerate(p.take_objects("emitter")):
        if child.type == "constant":
            if background is not None:
                raise child.refuse("a second background; allowed: 1")
            background = child.colour("radiance", 1.0)
            child.single("sampling_weight", 1.0)
            child.done()
            messages.append(f"{child.where}: emitter constant is seen as the background and lights nothing")
        else:
            lights.append(_light(child, i))
    shapes = tuple(read_shapes(p.take_objects("shape")))
    for shape in shapes:
        if not isinstance(shape, scene.Instance) and shape.look.emission is not None:
            messages.append(f"area light of `{shape.look.id}` is seen and lights nothing")
    p.done()
    name = Path(p.where.split(":")[0]).stem
    return scene.Scene(name, settings, sensors, shapes, tuple(lights), background or (0.0, 0.0, 0.0), tuple(messages))
