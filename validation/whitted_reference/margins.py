"""How does a ray's line pass a primitive? For those who ask what nearly happened.

A margin is the distance, in world units, by which the line may move sideways before a yes/no decision about
it falls otherwise; positive where the answer is yes. For the outlines of spheres, parallelograms, triangles
and polygons it is that distance, for disks, tubes and instances a lower bound. It is computed in floats: it
says how close a decision was, it never decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from whitted_reference.instances import Placed
from whitted_reference.polygon import Polygon
from whitted_reference.shapes import Cylinder, Disk, Parallelogram, Primitive, Sphere
from whitted_reference.triangles import Triangle
from whitted_reference.vectors import Vec, add, dot, scaled, sub


@dataclass(frozen=True)
class Place:
    """Where the line meets the surface: the distance t along it, and the margin by which it does so."""

    t: float
    distance: float = math.inf
    kind: str = ""


@dataclass(frozen=True)
class Passing:
    """How a line passes a primitive.

    Attributes
    ----------
    distance : margin from the outline, as the line sees it
    kind : what the outline is
    places : where the line meets the surface, in order; if it passes outside, where a line would that passes
        as far inside
    """

    distance: float
    kind: str
    places: tuple[Place, ...]


@dataclass(frozen=True)
class Margin:
    """Bound of the distance by which a line may move before it meets what it misses, or the reverse; where; of what."""

    distance: float
    t: float
    kind: str


def margin(primitive: Primitive, e: Vec, d: Vec) -> Margin | None:
    """Return the margin of the ray's whole line, behind e included; None if it is parallel to a plane or tube."""
    near = passing(primitive, e, d)
    if near is None:
        return None
    met = max(near.places, key=lambda place: place.distance)  # while this one is met, the primitive is
    if met.distance < near.distance:
        return Margin(met.distance, met.t, met.kind)
    return Margin(near.distance, near.places[0].t, near.kind)


def passing(primitive: Primitive, e: Vec, d: Vec) -> Passing | None:
    """Follow the whole line through e, behind e included; None if it is parallel to a plane or tube."""
    match primitive:
        case Placed():
            inner_e, inner_d, length = primitive.inner_ray(e, d)
            inner = passing(primitive.primitive, inner_e, inner_d)
            if inner is None:
                return None
            # Distances inside are at most `stretch` times those outside: a margin that is certain.
            stretch = primitive.stretch
            places = tuple(Place(p.t / length, p.distance / stretch, p.kind) for p in inner.places)
            return Passing(inner.distance / stretch, inner.kind, places)
        case Sphere():
            return _sphere(primitive, e, d)
        case Cylinder():
            return _cylinder(primitive, e, d)
        case Disk():
            return _disk(primitive, e, d)
        case Parallelogram() | Triangle() | Polygon():
            return _flat(primitive, e, d)
    raise TypeError(primitive)


def _flat(primitive: Parallelogram | Triangle | Polygon, e: Vec, d: Vec) -> Passing | None:
    """Take the nearest side; inside is what the primitive itself says of the whole line."""
    nearest = min((_line_to_side(e, d, a, b) for a, b in primitive.sides()), key=lambda found: found[0])
    inside = _meets_line(primitive, e, d)
    kind = {Parallelogram: "rectangle edge", Triangle: "triangle edge", Polygon: "polygon edge"}[type(primitive)]
    if inside is None:
        return Passing(-nearest[0], kind, (Place(nearest[1]),))
    return Passing(nearest[0], kind, (Place(inside),))


def _sphere(primitive: Sphere, e: Vec, d: Vec) -> Passing:
    x, y, z, rr = primitive.data
    middle = dot(sub((x, y, z), e), d)
    radius = math.sqrt(rr)
    inside = radius - math.dist(add(e, scaled(d, middle)), (x, y, z))
    near = _meets_line(primitive, e, d)
    if near is not None:
        far: float | None = primitive.hit(*e, *d, near, math.inf)
        return Passing(abs(inside), "silhouette", (Place(near), Place(near if far is None else far)))
    back = (-d[0], -d[1], -d[2])
    behind = _meets_line(primitive, e, back)  # what is moved away from has not been asked for
    if behind is not None:
        farther = primitive.hit(*e, *back, behind, math.inf)
        return Passing(abs(inside), "silhouette", (Place(-(farther or behind)), Place(-behind)))
    half = _half_chord(radius, -abs(inside))
    return Passing(-abs(inside), "silhouette", (Place(middle - half), Place(middle + half)))


def _half_chord(radius: float, outside: float) -> float:
    """Return half the chord of a line that passes as far inside a circle as this one passes outside."""
    return math.sqrt(max(-outside * (2.0 * radius + outside), 0.0))


def _meets_line(primitive: Primitive, e: Vec, d: Vec) -> float | None:
    t: float | None = primitive.hit(*e, *d, -math.inf, math.inf)
    return t


