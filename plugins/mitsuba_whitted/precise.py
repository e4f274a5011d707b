"""Every remedy against rounding, each with its error bound; u = 2^-24 is the unit roundoff of single precision.

A search, Embree's or ours, works in single precision and says which primitive a ray meets first. Where the ray meets
it is computed here again, in double and from the primitive's own numbers, and so are the normal and the ray that a
mirror sends on: no error of a search or of a bounce reaches the next, and a chain of mirrors loses 29 bits less than
single precision would. What a colour is made of (l, h, n.l, (n.h)^p) is then single again. Doubles cost about a tenth
of a frame (`whitted benchmark speed`): few formulas hold them, and these need no other remedy.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi

UNIT_ROUNDOFF = 2.0**-24
"""Largest relative error of one rounding to float32."""

OFFSET_ROUNDOFFS = 8
"""Offset of a ray's start, in unit roundoffs of ``sum |n_i| reach_i``.

A point rounded to single is off its plane by u of that sum, and by as much again once it is shifted. Embree's own
test of the offset ray against the plane that it left (difference 1, dot product 3) errs by another 4 u, and the normal
that the shift goes along is rounded too: 7, and one in hand.
"""

LEAST = 2.0**-126
"""The least float32 that is never rounded to 0."""

LEAST_CHORD = 64 * 2.0**-53
"""Least half chord of a ray in a round surface that a search says it meets, in units of radius and distance.

Past the outline by less than the search rounds, the exact surface is missed: the normal would be square to the ray,
its front a matter of luck, and the pixel black between two that are lit. In double, the foot of the perpendicular
(difference 1, product 4, sum 1) and its product with the direction (4) cannot hide 16 roundings; an instance that
brings the normal out adds its own.
"""

SEARCHED = 16 * UNIT_ROUNDOFF
"""How far off the distance that a search tells may be, in units of radius and distance.

The chord of `few` 7 roundings, its root 1, Embree's own and the lead 3; with room.
"""


def rcp(x: Any) -> Any:
    """Divide 1 by a double, to the last bit: on a GPU ``dr.rcp`` keeps 20 bits of it."""
    return 1 / x if dr.is_jit_v(x) else dr.rcp(x)  # Python's own 1 / 0 would be an error


def sphere_normal(w: Any, d: Any, r: Any, t: Any) -> Any:
    """Find the vector from the centre c to where the ray c + `w` + s `d` meets the sphere, s close to `t`.

    Its length is `r`. The foot of the perpendicular from the centre replaces the textbook's quadratic, whose
    discriminant loses twice the digits of |w| / r (Haines, Günther, Akenine-Möller, *Ray Tracing Gems* 7, 2019).
    """
    b = -dr.dot(w, d)
    foot = dr.fma(b, d, w)
    half_chord = dr.maximum(dr.safe_sqrt(r * r - dr.squared_norm(foot)), LEAST_CHORD * (r + dr.abs(b)))
    return dr.fma(dr.select(_is_near(t, b, r), -half_chord, half_chord), d, foot)


def _is_near(t: Any, b: Any, r: Any) -> Any:
    """Whether `t` is the nearer of the two hits about the foot at `b`; the nearer too where they are as good as one."""
    return t < b + SEARCHED * (r + dr.abs(b))


def cylinder_point(w: Any, d: Any, axis: Any, r: Any, t: Any) -> tuple[Any, Any]:
    """Where the ray a + `w` + s `d` meets the cylinder of radius `r` about the line through a.

    The results are the vectors there from a, and from that line. The sphere's argument in the plane across the unit
    vector `axis`; the height along it follows from the ray.
    """
    d_across = dr.fma(-dr.dot(d, axis), axis, d)
    w_across = dr.fma(-dr.dot(w, axis), axis, w)
    inv_d2 = rcp(dr.squared_norm(d_across))
    b = -dr.dot(w_across, d_across) * inv_d2
    foot = dr.fma(b, d_across, w_across)
    half_chord = dr.maximum(dr.safe_sqrt((r * r - dr.squared_norm(foot)) * inv_d2), LEAST_CHORD * (r + dr.abs(b)))
    step = dr.select(_is_near(t, b, r), -half_chord, half_chord)
    return dr.fma(b + step, d, w), dr.fma(step, d_across, foot)


def plane_point(w: Any, d: Any, n: Any) -> Any:
    """Where the ray a + `w` + s `d` meets the plane through a with unit normal `n`: the vector from a.

    The second line pulls the point back onto the plane: what lies exactly in a plane across an axis, such as a lamp in
    the floor, then is neither above nor below it.
    """
    on_ray = dr.fma(-dr.dot(w, n) * rcp(dr.dot(d, n)), d, w)
    return dr.fma(-dr.dot(on_ray, n), n, on_ray)


def barycentric(w: Any, e1: Any, e2: Any) -> tuple[Any, Any]:
    """Weights (beta, gamma) by Cramer's rule (Shirley et al., section 4.4.2): `w` = beta `e1` + gamma `e2`."""
    normal = dr.cross(e1, e2)
    inv_area2 = rcp(dr.squared_norm(normal))
    return dr.dot(dr.cross(w, e2), normal) * inv_area2, dr.dot(dr.cross(e1, w), normal) * inv_area2


