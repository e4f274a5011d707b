"""A scene in the language of POV-Ray 3.7, where that can say exactly the same picture; anything else is refused.

What stays different, since POV-Ray knows no other way:

- shadow rays overlook what is nearer than 1e-3, all rays what is nearer than 1e-4, in units of the file: `source`
  makes the scene about `WIDE` of these wide by a power of two, so that this is 2.4e-7 of the scene;
- the last ray of a chain of mirrors, which by the model sees lamps and sky alone, is not drawn;
- of a smooth mesh only the interpolated normal decides on which side of it light and eye are;
- a light's falloff is 1/(1e-12 + distance^2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from whitted_reference import scene
from whitted_reference.arithmetic import FLOAT
from whitted_reference.materials import Material, Terms
from whitted_reference.polygon import plane
from whitted_reference.shapes import Parallelogram
from whitted_reference.triangles import vertex_normals
from whitted_reference.vectors import BLACK, Vec, add, cross, dot, negated, scaled, sub
from whitted_validation.refusal import Refusal

WIDE = 4096.0
"""POV-Ray's units across the scene: many, so that its smallest lengths matter least; but no hit may be beyond its
largest, 1e7. On scenes a, b and c its time is the same for 2 to 32768 units; at 131072 b took three times as long.
"""

FAR = 10.0
"""Distance of directional light, in diagonals of the scene: a light's plane must lie behind all that throws shadows."""

NEAR_LAMP = 1e-6
"""POV-Ray's `fade_distance` F: 2/(1 + (d/F)^2) is 2 F^2/d^2 within 2^-24 from d = 4100 F on."""

DEEPEST = 256
"""POV-Ray's own limit of `max_trace_level`."""

LARGEST = (2 - 2.0**-23) * 2.0**127
"""POV-Ray's colours are in single precision."""

_HEAD = "#version 3.7;\n#default {finish {ambient 0 diffuse 0}}\n"
_BLACK = "texture {pigment {rgb 0}}"


def source(description: scene.Scene, exposure: float = 1.0) -> str:
    """Write a scene and its first camera.

    Parameters
    ----------
    description : what `whitted_reference.load` returns
    exposure : all light is multiplied by this: POV-Ray's files of 16 bits end at 1

    Returns
    -------
    str
        In POV-Ray's language. No name of the scene's is in it, only numbers.

    Raises
    ------
    Refusal
        If POV-Ray cannot draw the picture that the model defines, or would draw it otherwise.
    """
    return _Export(description, exposure).text()