def _line_to_side(e: Vec, d: Vec, a: Vec, b: Vec) -> tuple[float, float]:
    """Return the distance between the line e + t d and the segment from a to b, and t there."""
    side = sub(b, a)
    along = dot(side, d)
    across = dot(side, side) - along * along  # squared length of the side as the ray sees it
    s = 0.0
    if across > 0.0:
        from_a = sub(e, a)
        s = min(max((dot(side, from_a) - along * dot(d, from_a)) / across, 0.0), 1.0)
    q = add(a, scaled(side, s))
    t = dot(sub(q, e), d)
    return math.dist(add(e, scaled(d, t)), q), t


def _ellipse(off: Vec, a: Vec, b: Vec, d: Vec) -> float:
    """Return a signed lower bound of the distance to an ellipse seen along d, positive inside.

    `off` leads from its centre to the ray. In coordinates x, y along a and b as the ray sees them,
    r = |(x, y)| is 1 on the ellipse and changes at most by 1 / (smaller half-axis) per unit of length.
    """
    a, b, off = _seen(a, d), _seen(b, d), _seen(off, d)
    aa, ab, bb = dot(a, a), dot(a, b), dot(b, b)
    determinant = aa * bb - ab * ab
    smaller = 2.0 * determinant / (aa + bb + math.sqrt((aa - bb) ** 2 + 4.0 * ab * ab))
    if smaller <= 1e-24 * (aa + bb):  # seen edge-on: a slit of no width
        smaller, r = 0.0, math.inf
    else:
        u, v = dot(off, a), dot(off, b)
        r = math.hypot((bb * u - ab * v) / determinant, (aa * v - ab * u) / determinant)
    if r <= 1.0:
        return (1.0 - r) * math.sqrt(smaller)
    beyond = math.sqrt(dot(off, off)) - math.sqrt(aa + bb)  # the ellipse lies in a circle
    slit = abs(dot(off, a)) - math.sqrt(aa * aa + ab * ab), abs(dot(off, b)) - math.sqrt(bb * bb + ab * ab)
    widths = slit[0] / math.sqrt(aa) if aa else 0.0, slit[1] / math.sqrt(bb) if bb else 0.0
    return -max((r - 1.0) * math.sqrt(smaller) if r < math.inf else 0.0, beyond, *widths)


def _seen(v: Vec, d: Vec) -> Vec:
    """Return the part of v across d."""
    return sub(v, scaled(d, dot(v, d)))


def _disk(primitive: Disk, e: Vec, d: Vec) -> Passing | None:
    a, b, c = primitive.frame
    n = primitive.data[3:6]
    slope = dot(n, d)
    t = _meets_line(primitive, e, d)
    by = _ellipse(sub(e, c), a, b, d)
    if t is not None:
        return Passing(abs(by), "rim", (Place(t),))
    t = dot(sub(c, e), n) / slope if slope else dot(sub(c, e), d)
    return Passing(-abs(by), "rim", (Place(t),))


def _cylinder(primitive: Cylinder, e: Vec, d: Vec) -> Passing | None:
    """Take the sides of the tube, without end, for its outline; each of the two walls has its own ends."""
    x, y, z, wx, wy, wz, length, rr = primitive.data
    w, radius = (wx, wy, wz), math.sqrt(rr)
    off = sub(e, (x, y, z))
    height, climb = dot(off, w), dot(d, w)
    across = math.sqrt(max(1.0 - climb * climb, 0.0))
    if across == 0.0:
        return None
    middle = (height * climb - dot(off, d)) / (across * across)
    at = sub(add(off, scaled(d, middle)), scaled(w, height + middle * climb))
    inside = radius - math.sqrt(dot(at, at))
    walls = primitive.roots(*e, *d)
    if walls is None:
        half = _half_chord(radius, -abs(inside)) / across
        walls = (middle - half, middle + half)
        inside = -abs(inside)
    else:
        inside = abs(inside)
    heights = [height + t * climb for t in walls]
    a, b = primitive.axes
    rims = [abs(_ellipse(sub(off, scaled(w, h)), a, b, d)) for h in (0.0, length)]
    places = tuple(_wall(t, h, heights, rims, length) for t, h in zip(walls, heights, strict=True))
    return Passing(inside, "silhouette", places)


def _wall(t: float, h: float, heights: Sequence[float], rims: Sequence[float], length: float) -> Place:
    """Bound how far a wall is from its ends: the line passes a rim at the wall whose height is closer to it."""
    by = math.inf
    for end, rim in zip((0.0, length), rims, strict=True):
        # Where the walls run together, at the outline, a rim may belong to either: hence twice.
        if abs(h - end) <= 2.0 * min(abs(other - end) for other in heights):
            by = min(by, rim)
    return Place(t, by if 0.0 <= h <= length else -by, "cylinder end")