def mirrored(d: Any, n: Any, d_n: Any) -> Any:
    """Direction d - 2 (d.n) n of the ray that a mirror sends on (Shirley et al., section 4.8), for `n` of any length.

    As long as `d`, but for a few roundings a bounce; `d_n` is d.n.
    """
    n_n = dr.maximum(dr.squared_norm(n), 2.0**-1022)  # where nothing was hit n is 0
    return dr.fma(-2 * d_n * rcp(n_n), n, d)


def unit(n: Any) -> Any:
    """Make the unit vector along `n`, rounded to single precision."""
    return mi.Normal3f(dr.normalize(mi.Normal3f(n)))


def ray_offset(n_g: Any, reach: Any, least: Any) -> tuple[Any, Any]:
    """Shift along the geometric normal, and its length.

    Parameters
    ----------
    n_g : Vector3f
        Unit geometric normal, on the side that the ray leaves to.
    reach : Vector3f
        Largest absolute coordinates of the surface, world units: they bound the rounding of every point on it.
    least : Float
        World units; keeps the shift above zero where the plane goes through the origin, for Embree reports a
        hit at a distance of exactly 0.
    """
    length = OFFSET_ROUNDOFFS * UNIT_ROUNDOFF * dr.maximum(dr.dot(dr.abs(n_g), reach), least)
    return length * n_g, length


SHADOW_END = 1 - 4 * UNIT_ROUNDOFF
"""A shadow ray ends this much before its light.

The distance (a rounded difference, half of 3, a root) carries fewer than 4 roundings.
"""

LEAST_EXPONENT = -126
"""2 to this is the least normal float32: what is less counts as 0."""

ROOT_HALF = 0x3F3504F3
"""Bits of the float32 next to sqrt(1/2)."""


def specular_power(n: Any, h: Any, exponent: Any) -> Any:
    """max(0, n.h)^exponent for unit vectors, with 0^0 = 0 (Blinn 1977; exponent 0 gives 1 where n.h > 0).

    With the chord e = n - h and y = |e|^2 / 2 = 1 - n.h the power is exp(exponent log(1 - y)). The chord is
    exact to u where n.h itself would have lost y: n.h near 1 has a spacing of u, so that a power of 10^6
    would be off by 6 %. No value exceeds 1. For exponents p >= 1 three errors are left: of n and h, whose
    rounding before the call moves the result by at most sqrt(p / e) u sqrt(3), 6e-5 at p = 10^6; of 1 - y where
    that is below sqrt(1/2), at most u / (e y) = 1.3 u; and of the functions: 7 u of the logarithm moves the result
    by at most 7 u / e, and the power of 2 adds 3 u. Below p = 1 the power is steep at n.h = 0, and digits are lost
    there by any formula.
    """
    y = dr.squared_norm(n - h) * 0.5
    if not dr.is_jit_v(mi.Float):
        return math.exp(exponent * math.log1p(-y)) if y < 1 else 0.0
    power = dr.maximum(exponent * _log2_of_1_minus(y), LEAST_EXPONENT)
    return dr.select((y < 1) & (power > LEAST_EXPONENT), _exp2(power), 0)


def _log2_of_1_minus(y: Any) -> Any:
    """Logarithm of 1 - y, 0 <= y < 1, right to 6 u of itself also where y is next to nothing.

    1 - y = 2^e m with sqrt(1/2) <= m = 1 + z < sqrt(2), and log(1 + z) = 2 artanh(s) with s = z / (2 + z),
    |s| < 0.172: the series ends where its next term, s^10 / 11, is below u / 29. Where e = 0, z is -y, without the
    rounding of 1 - y.
    """
    bits: Any = dr.reinterpret_array(mi.Int32, 1 - y)
    e = (bits - ROOT_HALF) >> 23
    m: Any = dr.reinterpret_array(mi.Float, bits - (e << 23))
    z = dr.select(e == 0, -y, m - 1)
    s = z * dr.rcp(2 + z)
    series = _polynomial(s * s, [1, 1 / 3, 1 / 5, 1 / 7, 1 / 9])
    return dr.fma(2 / math.log(2) * s, series, mi.Float(e))


def _exp2(x: Any) -> Any:
    """2^x for -126 <= x <= 0, right to 3 u of itself.

    2^k exp(f log 2) with |f| <= 1/2: the series ends where its next term, (log(2) / 2)^8 / 8!, is below u / 11.
    """
    k = dr.floor(x + 0.5)
    series = _polynomial((x - k) * math.log(2), [1 / math.factorial(i) for i in range(8)])
    return series * dr.reinterpret_array(mi.Float, (mi.Int32(k) + 127) << 23)


def _polynomial(x: Any, coefficients: list[float]) -> Any:
    """Sum of ``coefficients[i] * x^i``, by Horner's rule."""
    *rest, value = coefficients
    for coefficient in reversed(rest):
        value = dr.fma(x, value, coefficient)
    return value
