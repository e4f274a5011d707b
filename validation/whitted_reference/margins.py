"""How far does a ray pass from the outline of a primitive? For those who ask what nearly happened.

A margin is the distance, in world units, by which the ray's line may move sideways before it meets what
it misses, or misses what it meets; positive where it meets. For spheres, parallelograms, triangles and
polygons it is that distance, for disks, tubes and instances a lower bound. It is computed in floats: it
says how close a decision was, it never decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from whitted_reference.instances import Placed
from whitted_reference.polygon import Polygon
from whitted_reference.shapes import Cylinder, Disk, Parallelogram, Primitive, Sphere
from whitted_reference.triangles import Triangle
from whitted_reference.vectors import Vec, add, dot, scaled, sub


@dataclass(frozen=True)
class Margin:
    """Signed distance to the outline, the distance t along the ray there, and what the outline is."""

    distance: float
    t: float
    kind: str


def margin(primitive: Primitive, e: Vec, d: Vec) -> Margin | None:
    """Return the margin of the ray's whole line, behind e included; None if it is parallel to a plane."""
    match primitive:
        case Placed():
            inner_e, inner_d, length = primitive.inner_ray(e, d)
            inner = margin(primitive.primitive, inner_e, inner_d)
            # Distances inside are at most `stretch` times those outside: a margin that is certain.
            return inner and Margin(inner.distance / primitive.stretch, inner.t / length, inner.kind)
        case Sphere():
            x, y, z, rr = primitive.data
            t = dot(sub((x, y, z), e), d)
            return Margin(math.sqrt(rr) - math.dist(add(e, scaled(d, t)), (x, y, z)), t, "silhouette")
        case Cylinder():
            return _cylinder(primitive, e, d)
        case Disk():
            return _disk(primitive, e, d)
        case Parallelogram() | Triangle() | Polygon():
            return _flat(primitive, e, d)
    raise TypeError(primitive)


def _flat(primitive: Parallelogram | Triangle | Polygon, e: Vec, d: Vec) -> Margin | None:
    """Take the nearest side; inside is what the primitive itself says of the whole line."""
    nearest = min((_line_to_side(e, d, a, b) for a, b in primitive.sides()), key=lambda found: found[0])
    inside = _meets_line(primitive, e, d)
    t = nearest[1] if inside is None else inside
    kind = {Parallelogram: "rectangle edge", Triangle: "triangle edge", Polygon: "polygon edge"}[type(primitive)]
    return Margin(nearest[0] if inside is not None else -nearest[0], t, kind)


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


def _disk(primitive: Disk, e: Vec, d: Vec) -> Margin | None:
    a, b, c = primitive.frame
    n = primitive.data[3:6]
    slope = dot(n, d)
    t = dot(sub(c, e), n) / slope if slope else dot(sub(c, e), d)
    return Margin(_ellipse(sub(e, c), a, b, d), t, "rim")


def _cylinder(primitive: Cylinder, e: Vec, d: Vec) -> Margin:
    """Bound the distance from the outline: two ellipses, the band between them, and the hole of both."""
    x, y, z, wx, wy, wz, length, rr = primitive.data
    w, base = (wx, wy, wz), (x, y, z)
    a, b = primitive.axes
    off = sub(e, base)
    ends = [_ellipse(off, a, b, d), _ellipse(sub(off, scaled(w, length)), a, b, d)]
    axis = _seen(w, d)
    across = math.sqrt(dot(axis, axis))
    t = _meets_line(primitive, e, d)
    band = -math.inf
    middle = -dot(off, d)
    if across > 0.0:
        along = dot(_seen(off, d), axis) / across
        aside = math.sqrt(max(dot(_seen(off, d), _seen(off, d)) - along * along, 0.0))
        band = min(math.sqrt(rr) - aside, along, length * across - along)
        middle = (dot(off, w) * dot(w, d) - dot(off, d)) / (across * across)
    outer = max(*ends, band)  # inside the outline of the tube with its ends closed
    hole = min(ends)  # through both ends: nothing is met
    if outer < 0.0:
        return Margin(outer, middle, "silhouette")
    if t is None:
        return Margin(-max(hole, 0.0), middle, "cylinder end")
    by = min(outer, max(-hole, 0.0))
    return Margin(by, t, "silhouette" if by == outer else "cylinder end")
