"""The kinds of number that the tracer computes with.

The tracer uses + - * /, comparison, and what an `Arithmetic` holds. Three are given: `FLOAT`, the plain
one; `DECIMAL`, forty digits; `INTERVAL`, pairs of floats that are certain to enclose the exact result
(see `intervals`). Sines, cosines and tangents are not among the functions: they are taken only of the
scene's own parameters, once, in double precision, and are exact inputs from then on.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context, Decimal, localcontext
from fractions import Fraction
from typing import Any

from whitted_reference import intervals
from whitted_reference.intervals import Interval
from whitted_reference.vectors import Number


@dataclass(frozen=True)
class Arithmetic:
    """One kind of number.

    Attributes
    ----------
    of : the number equal to a float or int
    ratio : the number closest to a fraction (or an enclosure of it)
    approximate : a float close by
    spread : how far from it the number may be; None where `approximate` is the nearest float
    sqrt, exp, log1p, power, atan2 : the functions of that name; `power(x, y)` for x >= 0
    floor : the whole number below, as an int
    before : the closest number below: turns a closed end of an interval into an open one
    pi, infinity : constants
    closeness : two distances closer than this, relatively, are reported as a tie
    scope : a context to compute in
    """

    name: str
    of: Callable[[float], Number]
    ratio: Callable[[Fraction], Number]
    approximate: Callable[[Number], float]
    spread: Callable[[Number], float] | None
    sqrt: Callable[[Number], Number]
    exp: Callable[[Number], Number]
    log1p: Callable[[Number], Number]
    power: Callable[[Number, Number], Number]
    atan2: Callable[[Number, Number], Number]
    floor: Callable[[Number], int]
    before: Callable[[Number], Number]
    pi: Number
    infinity: Number
    closeness: Number
    scope: Callable[[], AbstractContextManager[Any]]

    def vec(self, v: tuple[float, ...]) -> tuple[Any, ...]:
        """Convert each component."""
        return tuple(self.of(x) for x in v)


# Two candidates closer than this, relatively, count as a tie. Distances are found to a few 2^-53
# relatively; 2^-40 leaves a factor of 2^13 for slanted hits and is still far below single precision.
CLOSENESS = 2.0**-40

FLOAT = Arithmetic(
    name="float",
    of=float,
    ratio=float,
    approximate=float,
    spread=None,
    sqrt=math.sqrt,
    exp=math.exp,
    log1p=math.log1p,
    power=math.pow,
    atan2=math.atan2,
    floor=math.floor,
    before=lambda x: math.nextafter(x, -math.inf),
    pi=math.pi,
    infinity=math.inf,
    closeness=CLOSENESS,
    scope=nullcontext,
)


# -------------------------------------------------------------------------------------------- 40 digits
DIGITS = 40
_CONTEXT = Context(prec=DIGITS)
_WIDER = Context(prec=DIGITS + 10)  # for series: their rounding stays below the last digit that is kept
_PI = Decimal("3.14159265358979323846264338327950288419716939937510")


def _decimal_atan2(y: Decimal, x: Decimal) -> Decimal:
    """Return the angle of (x, y), off by less than one unit in the 40th digit.

    atan u = 2 atan(u / (1 + sqrt(1 + u^2))) is used three times, which brings |u| <= 1 down to less than
    0.1; then Gregory's series u - u^3/3 + ... alternates, so its remainder is below the first term left
    out, 10^-50 |u|. About fifty operations at fifty digits lose less than two of the ten spare digits.
    """
    with localcontext(_WIDER):
        if x == 0 and y == 0:
            return Decimal(0)
        flat = abs(y) <= abs(x)
        u = y / x if flat else x / y
        for _ in range(3):
            u /= 1 + (1 + u * u).sqrt()
        total = power = u
        k = 1
        while abs(power) > abs(u) * Decimal(10) ** -(DIGITS + 10):
            power *= -u * u
            k += 2
            total += power / k
        angle = 8 * total
        if not flat:
            angle = (_PI if y > 0 else -_PI) / 2 - angle
        elif x < 0:
            angle += _PI if y >= 0 else -_PI
    return _CONTEXT.plus(angle)


def _decimal_log1p(x: Decimal) -> Decimal:
    with localcontext(_WIDER):
        result = (1 + x).ln()
    return _CONTEXT.plus(result)


DECIMAL = Arithmetic(
    name=f"decimal, {DIGITS} digits",
    of=Decimal,
    ratio=lambda q: _CONTEXT.divide(Decimal(q.numerator), Decimal(q.denominator)),
    approximate=float,
    spread=None,
    sqrt=_CONTEXT.sqrt,  # correctly rounded, as are exp and ln
    exp=_CONTEXT.exp,
    log1p=_decimal_log1p,
    power=_CONTEXT.power,  # off by less than one unit in the last digit
    atan2=_decimal_atan2,
    floor=lambda x: int(x.to_integral_value(ROUND_FLOOR)),
    before=_CONTEXT.next_minus,
    pi=_CONTEXT.plus(_PI),
    infinity=Decimal("Infinity"),
    closeness=Decimal(CLOSENESS),
    scope=lambda: localcontext(_CONTEXT),
)


# -------------------------------------------------------------------------------------------- intervals
INTERVAL = Arithmetic(
    name="intervals",
    of=lambda x: Interval(float(x), float(x)),
    ratio=intervals.ratio,
    approximate=intervals.middle,
    spread=intervals.spread,
    sqrt=intervals.sqrt,
    exp=intervals.exp,
    log1p=intervals.log1p,
    power=intervals.power,
    atan2=intervals.atan2,
    floor=intervals.floor,
    before=lambda x: Interval(math.nextafter(x.low, -math.inf), math.nextafter(x.low, -math.inf)),
    pi=Interval(math.pi, math.nextafter(math.pi, 4.0)),  # math.pi is below pi
    infinity=Interval(math.inf, math.inf),
    closeness=Interval(CLOSENESS, CLOSENESS),
    scope=nullcontext,
)
