"""A scene as plain data: what the file says, rounded to single precision, and nothing computed from it.

Every number is a Python float that binary32 can represent (angles and the tangent of the field of view
excepted: they are computed once in double precision and are exact inputs from then on). The tracer turns
this into its own structures, in the arithmetic that it is asked to use (see `trace`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from whitted_reference.transforms import Affine

Floats3 = tuple[float, float, float]


# ---------------------------------------------------------------------------------------------- textures
@dataclass(frozen=True)
class Checkerboard:
    """Two textures in squares of half a unit of (transformed) uv.

    Attributes
    ----------
    to_uv : two rows (m0, m1, translation)
    """

    color0: Texture
    color1: Texture
    to_uv: tuple[Floats3, Floats3]


@dataclass(frozen=True)
class Bitmap:
    """An 8-bit picture.

    Attributes
    ----------
    texels : rows from the top, each of `width * channels` bytes; v = 0 is the top edge
    channels : 1 (grey) or 3 (RGB)
    srgb : whether the bytes are decoded from sRGB; else byte / 255
    wrap : `repeat`, `mirror` or `clamp`
    grey : whether colours stand for their luminance
    """

    name: str
    width: int
    height: int
    channels: int
    texels: bytes = field(repr=False)
    srgb: bool
    bilinear: bool
    wrap: str
    to_uv: tuple[Floats3, Floats3]
    grey: bool = False


Texture = Floats3 | Checkerboard | Bitmap


# --------------------------------------------------------------------------------------------- materials
@dataclass(frozen=True)
class BlinnPhong:
    """The textbook's four coefficients; `exponent` is a number (as a grey colour) or a texture."""

    ambient: Texture
    diffuse: Texture
    specular: Texture
    mirror: Texture
    exponent: Texture


@dataclass(frozen=True)
class Diffuse:
    """Lambert of reflectance rho: k_d = k_a = rho / pi."""

    reflectance: Texture


@dataclass(frozen=True)
class Conductor:
    """A perfect mirror tinted by k_m (Mitsuba's `material=none`)."""

    mirror: Texture


@dataclass(frozen=True)
class TwoSided:
    """One material in front, another (or the same) behind."""

    front: OneSided
    behind: OneSided


OneSided = BlinnPhong | Diffuse | Conductor
Material = OneSided | TwoSided


# ------------------------------------------------------------------------------------------------ shapes
@dataclass(frozen=True)
class Look:
    """How a shape is named and what it shows; `emission` is seen from the front only."""

    id: str
    material: Material
    emission: Floats3 | None


@dataclass(frozen=True)
class Sphere:
    """Centre, radius; `to_world` maps the unit sphere onto it and turns its uv."""

    look: Look
    centre: Floats3
    radius: float
    to_world: Affine
    inward: bool


@dataclass(frozen=True)
class Rectangle:
    """The parallelogram M (x, y, 0), |x| <= 1, |y| <= 1."""

    look: Look
    to_world: Affine
    flip: bool


@dataclass(frozen=True)
class Disk:
    """The ellipse M (x, y, 0), x^2 + y^2 <= 1."""

    look: Look
    to_world: Affine
    flip: bool


@dataclass(frozen=True)
class Cylinder:
    """The tube M (cos, sin, z), 0 <= z <= 1, without caps."""

    look: Look
    to_world: Affine
    inward: bool


@dataclass(frozen=True)
class Mesh:
    """Triangles over world-space vertices.

    Attributes
    ----------
    normals : per vertex, as in the file and so before `to_world`; None: the faces' own
    smooth : without `normals`, whether vertex normals are made from the faces
    uvs : per vertex, or None
    """

    look: Look
    to_world: Affine
    vertices: tuple[Floats3, ...] = field(repr=False)
    faces: tuple[tuple[int, int, int], ...] = field(repr=False)
    normals: tuple[Floats3, ...] | None = field(repr=False)
    uvs: tuple[tuple[float, float], ...] | None = field(repr=False)
    smooth: bool
    flip: bool


@dataclass(frozen=True)
class Polygon:
    """World-space rings; `normal` is the file's, before `to_world`, or None."""

    look: Look
    to_world: Affine
    rings: tuple[tuple[Floats3, ...], ...]
    normal: Floats3 | None
    flip: bool


Solid = Sphere | Rectangle | Disk | Cylinder | Mesh | Polygon


@dataclass(frozen=True)
class Instance:
    """A group of shapes seen through a transform."""

    id: str
    to_world: Affine
    shapes: tuple[Solid, ...]


Shape = Solid | Instance


# ------------------------------------------------------------------------------------------------ lights
@dataclass(frozen=True)
class PointLight:
    """Shines equally everywhere: `intensity` in power per solid angle."""

    id: str
    position: Floats3
    intensity: Floats3


@dataclass(frozen=True)
class SpotLight:
    """A point light in a cone about the local +z axis; angles in radians."""

    id: str
    position: Floats3
    intensity: Floats3
    to_world: Affine
    cutoff_angle: float
    beam_width: float


@dataclass(frozen=True)
class DirectionalLight:
    """Light from infinitely far away; `direction` is where it travels, not normalised."""

    id: str
    direction: Floats3
    irradiance: Floats3


Light = PointLight | SpotLight | DirectionalLight


# ------------------------------------------------------------------------------------------------ camera
@dataclass(frozen=True)
class Film:
    """Width and height of the full film, and the part of it that is drawn, in pixels."""

    width: int
    height: int
    crop_x: int
    crop_y: int
    crop_width: int
    crop_height: int


@dataclass(frozen=True)
class Sensor:
    """A pinhole camera, or with `x_fov` None an orthographic one.

    Attributes
    ----------
    x_fov : horizontal field of view in degrees
    principal : offset of the principal point, as a fraction of the film
    near, far : distances along the camera's z
    sample_count : samples per pixel asked for by the sampler
    """

    id: str
    to_world: Affine
    film: Film
    x_fov: float | None
    principal: tuple[float, float]
    near: float
    far: float
    sample_count: int

    @property
    def grid(self) -> int:
        """Return the n of the smallest n x n pattern that holds `sample_count` samples."""
        return math.isqrt(self.sample_count - 1) + 1


@dataclass(frozen=True)
class Settings:
    """The integrator's parameters; `max_depth` -1 is unlimited, `epsilon` None is the exact rule."""

    max_depth: int = 10
    ambient: Floats3 = (0.0, 0.0, 0.0)
    falloff: bool = True
    epsilon: float | None = None
    enable_ambient: bool = True
    enable_diffuse: bool = True
    enable_specular: bool = True
    enable_shadows: bool = True
    enable_mirrors: bool = True


@dataclass(frozen=True)
class Scene:
    """All of it. `messages` are remarks for the person at the screen, one line each."""

    name: str
    settings: Settings
    sensors: tuple[Sensor, ...]
    shapes: tuple[Shape, ...]
    lights: tuple[Light, ...]
    background: Floats3
    messages: tuple[str, ...] = ()
