"""Single precision on Python floats: how the inputs of a scene are rounded, bit for bit.

Every function takes and returns Python floats whose values are representable in IEEE 754 binary32.
A Python float (binary64) holds the product of two of them exactly, and carries the correctly rounded
binary32 result of + - * / sqrt through its own rounding (Figueroa 1995: 53 >= 2 * 24 + 2), so plain
arithmetic followed by `nearest` is exact emulation. Only the fused multiply-add needs more care.
"""

from __future__ import annotations

import math
import struct
from fractions import Fraction

from whitted_reference.vectors import Vec, dot

_BINARY32 = struct.Struct("<f")
ROUNDOFF = 2.0**-24  # half the distance from 1 to the next binary32 number


def nearest(x: float) -> float:
    """Round to the nearest binary32 number, ties to even; beyond the range to an infinity."""
    try:
        value: float = _BINARY32.unpack(_BINARY32.pack(x))[0]
    except OverflowError:
        return math.copysign(math.inf, x)
    return value


def nearest_vec(v: Vec) -> Vec:
    """Round each component."""
    return nearest(v[0]), nearest(v[1]), nearest(v[2])


def fma(a: float, b: float, c: float) -> float:
    """Return a * b + c with one rounding to binary32.

    The product is exact in binary64. The sum is rounded there to odd (Boldo and Melquiond 2008), which
    makes the second rounding, to binary32, the only one that counts.
    """
    product = a * b
    total = product + c
    if not math.isfinite(total):
        return nearest(total)
    back = total - product
    lost = (product - (total - back)) + (c - back)
    if lost != 0.0 and not int(math.ldexp(math.frexp(total)[0], 53)) & 1:
        total = math.nextafter(total, math.copysign(math.inf, lost))
    return nearest(total)


def fma64(a: float, b: float, c: float) -> float:
    """Return a * b + c with one rounding to binary64."""
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        return a * b + c
    return float(Fraction(a) * Fraction(b) + Fraction(c))


def length(v: Vec) -> float:
    """Return |v|: Mitsuba adds the squares of x and z first, then that of y (a packet's horizontal sum)."""
    x, y, z = v
    return nearest(math.sqrt(nearest(nearest(nearest(x * x) + nearest(z * z)) + nearest(y * y))))


def divided(v: Vec, divisor: float) -> Vec:
    """Return v / divisor as Mitsuba does: times the rounded reciprocal."""
    if divisor == 0.0:
        return math.nan, math.nan, math.nan
    scale = nearest(1.0 / divisor)
    return nearest(v[0] * scale), nearest(v[1] * scale), nearest(v[2] * scale)


def normalize(v: Vec) -> Vec:
    """Scale to unit length; NaN for the zero vector."""
    return divided(v, length(v))


def frame(n: Vec) -> tuple[Vec, Vec]:
    """Return two unit vectors that complete n to an orthonormal basis (Duff et al. 2017)."""
    sign = math.copysign(1.0, n[2])
    a = -nearest(1.0 / nearest(sign + n[2]))
    b = nearest(nearest(n[0] * n[1]) * a)
    s = (nearest(nearest(nearest(n[0] * n[0]) * a) * sign + 1.0), b * sign, -n[0] * sign)
    t = (b, fma(n[1], nearest(n[1] * a), sign), -n[1])
    return s, t


# Rec. 709 luminance with the digits of Mitsuba, which keeps them in single precision.
LUMINANCE: Vec = nearest_vec((0.212671, 0.715160, 0.072169))


def luminance(colour: Vec) -> float:
    """Return the luminance of a linear colour, in double precision."""
    return dot(LUMINANCE, colour)  # type: ignore[no-any-return]  # of floats
