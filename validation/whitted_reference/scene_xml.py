"""The strict reader of scene files: Mitsuba's plugins, as far as the written picture defines them.

One small function per plugin takes its parameters from a `Properties` one by one; `done` refuses what is
left over. Nothing is guessed: an unknown plugin or parameter is a `SceneError` that names it, a known
feature that the picture does not define is `NotDefined`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from whitted_reference import float32, mesh_files, polygon, scene, transforms
from whitted_reference.elements import Document, Files
from whitted_reference.errors import NotDefined, SceneError
from whitted_reference.png import read_png
from whitted_reference.properties import Properties, parse_number
from whitted_reference.transforms import Affine, Row3


# -------------------------------------------------------------------------------- textures and materials
def _texture(p: Properties, name: str, default: float | Row3, high: float = 1.0) -> scene.Texture:
    """Take a colour or a texture."""
    nested = p.take_named(name)
    if nested is None:
        return p.colour(name, default, high)
    if nested.element.tag != "texture":
        raise nested.refuse(f"`{name}` must be a texture or a colour")
    return _read_texture(nested, high)


def _read_texture(p: Properties, high: float) -> scene.Texture:
    texture: scene.Texture
    if p.type == "checkerboard":
        color0, color1 = _texture(p, "color0", 0.4, high), _texture(p, "color1", 0.2, high)
        texture = scene.Checkerboard(color0, color1, _uv_rows(p.transform("to_uv")))
    elif p.type == "bitmap":
        to_uv = _uv_rows(p.transform("to_uv"))
        bilinear = p.string("filter_type", "bilinear", ("bilinear", "nearest")) == "bilinear"
        wrap = p.string("wrap_mode", "repeat", ("repeat", "mirror", "clamp"))
        raw = p.boolean("raw", False)
        p.boolean("accel", True)
        path = p.file()
        if path.suffix.lower() != ".png":
            raise p.not_defined(f"bitmap {path.suffix}")
        png = read_png(path)
        if min(png.width, png.height) < 2:
            raise p.refuse(f"{path.name} is {png.width} x {png.height} pixels; allowed: from 2 x 2")
        texture = scene.Bitmap(
            path.name, png.width, png.height, png.channels, png.texels, not raw, bilinear, wrap, to_uv
        )
    else:
        raise p.not_defined()
    p.done()
    return texture


def _uv_rows(m: Affine) -> tuple[Row3, Row3]:
    (a, b, _, s), (c, d, _, t), _ = m.matrix
    return (a, b, s), (c, d, t)


def _one_sided(p: Properties) -> scene.OneSided:
    material: scene.OneSided
    if p.type == "blinnphong":
        diffuse = _texture(p, "diffuse_reflectance", 0.5)
        material = scene.BlinnPhong(
            ambient=_texture(p, "ambient_reflectance", 0.0) if p.has("ambient_reflectance") else diffuse,
            diffuse=diffuse,
            specular=_texture(p, "specular_reflectance", 0.0),
            mirror=_texture(p, "mirror_reflectance", 0.0),
            exponent=_texture(p, "exponent", 32.0, high=1e7),
        )
    elif p.type == "diffuse":
        material = scene.Diffuse(_texture(p, "reflectance", 0.5))
    elif p.type == "conductor":
        if p.has("eta") or p.has("k") or p.string("material", "none") != "none":
            raise p.not_defined("conductor with a metal's spectrum")
        material = scene.Conductor(_texture(p, "specular_reflectance", 1.0))
    else:
        raise p.not_defined()
    p.done()
    return material


def _material(p: Properties) -> scene.Material:
    if p.type != "twosided":
        return _one_sided(p)
    nested = [_one_sided(child) for child in p.take_objects("bsdf")]
    if not 1 <= len(nested) <= 2:
        raise p.refuse(f"{len(nested)} nested bsdfs; allowed: 1 or 2")
    p.done()
    return scene.TwoSided(nested[0], nested[-1])


# ------------------------------------------------------------------------------------------------ shapes
def _look(p: Properties, number: int) -> scene.Look:
    emission = None
    for emitter in p.take_objects("emitter"):
        if emitter.type != "area":
            raise emitter.not_defined()
        if emission is not None:
            raise p.refuse("more than one emitter; allowed: 1")
        if emitter.take_named("radiance"):
            raise emitter.not_defined("textured area light")
        emission = emitter.colour("radiance", 1.0)
        emitter.single("sampling_weight", 1.0)
        emitter.done()
    materials = [_material(child) for child in p.take_objects("bsdf")]
    if len(materials) > 1:
        raise p.refuse(f"{len(materials)} bsdfs; allowed: 1")
    default = scene.Diffuse((0.5, 0.5, 0.5) if emission is None else (0.0, 0.0, 0.0))
    name = p.element.attributes.get("id", f"{p.type}_{number}")
    return scene.Look(name, materials[0] if materials else default, emission)


def _similarity(p: Properties, m: Affine, axes: Sequence[int]) -> None:
    """Refuse shear, and unequal scale among `axes`.

    M is rounded to binary32 at most three times (once as read, twice where centre and radius or the two
    ends are multiplied in), so each column is off by at most 3 u |m|, u = 2^-24, and each scalar product
    of two columns of length s by 6 u s^2 (first order); twice that separates rounding from intent.
    """
    columns = [m.column(j) for j in range(3)]

    def dot(i: int, j: int) -> float:
        return sum(x * y for x, y in zip(columns[i], columns[j], strict=True))

    size = dot(axes[0], axes[0])
    for i in range(3):
        for j in range(i):
            if abs(dot(i, j)) > 12 * float32.ROUNDOFF * math.sqrt(dot(i, i) * dot(j, j)):
                raise NotDefined(f"{p.type} with shear", p.element.attributes.get("id", p.type), p.where)
    for i in axes:
        if abs(dot(i, i) - size) > 12 * float32.ROUNDOFF * size:
            raise NotDefined(f"{p.type} with unequal scale", p.element.attributes.get("id", p.type), p.where)


def _times32(p: Properties, *factors: Affine) -> Affine:
    """Multiply in single precision, as Mitsuba does with centre and radius."""
    result = factors[0]
    for factor in factors[1:]:
        result = transforms.product(result, factor, float32.fma)
    if not result.is_finite() or result.determinant() == 0:
        raise p.refuse("the shape is degenerate or not finite in single precision")
    return result


def _scaling32(v: Row3) -> Affine:
    return transforms.scaling(v).rounded()


def _sphere(p: Properties, look: scene.Look) -> scene.Solid:
    radius = p.single("radius", 1.0)
    if radius == 0.0:
        raise p.refuse("radius is 0; allowed: other numbers")
    m = _times32(p, p.transform(), transforms.translation(p.vec("center", (0.0, 0.0, 0.0))), _scaling32((radius,) * 3))
    _similarity(p, m, (0, 1, 2))
    inward = p.boolean("flip_normals", False) != (m.determinant() < 0)
    return scene.Sphere(look, m.column(3), float32.length(m.column(0)), m, inward)


def _cylinder(p: Properties, look: scene.Look) -> scene.Solid:
    near = float32.nearest
    radius = p.single("radius", 1.0)
    p0, p1 = p.vec("p0", (0.0, 0.0, 0.0)), p.vec("p1", (0.0, 0.0, 1.0))
    axis = (near(p1[0] - p0[0]), near(p1[1] - p0[1]), near(p1[2] - p0[2]))
    length = float32.length(axis)
    if radius == 0.0 or length == 0.0:
        raise p.refuse(f"radius {radius:g}, length {length:g}; allowed: other than 0")
    n = float32.divided(axis, length)
    s, t = float32.frame(n)
    to_frame = transforms.from_columns(s, t, n, (0.0, 0.0, 0.0), (s, t, n))
    m = _times32(p, p.transform(), transforms.translation(p0), to_frame, _scaling32((radius, radius, length)))
    _similarity(p, m, (0, 1))
    return scene.Cylinder(look, m, p.boolean("flip_normals", False))


def _rectangle(p: Properties, look: scene.Look) -> scene.Solid:
    p.boolean("face_normals", False)
    return scene.Rectangle(look, p.transform(), p.boolean("flip_normals", False))


def _disk(p: Properties, look: scene.Look) -> scene.Solid:
    return scene.Disk(look, p.transform(), p.boolean("flip_normals", False))


def _cube(p: Properties, look: scene.Look) -> scene.Solid:
    p.boolean("face_normals", False)
    vertices: list[Row3] = []
    normals: list[Row3] = []
    uvs: list[tuple[float, float]] = []
    faces: list[tuple[int, int, int]] = []
    for n, corners in _CUBE_FACES:
        first = len(vertices)
        vertices += corners
        normals += [n] * 4
        uvs += [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
        faces += [(first, first + 1, first + 2), (first + 3, first, first + 2)]
    return _world_mesh(p, look, mesh_files.RawMesh(vertices, faces, normals, uvs), smooth=False)


# Each face of the cube: its normal and its corners in the order of uv (0,1) (1,1) (1,0) (0,0).
_CUBE_FACES: tuple[tuple[Row3, tuple[Row3, ...]], ...] = (
    ((0, -1, 0), ((1, -1, -1), (1, -1, 1), (-1, -1, 1), (-1, -1, -1))),
    ((0, 1, 0), ((1, 1, -1), (-1, 1, -1), (-1, 1, 1), (1, 1, 1))),
    ((1, 0, 0), ((1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1))),
    ((0, 0, 1), ((1, -1, 1), (1, 1, 1), (-1, 1, 1), (-1, -1, 1))),
    ((-1, 0, 0), ((-1, -1, 1), (-1, 1, 1), (-1, 1, -1), (-1, -1, -1))),
    ((0, 0, -1), ((1, 1, -1), (1, -1, -1), (-1, -1, -1), (-1, 1, -1))),
)


def _mesh_file(p: Properties, look: scene.Look) -> scene.Solid:
    path = p.file()
    try:
        raw = mesh_files.read_ply(path) if p.type == "ply" else mesh_files.read_obj(path)
    except SceneError as error:
        raise p.refuse(str(error)) from None
    if p.boolean("flip_tex_coords", p.type == "obj") and raw.uvs is not None:
        raw.uvs = [(u, float32.nearest(1.0 - v)) for u, v in raw.uvs]
    smooth = not p.boolean("face_normals", False)
    if not smooth:
        raw.normals = None
    return _world_mesh(p, look, raw, smooth)


def _world_mesh(p: Properties, look: scene.Look, raw: mesh_files.RawMesh, smooth: bool) -> scene.Mesh:
    m = p.transform()
    vertices = tuple(_finite(p, m.point32(v)) for v in raw.vertices)
    return scene.Mesh(
        look=look,
        to_world=m,
        vertices=vertices,
        faces=tuple(raw.faces),
        normals=tuple(raw.normals) if raw.normals is not None else None,
        uvs=tuple(raw.uvs) if raw.uvs is not None else None,
        smooth=smooth and raw.normals is None,
        flip=p.boolean("flip_normals", False),
    )


def _finite(p: Properties, v: Row3) -> Row3:
    if not all(map(math.isfinite, v)):
        raise p.refuse(f"vertex {v} is not finite in single precision")
    return v


def _polygon(p: Properties, look: scene.Look) -> scene.Solid:
    material = look.material
    sides = (material.front, material.behind) if isinstance(material, scene.TwoSided) else (material,)
    if any(map(_is_textured, sides)):
        raise p.not_defined("polygon with a texture")
    m = p.transform()
    text = p.string("vertices", None)
    rings = tuple(_ring(p, m, part) for part in text.split(";"))
    normal = p.vec("normal", (0.0, 0.0, 0.0)) if p.has("normal") else None
    shape = scene.Polygon(look, m, rings, normal, p.boolean("flip_normals", False))
    if normal is not None and not any(normal):
        raise p.refuse("`normal` is zero; allowed: other vectors")
    try:
        polygon.check(shape)
    except SceneError as error:
        raise p.refuse(str(error)) from None
    return shape


def _ring(p: Properties, m: Affine, text: str) -> tuple[Row3, ...]:
    vertices = []
    for token in text.split():
        parts = token.split(",")
        if len(parts) != 3:
            raise p.refuse(f"`vertices` holds `{token}`; allowed: x,y,z separated by spaces, rings by `;`")
        x, y, z = (float32.nearest(parse_number(part, f"{p.where} `vertices`")) for part in parts)
        vertices.append(_finite(p, m.point32((x, y, z))))
    if len(vertices) < 3:
        raise p.refuse(f"a ring of `vertices` has {len(vertices)} vertices; allowed: from 3")
    return tuple(vertices)


def _is_textured(material: scene.OneSided) -> bool:
    return any(isinstance(value, scene.Checkerboard | scene.Bitmap) for value in vars(material).values())


_SHAPES: dict[str, Callable[[Properties, scene.Look], scene.Solid]] = {
    "sphere": _sphere,
    "rectangle": _rectangle,
    "disk": _disk,
    "cylinder": _cylinder,
    "cube": _cube,
    "ply": _mesh_file,
    "obj": _mesh_file,
    "polygon": _polygon,
}


def _solid(p: Properties, number: int) -> scene.Solid:
    if p.type not in _SHAPES:
        raise p.not_defined()
    look = _look(p, number)
    shape = _SHAPES[p.type](p, look)
    p.done()
    return shape


def _group(p: Properties) -> tuple[scene.Solid, ...]:
    solids = tuple(_solid(child, i) for i, child in enumerate(p.take_objects("shape")))
    for solid in solids:
        if solid.look.emission is not None:
            raise p.refuse(f"`{solid.look.id}` is an area light; allowed in a group: shapes that do not shine")
    p.done()
    return solids


def _instance(p: Properties, number: int) -> scene.Instance:
    groups = p.take_objects("shape")
    if [group.type for group in groups] != ["shapegroup"]:
        raise p.refuse("an instance refers to exactly one shapegroup")
    m = p.transform()
    p.done()
    return scene.Instance(p.element.attributes.get("id", f"instance_{number}"), m, _group(groups[0]))


def _shapes(nested: Sequence[Properties]) -> Iterator[scene.Shape]:
    for number, p in enumerate(nested):
        if p.type == "shapegroup":
            _group(p)  # drawn only where an instance refers to it
        elif p.type == "instance":
            yield _instance(p, number)
        else:
            yield _solid(p, number)


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
        beam = float32.nearest(float32.nearest(cutoff * 3.0) / 4.0)
        beam = p.single("beam_width", beam, 0.0, cutoff)
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
    path: str | Path, parameters: Mapping[str, str] | None = None, allow_dirs: Sequence[str | Path] = ()
) -> scene.Scene:
    """Read a scene file.

    Parameters
    ----------
    path : the XML file
    parameters : values for `$name` in the file; they win over its `<default>`s
    allow_dirs : folders from which files may be read besides the scene's own

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
    document = Document(path.resolve(), parameters or {}, files)
    return _read_scene(Properties(document, document.root))


def _read_scene(p: Properties) -> scene.Scene:
    messages: list[str] = []
    for bsdf in p.take_objects("bsdf"):
        _material(bsdf)
    for texture in p.take_objects("texture"):
        _read_texture(texture, math.inf)
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
    shapes = tuple(_shapes(p.take_objects("shape")))
    for shape in shapes:
        if not isinstance(shape, scene.Instance) and shape.look.emission is not None:
            messages.append(f"area light of `{shape.look.id}` is seen and lights nothing")
    p.done()
    name = Path(p.where.split(":")[0]).stem
    return scene.Scene(name, settings, sensors, shapes, tuple(lights), background or (0.0, 0.0, 0.0), tuple(messages))
