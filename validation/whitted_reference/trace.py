"""Whitted's ray tracer, as the textbook has it: start reading at `Tracer.raycolor`.

Sources: Whitted 1980; Shirley, Ashikhmin and Marschner 2009, chapter 4 (ray tracing, equation 4.3 for the
shading, section 4.8 for mirrors); Blinn 1977 for the half vector.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from whitted_reference import lights, scene
from whitted_reference.arithmetic import FLOAT, Arithmetic
from whitted_reference.bvh import hierarchy_or_everything
from whitted_reference.camera import Camera
from whitted_reference.instances import Placed
from whitted_reference.materials import SMALL_EXPONENT, Material, Terms
from whitted_reference.polygon import Polygon
from whitted_reference.shapes import Cylinder, Disk, Parallelogram, Primitive, Sphere, Surface
from whitted_reference.triangles import triangles
from whitted_reference.vectors import BLACK, WHITE, Colour, Number, Vec, cross, dot, negated

# With unlimited depth a mirror path ends after this bounce, or when what it still carries is below this
# share in every channel.
LAST_BOUNCE = 1024
LEAST_SHARE = 2.0**-24


class Tracer:
    """A scene ready to be traced in one arithmetic.

    Parameters
    ----------
    description : the scene as plain data
    arithmetic : the kind of number to compute with
    sensor : which of the scene's cameras
    hierarchy : whether many primitives are put into a bounding volume hierarchy
    """

    def __init__(
        self,
        description: scene.Scene,
        arithmetic: Arithmetic = FLOAT,
        sensor: int = 0,
        hierarchy: bool = True,
    ) -> None:
        with arithmetic.scope():
            self._prepare(description, arithmetic, sensor, hierarchy)

    def _prepare(self, description: scene.Scene, arithmetic: Arithmetic, sensor: int, hierarchy: bool) -> None:
        settings = description.settings
        self.arithmetic = arithmetic
        self.film = description.sensors[sensor].film
        self.camera = Camera(description.sensors[sensor], arithmetic)
        self.lights = [lights.prepare(light, settings, arithmetic) for light in description.lights]
        self.primitives = list(_primitives(description.shapes, settings, arithmetic))
        for index, primitive in enumerate(self.primitives):
            primitive.index = index
        reach = max(abs(x) for s in description.sensors for x in s.to_world.column(3)) + max(
            s.near for s in description.sensors
        )
        self._world = hierarchy_or_everything(self.primitives, arithmetic, reach, hierarchy)
        self._stretch = 1 + arithmetic.closeness
        self._unlimited = settings.max_depth == -1
        self._max_depth = math.inf if self._unlimited else settings.max_depth
        self._least_share = arithmetic.of(LEAST_SHARE)
        self.ambient: Colour = arithmetic.vec(settings.ambient)
        self._background: Colour = arithmetic.vec(description.background)
        self._shadows = settings.enable_shadows
        # Where secondary rays start: at the surface, which they cannot meet again, or `epsilon` away.
        self._exact = settings.epsilon is None
        self.start = arithmetic.of(settings.epsilon or 0.0)
        self._infinity = arithmetic.infinity
        self.ties: list[tuple[str, str]] = []

    def pixel(self, x: int, y: int, grid: int = 1) -> Colour:
        """Return the mean of grid x grid samples of pixel (x, y): the textbook's outermost loop."""
        red = green = blue = self.arithmetic.of(0)
        with self.arithmetic.scope():
            for j in range(grid):
                for i in range(grid):
                    r, g, b = self.raycolor(*self.camera.ray(x, y, i, j, grid))
                    red += r
                    green += g
                    blue += b
            samples = grid * grid
            return red / samples, green / samples, blue / samples

    def raycolor(
        self,
        e: Vec,
        d: Vec,
        start: Number,
        end: Number,
        k: int = 0,
        leaving: Primitive | None = None,
        share: Colour = WHITE,
    ) -> Colour:
        """Return the colour that arrives at e along -d.

        Parameters
        ----------
        e, d : origin and unit direction
        start, end : what lies at distances start < t <= end is seen
        k : mirror bounces so far
        leaving : the primitive on which e lies, for a ray that leaves it
        share : product of the k_m so far; only followed while depth is unlimited
        """
        max_depth = self._max_depth
        primitive, t = self.first_hit(e, d, start, end, leaving)
        if primitive is None:
            return self._background if k + 1 <= max_depth else BLACK
        dx, dy, dz = d
        p = (e[0] + t * dx, e[1] + t * dy, e[2] + t * dz)
        n, n_g = primitive.normals(e, d, t, p)
        surface = primitive.surface
        side = surface.front
        n_v = -(n[0] * dx + n[1] * dy + n[2] * dz)
        if surface.back is not None and self.behind(n_v):
            side = surface.back
            n, n_g, n_v = negated(n), negated(n_g), -n_v
        nx, ny, nz = n
        gx, gy, gz = n_g
        if not self.positive("facing", n_v, -(gx * dx + gy * dy + gz * dz)):
            return BLACK  # seen from behind

        red = green = blue = 0
        if surface.emission is not None and side is surface.front and k + 1 <= max_depth:
            red, green, blue = surface.emission
        if k + 2 > max_depth:
            return red, green, blue

        terms = side.constant or self.textured(side, primitive.uv(e, d, t, p))
        if terms.ambient is not None:
            k_a, i_a = terms.ambient, self.ambient
            red += k_a[0] * i_a[0]
            green += k_a[1] * i_a[1]
            blue += k_a[2] * i_a[2]

        for light in self.lights:
            arrival = light.arrive(*p)
            if arrival is None:
                continue  # outside its cone
            lx, ly, lz, distance, i = arrival
            n_l = nx * lx + ny * ly + nz * lz
            if not self.positive("horizon", n_l, gx * lx + gy * ly + gz * lz, light):
                if distance == 0:
                    self.ties.append((surface.id, light.id))
                continue  # below the horizon
            l = (lx, ly, lz)  # noqa: E741
            if self._shadows and self.blocker(p, l, distance, primitive, light) is not None:
                continue
            r, g, b = self.reflected(terms, i, n, d, l, n_l)
            red += r
            green += g
            blue += b

        k_m = terms.mirror
        if k_m is not None:
            r = (dx + 2 * n_v * nx, dy + 2 * n_v * ny, dz + 2 * n_v * nz)  # d - 2 (d.n) n
            if self.positive("mirror", n_v, gx * r[0] + gy * r[1] + gz * r[2]):
                if self._unlimited:
                    share = (share[0] * k_m[0], share[1] * k_m[1], share[2] * k_m[2])
                    if k + 1 > LAST_BOUNCE or self.exhausted(share):
                        return red, green, blue
                away = primitive if self._exact else None
                seen = self.raycolor(p, r, self.start, self._infinity, k + 1, away, share)
                red += k_m[0] * seen[0]
                green += k_m[1] * seen[1]
                blue += k_m[2] * seen[2]
        return red, green, blue

    def behind(self, n_v: Number) -> bool:
        """Decide whether a two-sided surface is seen from behind."""
        seen: bool = n_v < 0
        return seen

    def positive(self, kind: str, x: Number, y: Number, light: lights.Light | None = None) -> bool:
        """Decide by two cosines, one with n and one with n_g, whether both sides are seen.

        `kind` says what is decided: `facing` the eye, above the `horizon` for a light, or whether the
        `mirror` ray leaves the surface. (`ray_tree` listens here.)
        """
        both: bool = x > 0 and y > 0
        return both

    def exhausted(self, share: Colour) -> bool:
        """Decide whether what the mirrors pass on has become too little to follow."""
        return all(x < self._least_share for x in share)

    def textured(self, side: Material, uv: tuple[Number, Number]) -> Terms:
        """Return the coefficients at surface coordinates (u, v)."""
        return side.at(*uv)

    def reflected(self, terms: Terms, i: Colour, n: Vec, d: Vec, l: Vec, n_l: Number) -> Colour:  # noqa: E741
        """Return k_d I (n.l) + k_s I max(0, n.h)^exponent."""
        k_d, k_s = terms.diffuse, terms.specular
        if k_s is None:
            return k_d[0] * i[0] * n_l, k_d[1] * i[1] * n_l, k_d[2] * i[2] * n_l
        highlight = self.highlight(n, d, l, terms.exponent)
        return (
            i[0] * (k_d[0] * n_l + k_s[0] * highlight),
            i[1] * (k_d[1] * n_l + k_s[1] * highlight),
            i[2] * (k_d[2] * n_l + k_s[2] * highlight),
        )

    def first_hit(
        self, e: Vec, d: Vec, start: Number, end: Number, leaving: Primitive | None
    ) -> tuple[Primitive, Number] | tuple[None, None]:
        """Return the nearest primitive with start < t <= end and its t; the first in the scene of equals."""
        found = self._world.hits(e, d, start, end, leaving)
        if not found:
            return None, None
        if len(found) > 1:
            found.sort()
            if found[1][0] <= found[0][0] * self._stretch:
                self._note_ties(e, d, found)
        t, _, primitive = found[0]
        return primitive, t

    def blocker(
        self,
        p: Vec,
        l: Vec,  # noqa: E741
        distance: Number,
        leaving: Primitive,
        light: lights.Light,
    ) -> Primitive | None:
        """Return a primitive on the open segment of that length from p along l to a light, or None."""
        found = self._world.blocker(p, l, self.start, distance, leaving if self._exact else None)
        if found is None:
            return None
        t, _, primitive = found
        if not t * self._stretch < distance:
            self.ties.append((primitive.surface.id, light.id))
        return primitive if t < distance else None

    def highlight(self, n: Vec, d: Vec, l: Vec, exponent: Number) -> Number:  # noqa: E741
        """Return max(0, n.h)^exponent with h = (v + l) / |v + l| and v = -d."""
        arithmetic = self.arithmetic
        hx, hy, hz = l[0] - d[0], l[1] - d[1], l[2] - d[2]
        squared = hx * hx + hy * hy + hz * hz
        if exponent <= SMALL_EXPONENT:
            n_h = (n[0] * hx + n[1] * hy + n[2] * hz) / arithmetic.sqrt(squared)
            return arithmetic.power(n_h, exponent) if n_h > 0 else 0
        if dot(n, (hx, hy, hz)) <= 0:
            return 0
        # (n.h)^p = (1 - |n x h|^2)^(p/2): near the peak the sine is known far better than the cosine.
        sine = cross(n, (hx, hy, hz))
        sine_squared = dot(sine, sine) / squared
        if sine_squared >= 1:
            return 0
        return arithmetic.exp(arithmetic.log1p(-sine_squared) * exponent / 2)

    def _note_ties(self, e: Vec, d: Vec, found: Sequence[tuple[Number, int, Primitive]]) -> None:
        """Remember candidates at the same distance that differ in material or normal."""
        t, _, first = found[0]
        p = (e[0] + t * d[0], e[1] + t * d[1], e[2] + t * d[2])
        n = first.normals(e, d, t, p)[0]
        for other_t, _, other in found[1:]:
            if other_t > t * self._stretch:
                break
            m = other.normals(e, d, t, p)[0]
            apart = max(abs(a - b) for a, b in zip(n, m, strict=True))
            if other.surface is not first.surface or apart > self.arithmetic.closeness:
                self.ties.append((first.surface.id, other.surface.id))