class _Export:
    """The scene, and the factors of its lengths and its light."""

    def __init__(self, description: scene.Scene, exposure: float) -> None:
        self._name, self._scene, self._exposure = description.name, description, exposure
        self._declared: dict[str, str] = {}
        points = [point for shape in description.shapes for point in self._points(shape)]
        eye = [self._sensor().to_world.column(3)]
        low, high = ([f(axis) for axis in zip(*points, *eye, strict=True)] for f in (min, max))
        self._middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        self._across = math.dist(low, high)
        self._scale = 2.0 ** round(math.log2(WIDE / self._across)) if self._across else 1.0

    def _refuse(self, what: str) -> Refusal:
        return Refusal(f"{self._name}: POV-Ray cannot draw {what}")

    def text(self) -> str:
        """Write all of it."""
        return "".join((_HEAD, *self._settings(), self._camera(), *self._lights(), *self._shapes()))

    # ------------------------------------------------------------------------------------------- numbers
    def _point(self, p: Iterable[float]) -> str:
        return _vector(self._scale * x for x in p)

    def _light(self, colour: Iterable[float], factor: float = 1.0) -> str:
        values = [self._exposure * factor * x for x in colour]
        if max(values) > LARGEST:
            raise self._refuse(f"light of {max(values):.3g}; allowed: up to {LARGEST:.3g}")
        return "rgb " + _vector(values)

    # ------------------------------------------------------------------------------------------ settings
    def _settings(self) -> Iterator[str]:
        settings = self._scene.settings
        if settings.epsilon is not None:
            raise self._refuse("the textbook's epsilon: it has constants of its own")
        if not settings.enable_shadows:
            raise self._refuse("highlights without shadows")
        # A level is a ray that is lit: by the model ray k, counted from 0, where k + 2 <= max_depth.
        level = settings.max_depth - 1
        if not 1 <= level <= DEEPEST:
            raise self._refuse(f"max_depth {settings.max_depth}; allowed: 2 to {DEEPEST + 1}")
        yield f"global_settings {{assumed_gamma 1 ambient_light rgb 1 adc_bailout 0 max_trace_level {level}}}\n"
        yield f"background {{{self._light(self._scene.background)}}}\n"

    def _sensor(self) -> scene.Sensor:
        if not self._scene.sensors:
            raise self._refuse("a scene without a sensor")
        return self._scene.sensors[0]

    def _camera(self) -> str:
        sensor = self._sensor()
        film = sensor.film
        if sensor.x_fov is None:
            raise self._refuse("an orthographic sensor's near and far planes")
        if sensor.principal != (0.0, 0.0):
            raise self._refuse("an offset of the principal point")
        if (film.crop_width, film.crop_height) != (film.width, film.height):
            raise self._refuse("a part of the film")
        self._check_planes(sensor)
        to_world, half = sensor.to_world, math.tan(math.radians(0.5 * sensor.x_fov))
        right, up = (scaled(to_world.column(axis), 2 * half) for axis in (0, 1))
        return (
            f"camera {{perspective location {self._point(to_world.column(3))} direction "
            f"{_vector(to_world.column(2))} right {_vector(negated(right))} "  # the model's +x is left
            f"up {_vector(scaled(up, film.height / film.width))}}}\n"
        )

    def _check_planes(self, sensor: scene.Sensor) -> None:
        """Refuse what the near and far planes might cut: POV-Ray has none."""
        eye = sensor.to_world.column(3)
        assert sensor.x_fov is not None
        half = math.tan(math.radians(0.5 * sensor.x_fov))
        corner = math.hypot(1, half, half * sensor.film.height / sensor.film.width)
        for shape in self._scene.shapes:
            low, high = ([f(axis) for axis in zip(*self._points(shape), strict=True)] for f in (min, max))
            nearest = [max(a - x, 0.0, x - b) for x, a, b in zip(eye, low, high, strict=True)]
            farthest = [max(abs(x - a), abs(x - b)) for x, a, b in zip(eye, low, high, strict=True)]
            if math.hypot(*nearest) < sensor.near * corner or math.hypot(*farthest) > sensor.far:
                name = "" if isinstance(shape, scene.Instance) else shape.look.id
                raise self._refuse(f"what near_clip {sensor.near:g} or far_clip {sensor.far:g} may cut off of `{name}`")

    # -------------------------------------------------------------------------------------------- lights
    def _lights(self) -> Iterator[str]:
        for light in self._scene.lights:
            if isinstance(light, scene.DirectionalLight):
                far = FAR * (self._across or 1.0) / math.hypot(*light.direction)
                start = sub((self._middle[0], self._middle[1], self._middle[2]), scaled(light.direction, far))
                to = f"parallel point_at {self._point(self._middle)}"
                yield f"light_source {{{self._point(start)} {self._light(light.irradiance)} {to}}}\n"
            elif isinstance(light, scene.PointLight):
                factor, fade = 1.0, ""
                if self._scene.settings.falloff:
                    factor = (self._scale / NEAR_LAMP) ** 2 / 2
                    fade = f" fade_distance {NEAR_LAMP!r} fade_power 2"
                yield f"light_source {{{self._point(light.position)} {self._light(light.intensity, factor)}{fade}}}\n"
            else:
                raise self._refuse(f"the linear edge of spot `{light.id}`")

    # -------------------------------------------------------------------------------------------- shapes
    def _points(self, shape: scene.Shape) -> Iterable[Vec]:
        """Return points whose box holds the shape."""
        match shape:
            case scene.Sphere():
                return [tuple(x + s * shape.radius for x in shape.centre) for s in (-1, 1)]  # type: ignore[misc]
            case scene.Rectangle():
                return [a for a, _ in Parallelogram(shape, FLOAT).sides()]
            case scene.Mesh():
                return shape.vertices
            case scene.Polygon():
                return [point for ring in shape.rings for point in ring]
        name = shape.id if isinstance(shape, scene.Instance) else shape.look.id
        raise self._refuse(f"{type(shape).__name__.lower()} `{name}`")

    def _shapes(self) -> Iterator[str]:
        for shape in self._scene.shapes:
            assert not isinstance(shape, scene.Instance)  # refused by `_points`
            front, back = self._textures(shape.look)
            for texture in (front, back):
                if texture not in self._declared:
                    self._declared[texture] = f"texture {{T{len(self._declared)}}}"
                    yield f"#declare T{len(self._declared) - 1} = {texture}\n"
            front, back = self._declared[front], self._declared[back]
            if isinstance(shape, scene.Sphere) and shape.inward:
                front, back = back, front
            sides = f" {front} interior_{back}}}\n"
            match shape:
                case scene.Sphere():
                    yield f"sphere {{{self._point(shape.centre)} {shape.radius * self._scale!r}{sides}"
                case scene.Rectangle():
                    body = Parallelogram(shape, FLOAT)
                    n = body.normals(BLACK, BLACK, 0, BLACK)[0]
                    a, b, c, d = (start for start, _ in body.sides())
                    for half in ((a, b, c), (a, c, d)):
                        corners = half if _faces(half, n) else half[::-1]
                        yield f"triangle {{{' '.join(map(self._point, corners))}{sides}"
                case scene.Mesh():
                    yield from self._mesh(shape)
                    yield sides
                case scene.Polygon():
                    if front != back:
                        raise self._refuse(f"the front alone of polygon `{shape.look.id}`")
                    points = [_onto_plane(v, shape) for ring in shape.rings for v in (*ring, ring[0])]
                    yield f"polygon {{{len(points)} {' '.join(map(self._point, points))}{sides}"

    def _mesh(self, mesh: scene.Mesh) -> Iterator[str]:
        """Write vertices, normals and faces, and leave the brace open."""
        yield f"mesh2 {{vertex_vectors {{{len(mesh.vertices)}"
        yield from (f"\n{self._point(vertex)}" for vertex in mesh.vertices)
        normals = vertex_normals(mesh, FLOAT)
        if normals is not None:
            normals = [negated(n) for n in normals] if mesh.flip else normals
            yield f"}}\nnormal_vectors {{{len(normals)}"
            yield from (f"\n{_vector(n)}" for n in normals)
        yield f"}}\nface_indices {{{len(mesh.faces)}"
        for i, j, k in mesh.faces:
            a, b, c = mesh.vertices[i], mesh.vertices[j], mesh.vertices[k]
            if normals is None:
                n = cross(sub(b, a), sub(c, a))
                n = negated(n) if mesh.flip else n
            else:
                n = add(add(normals[i], normals[j]), normals[k])
            yield f"\n<{i},{j},{k}>" if _faces((a, b, c), n) else f"\n<{k},{j},{i}>"
        yield "}\n"

    # ------------------------------------------------------------------------------------------ surfaces
    def _textures(self, look: scene.Look) -> tuple[str, str]:
        """Write what is seen in front, and from behind."""
        if look.emission is not None:
            raise self._refuse(f"a lamp that is dark behind, `{look.id}`")
        if isinstance(look.material, scene.TwoSided):
            return self._texture(look.material.front, look.id), self._texture(look.material.behind, look.id)
        return self._texture(look.material, look.id), _BLACK

    def _texture(self, material: scene.OneSided, name: str) -> str:
        terms = Material(material, self._scene.settings, FLOAT).constant
        if terms is None:
            raise self._refuse(f"the textures of `{name}`")
        if terms.specular is not None and terms.exponent == 0:
            raise self._refuse(f"exponent 0 of `{name}`")
        k_a = terms.ambient or BLACK
        glow = [self._exposure * k * i for k, i in zip(k_a, self._scene.settings.ambient, strict=True)]
        return _texture(terms, glow)


