"""Textures, materials and what else a shape wears, as scene files have them."""

from __future__ import annotations

from whitted_reference import scene
from whitted_reference.png import read_png
from whitted_reference.properties import Properties
from whitted_reference.transforms import Affine, Row3


def _texture(p: Properties, name: str, default: float | Row3, high: float = 1.0) -> scene.Texture:
    """Take a colour or a texture."""
    nested = p.take_named(name)
    if nested is None:
        return p.colour(name, default, high)
    if nested.element.tag != "texture":
        raise nested.refuse(f"`{name}` must be a texture or a colour")
    return read_texture(nested, high)


def _number(p: Properties, name: str, default: float, high: float) -> scene.Texture:
    """Take a number, or a texture without colour: of one in colour the written picture takes no number."""
    texture = _texture(p, name, default, high)
    if _is_coloured(texture):
        raise p.not_defined(f"{name} of a coloured texture")
    return texture


def _is_coloured(texture: scene.Texture) -> bool:
    if isinstance(texture, scene.Checkerboard):
        return _is_coloured(texture.color0) or _is_coloured(texture.color1)
    if isinstance(texture, scene.Bitmap):
        red, green, blue = (texture.texels[i :: texture.channels] for i in (0, -2, -1))
        return texture.channels == 3 and not red == green == blue
    return len(set(texture)) > 1


def read_texture(p: Properties, high: float) -> scene.Texture:
    """Read a texture whose colours lie in [0, high]."""
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
            path.name, png.width, png.height, png.channels, png.texels, not raw, bilinear, wrap, to_uv, p.document.grey
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
            exponent=_number(p, "exponent", 32.0, high=1e7),
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


def read_material(p: Properties) -> scene.Material:
    """Read a bsdf."""
    if p.type != "twosided":
        return _one_sided(p)
    nested = [_one_sided(child) for child in p.take_objects("bsdf")]
    if not 1 <= len(nested) <= 2:
        raise p.refuse(f"{len(nested)} nested bsdfs; allowed: 1 or 2")
    p.done()
    return scene.TwoSided(nested[0], nested[-1])


def read_look(p: Properties, number: int) -> scene.Look:
    """Take what a shape wears; `number` names it if the file does not."""
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
    materials = [read_material(child) for child in p.take_objects("bsdf")]
    if len(materials) > 1:
        raise p.refuse(f"{len(materials)} bsdfs; allowed: 1")
    default = scene.Diffuse((0.5, 0.5, 0.5) if emission is None else (0.0, 0.0, 0.0))
    name = p.element.attributes.get("id", f"{p.type}_{number}")
    return scene.Look(name, materials[0] if materials else default, emission)


def is_textured(material: scene.OneSided) -> bool:
    """Tell whether any coefficient is a texture."""
    return any(isinstance(value, scene.Checkerboard | scene.Bitmap) for value in vars(material).values())
