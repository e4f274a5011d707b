"""The primitives that rays meet: one class each, intersection first.

Every primitive answers four questions about a ray e + t d with |d| = 1:

`hit(e, d, start, end)`
    the smallest t with start < t <= end at which the ray meets it, or None;
`again(e, d, start, end)`
    the same for a ray that leaves it at e: the meeting at e itself does not count;
`normals(e, d, t, p)`
    the unit shading normal n at p = e + t d and the unit geometric normal, turned so that n_g.n >= 0;
`uv(e, d, t, p)`
    the surface coordinates at p.

The first two take e and d as six numbers and are the inner loop of the tracer: each unpacks what it
needs into locals once. Numbers are of any arithmetic (see `arithmetic`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from whitted_reference import scene
from whitted_reference.arithmetic import Arithmetic
from whitted_reference.materials import Material
from whitted_reference.transforms import Affine
from whitted_reference.vectors import Colour, Number, Vec, add, cross, dot, negated, scaled, sub

Box = tuple[float, float, float, float, float, float]  # least x, y, z, greatest x, y, z


@dataclass(frozen=True, eq=False)
class Surface:
    """What all primitives of one shape share.

    Attributes
    ----------
    back : the material behind, or None if the shape is one-sided
    emission : colour sent out by the front, or None
    """

    id: str
    front: Material
    back: Material | None
    emission: Colour | None


class Primitive:
    """Base of all: its place in the scene's order, its surface, and a box around it."""

    __slots__ = ("box", "data", "index", "surface")

    index: int
    surface: Surface
    box: Box
    data: tuple[Any, ...]

    def hit(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Return the first t in (start, end], or None."""
        raise NotImplementedError

    def again(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Return the first t in (start, end] apart from that of e itself; a flat primitive has none."""
        return None

    def normals(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec]:
        """Return n and n_g at p; one and the same object where they are equal by definition."""
        raise NotImplementedError

    def uv(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Number, Number]:
        """Return the surface coordinates at p."""
        raise NotImplementedError


def unit(v: Vec, arithmetic: Arithmetic) -> Vec:
    """Return v / |v|."""
    length = arithmetic.sqrt(dot(v, v))
    return v[0] / length, v[1] / length, v[2] / length


def turned(g: Vec, n: Vec) -> Vec:
    """Return g or -g, whichever lies on n's side."""
    return negated(g) if dot(g, n) < 0 else g


def _azimuth(x: Number, y: Number, arithmetic: Arithmetic) -> Number:
    """Return the angle of (x, y) from +x towards +y as a fraction of a full turn, in [0, 1)."""
    turn = arithmetic.atan2(y, x) / (2 * arithmetic.pi)
    return turn + 1 if turn < 0 else turn


def box_of(points: Sequence[tuple[float, ...]]) -> Box:
    """Return the box around points."""
    xs, ys, zs = zip(*points, strict=True)
    return min(xs), min(ys), min(zs), max(xs), max(ys), max(zs)


class Sphere(Primitive):
    """A sphere by the stable quadratic.

    With x = e - centre the roots of |x + t d| = r are t = -b -+ sqrt(r^2 - |x - b d|^2), b = x.d. The
    radicand is formed from the closest approach x - b d, which does not cancel for a distant eye
    (Haines, Guenther and Akenine-Moeller 2019); the root of smaller magnitude comes from the product of
    the roots, |x|^2 - r^2.
    """

    __slots__ = ("_arithmetic", "_axes", "_inward", "_sqrt")

    def __init__(self, shape: scene.Sphere, arithmetic: Arithmetic) -> None:
        radius = arithmetic.of(shape.radius)
        self.data = (*arithmetic.vec(shape.centre), radius * radius)
        self._sqrt = arithmetic.sqrt
        self._arithmetic = arithmetic
        self._inward = shape.inward
        self._axes = [arithmetic.vec(shape.to_world.column(j)) for j in range(3)]
        centre, r = shape.centre, shape.radius
        self.box = box_of([tuple(c - r for c in centre), tuple(c + r for c in centre)])

    def hit(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Return the smaller root in (start, end], or else the greater."""
        x, y, z, rr = self.data
        x = ex - x
        y = ey - y
        z = ez - z
        b = x * dx + y * dy + z * dz
        c = x * x + y * y + z * z - rr
        if b > 0 and c > 0:  # outside and moving away
            return None
        x -= b * dx
        y -= b * dy
        z -= b * dz
        radicand = rr - (x * x + y * y + z * z)
        if radicand < 0:
            return None
        root = self._sqrt(radicand)
        if b > 0:
            near = -b - root
            far = c / near
        else:
            far = root - b
            near = c / far if far > 0 else far
        if near > start:
            return near if near <= end else None
        return far if start < far <= end else None

    def again(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Return the root other than 0: with e on the sphere the two add up to -2 b."""
        x, y, z, _ = self.data
        t = -2 * ((ex - x) * dx + (ey - y) * dy + (ez - z) * dz)
        return t if start < t <= end else None

    def normals(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec]:
        """Return the direction from the centre (to it, if turned inside out) twice."""
        x, y, z, _ = self.data
        x = p[0] - x
        y = p[1] - y
        z = p[2] - z
        length = self._sqrt(x * x + y * y + z * z)
        if self._inward:
            length = -length
        n = (x / length, y / length, z / length)
        return n, n

    def uv(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Number, Number]:
        """Return azimuth / 2 pi and polar angle / pi about the local z axis."""
        arithmetic = self._arithmetic
        x, y, z = (dot(sub(p, self.data[:3]), axis) for axis in self._axes)
        polar = arithmetic.atan2(self._sqrt(x * x + y * y), z)
        return _azimuth(x, y, arithmetic), polar / arithmetic.pi


class _Flat(Primitive):
    """A bounded part of the plane through c spanned by a and b, in coordinates x, y with p = c + x a + y b.

    By Cramer's rule, with N = a x b: t = (c - e).N / d.N, x = q.(b x N) / N.N, y = q.(N x a) / N.N where
    q = p - c.
    """

    __slots__ = ("_arithmetic", "_g", "_n", "frame")

    def __init__(self, to_world: Affine, flip: bool, arithmetic: Arithmetic) -> None:
        a, b, c = (arithmetic.vec(to_world.column(j)) for j in (0, 1, 3))
        self.frame: tuple[Vec, Vec, Vec] = (a, b, c)
        normal = cross(a, b)
        squared = dot(normal, normal)
        to_x = scaled(cross(b, normal), 1 / squared)
        to_y = scaled(cross(normal, a), 1 / squared)
        self.data = (*c, *normal, *to_x, *to_y)
        self._arithmetic = arithmetic
        n = unit(arithmetic.vec(to_world.normal_column(2)), arithmetic)
        self._n = negated(n) if flip else n
        self._g = turned(unit(normal, arithmetic), self._n)

    def normals(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec]:
        """Return M^-T z (reversed if flipped) and a x b, everywhere the same."""
        return self._n, self._g

    def world(self, xy: tuple[Number, Number]) -> Vec:
        """Return c + x a + y b."""
        a, b, c = self.frame
        return add(c, add(scaled(a, xy[0]), scaled(b, xy[1])))

    def local(self, p: Vec) -> tuple[Number, Number]:
        """Return x and y of a point of the plane."""
        cx, cy, cz, _, _, _, xx, xy, xz, yx, yy, yz = self.data
        qx, qy, qz = p[0] - cx, p[1] - cy, p[2] - cz
        return qx * xx + qy * xy + qz * xz, qx * yx + qy * yy + qz * yz


class Parallelogram(_Flat):
    """Mitsuba's rectangle: |x| <= 1 and |y| <= 1, sides included."""

    __slots__ = ()

    def __init__(self, shape: scene.Rectangle, arithmetic: Arithmetic) -> None:
        super().__init__(shape.to_world, shape.flip, arithmetic)
        a, b, c = (shape.to_world.column(j) for j in (0, 1, 3))
        corners = [(x, y) for x in (-1, 1) for y in (-1, 1)]
        self.box = box_of([tuple(c[i] + x * a[i] + y * b[i] for i in range(3)) for x, y in corners])

    def hit(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Meet the plane, then ask for the sides."""
        cx, cy, cz, nx, ny, nz, xx, xy, xz, yx, yy, yz = self.data
        slope = dx * nx + dy * ny + dz * nz
        if slope == 0:
            return None
        qx = ex - cx
        qy = ey - cy
        qz = ez - cz
        t = -(qx * nx + qy * ny + qz * nz) / slope
        if start < t <= end:
            qx += t * dx
            qy += t * dy
            qz += t * dz
            if -1 <= qx * xx + qy * xy + qz * xz <= 1 and -1 <= qx * yx + qy * yy + qz * yz <= 1:
                return t
        return None

    def sides(self) -> list[tuple[Vec, Vec]]:
        """Return the two ends of each side."""
        ring = [self.world((x, y)) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return list(zip(ring, [*ring[1:], ring[0]], strict=True))

    def uv(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Number, Number]:
        """Return (x + 1) / 2 and (y + 1) / 2."""
        x, y = self.local(p)
        return (x + 1) / 2, (y + 1) / 2


class Disk(_Flat):
    """x^2 + y^2 <= 1, rim included."""

    __slots__ = ()

    def __init__(self, shape: scene.Disk, arithmetic: Arithmetic) -> None:
        super().__init__(shape.to_world, shape.flip, arithmetic)
        a, b, c = (shape.to_world.column(j) for j in (0, 1, 3))
        reach = [abs(a[i]) + abs(b[i]) for i in range(3)]
        self.box = box_of([tuple(c[i] + s * reach[i] for i in range(3)) for s in (-1, 1)])

    def hit(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Meet the plane, then ask for the rim."""
        cx, cy, cz, nx, ny, nz, xx, xy, xz, yx, yy, yz = self.data
        slope = dx * nx + dy * ny + dz * nz
        if slope == 0:
            return None
        qx = ex - cx
        qy = ey - cy
        qz = ez - cz
        t = -(qx * nx + qy * ny + qz * nz) / slope
        if start < t <= end:
            qx += t * dx
            qy += t * dy
            qz += t * dz
            x = qx * xx + qy * xy + qz * xz
            y = qx * yx + qy * yy + qz * yz
            if x * x + y * y <= 1:
                return t
        return None

    def uv(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Number, Number]:
        """Return the radius and the azimuth as a fraction of a turn."""
        x, y = self.local(p)
        return self._arithmetic.sqrt(x * x + y * y), _azimuth(x, y, self._arithmetic)


class Cylinder(Primitive):
    """A tube of radius |M x| about the axis from M 0 to M z, without caps, both ends included.

    With w the unit axis, and x and d split into parts along w and across it, the roots of
    |x' + t d'| = r are found as for the sphere.
    """

    __slots__ = ("_arithmetic", "_inward", "_sqrt", "axes")

    def __init__(self, shape: scene.Cylinder, arithmetic: Arithmetic) -> None:
        self._arithmetic = arithmetic
        self._sqrt = arithmetic.sqrt
        self._inward = shape.inward
        a, b, axis, base = (arithmetic.vec(shape.to_world.column(j)) for j in range(4))
        length = arithmetic.sqrt(dot(axis, axis))
        self.data = (*base, *unit(axis, arithmetic), length, dot(a, a))
        self.axes = (a, b)
        columns = [shape.to_world.column(j) for j in range(4)]
        reach = [abs(columns[0][i]) + abs(columns[1][i]) for i in range(3)]
        self.box = box_of(
            [tuple(columns[3][i] + h * columns[2][i] + s * reach[i] for i in range(3)) for h in (0, 1) for s in (-1, 1)]
        )

    def roots(
        self, ex: Number, ey: Number, ez: Number, dx: Number, dy: Number, dz: Number
    ) -> tuple[Number, Number] | None:
        """Return both t at which the line meets the tube as if it had no ends, or None."""
        x, y, z, wx, wy, wz, _, rr = self.data
        x = ex - x
        y = ey - y
        z = ez - z
        height = x * wx + y * wy + z * wz
        climb = dx * wx + dy * wy + dz * wz
        x -= height * wx
        y -= height * wy
        z -= height * wz
        dx -= climb * wx
        dy -= climb * wy
        dz -= climb * wz
        a = dx * dx + dy * dy + dz * dz
        if a == 0:
            return None
        b = x * dx + y * dy + z * dz
        c = x * x + y * y + z * z - rr
        s = b / a
        x -= s * dx
        y -= s * dy
        z -= s * dz
        radicand = a * (rr - (x * x + y * y + z * z))
        if radicand < 0:
            return None
        root = self._sqrt(radicand)
        if b > 0:
            return (-b - root) / a, c / (-b - root)
        far = (root - b) / a
        return (c / (root - b) if far > 0 else far), far

    def hit(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Return the first of the two roots that lies in (start, end] and between the ends."""
        found = self.roots(ex, ey, ez, dx, dy, dz)
        if found is None:
            return None
        x, y, z, wx, wy, wz, length, _ = self.data
        height = (ex - x) * wx + (ey - y) * wy + (ez - z) * wz
        climb = dx * wx + dy * wy + dz * wz
        for t in found:
            if start < t <= end and 0 <= height + t * climb <= length:
                return t
        return None

    def again(
        self,
        ex: Number,
        ey: Number,
        ez: Number,
        dx: Number,
        dy: Number,
        dz: Number,
        start: Number,
        end: Number,
    ) -> Number | None:
        """Return the root other than 0: with e on the tube the two add up to -2 b / a."""
        x, y, z, wx, wy, wz, length, _ = self.data
        x = ex - x
        y = ey - y
        z = ez - z
        height = x * wx + y * wy + z * wz
        climb = dx * wx + dy * wy + dz * wz
        dx -= climb * wx
        dy -= climb * wy
        dz -= climb * wz
        a = dx * dx + dy * dy + dz * dz
        if a == 0:
            return None
        t = -2 * (x * dx + y * dy + z * dz) / a
        return t if start < t <= end and 0 <= height + t * climb <= length else None

    def _across(self, p: Vec) -> tuple[Vec, Number]:
        base, w = self.data[:3], self.data[3:6]
        x = sub(p, base)
        height = dot(x, w)
        return sub(x, scaled(w, height)), height

    def normals(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Vec, Vec]:
        """Return the direction away from the axis (towards it, if flipped) twice."""
        n = unit(self._across(p)[0], self._arithmetic)
        if self._inward:
            n = negated(n)
        return n, n

    def uv(self, e: Vec, d: Vec, t: Number, p: Vec) -> tuple[Number, Number]:
        """Return the azimuth as a fraction of a turn, and the height as a fraction of the length."""
        across, height = self._across(p)
        x, y = (dot(across, axis) for axis in self.axes)
        return _azimuth(x, y, self._arithmetic), height / self.data[6]