def _texture(terms: Terms, glow: list[float]) -> str:
    """Write the terms of one side.

    `diffuse` and `emission` are multiplied by the pigment, `specular` and `reflection` are not; `specular` is grey. A
    coloured highlight, or ambient light where the pigment is black, takes four layers, the first at the bottom: a
    white highlight, seen through a filter 4 k_s, and two that each cover half of what is below: 4 k_d and 2 k_a I_a.
    """
    k_d, k_s = terms.diffuse, terms.specular or BLACK
    highlight = f"specular {k_s[0]!r} roughness {1 / terms.exponent!r}" if any(k_s) else ""
    mirror = f"reflection {{rgb {_vector(terms.mirror)}}}" if terms.mirror else ""
    if len(set(k_s)) == 1 and all(k or not g for k, g in zip(k_d, glow, strict=True)):
        ratio = [g / k if g else 0.0 for k, g in zip(k_d, glow, strict=True)]
        emission = f"emission rgb {_vector(ratio)}" if any(ratio) else ""
        finish = f"finish {{diffuse 1 {emission} {highlight} {mirror}}}"
        return f"texture {{pigment {{rgb {_vector(k_d)}}} {finish}}}"
    white = f"specular 1 roughness {1 / terms.exponent!r}" if any(k_s) else ""
    layers = (
        f"pigment {{rgb 0}} finish {{{white}}}",
        f"pigment {{color rgb {_vector(scaled(k_s, 4))} filter 1}}",
        f"pigment {{color rgb {_vector(scaled(k_d, 4))} transmit 0.5}} finish {{diffuse 1}}",
        f"pigment {{color rgb {_vector(2 * g for g in glow)} transmit 0.5}} finish {{emission 1 {mirror}}}",
    )
    return "\n".join(f"texture {{{layer}}}" for layer in layers)


def _faces(corners: tuple[Vec, Vec, Vec], n: Vec) -> bool:
    """Tell whether POV-Ray's normal of a triangle, (c - a) x (b - a), is on the side of n."""
    a, b, c = corners
    return bool(dot(cross(sub(c, a), sub(b, a)), n) >= 0)


def _onto_plane(v: Vec, polygon: scene.Polygon) -> Vec:
    """Move a vertex along the axis of projection: POV-Ray silently drops polygons that are off their plane by 1e-10."""
    n, centre = plane(polygon, FLOAT)
    axis = max(range(3), key=lambda i: abs(n[i]))
    off = dot(n, sub(v, centre)) / n[axis]
    x, y, z = (a - off if i == axis else a for i, a in enumerate(v))
    return x, y, z


def _vector(v: Iterable[float]) -> str:
    return f"<{','.join(map(repr, v))}>"