def _primitives(shapes: Sequence[scene.Shape], settings: scene.Settings, arithmetic: Arithmetic) -> Iterator[Primitive]:
    """Build the primitives of all shapes, in the order of the file."""
    for shape in shapes:
        if isinstance(shape, scene.Instance):
            for inner in _primitives(shape.shapes, settings, arithmetic):
                placed = Placed(inner, shape.to_world, arithmetic)
                placed.surface = replace(inner.surface, id=f"{shape.id}/{inner.surface.id}")
                yield placed
        else:
            surface = _surface(shape.look, settings, arithmetic)
            for primitive in _of_shape(shape, arithmetic):
                primitive.surface = surface
                yield primitive


def _of_shape(shape: scene.Solid, arithmetic: Arithmetic) -> list[Primitive]:
    match shape:
        case scene.Sphere():
            return [Sphere(shape, arithmetic)]
        case scene.Rectangle():
            return [Parallelogram(shape, arithmetic)]
        case scene.Disk():
            return [Disk(shape, arithmetic)]
        case scene.Cylinder():
            return [Cylinder(shape, arithmetic)]
        case scene.Mesh():
            return triangles(shape, arithmetic)
        case scene.Polygon():
            return [Polygon(shape, arithmetic)]


def _surface(look: scene.Look, settings: scene.Settings, arithmetic: Arithmetic) -> Surface:
    material = look.material
    back = None
    if isinstance(material, scene.TwoSided):
        back = Material(material.behind, settings, arithmetic)
        material = material.front
    emission: Colour | None = None if look.emission is None else arithmetic.vec(look.emission)
    return Surface(look.id, Material(material, settings, arithmetic), back, emission)
