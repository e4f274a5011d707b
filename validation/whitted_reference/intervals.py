"""Interval arithmetic on floats: every result encloses the exact one (Moore 1966).

Each end is rounded outward, and only if it is not exact: what the rounding of a float operation leaves
out is itself a float, whose sign tells the direction (Dekker 1971). A comparison whose answer differs
within the intervals raises `Undecided`: a picture computed with intervals says of every yes/no decision
that it is certain, or that it is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

# The C library's exp, log1p, pow and atan2 are within one unit in the last place (glibc's stated bounds,
# and others'); two units are allowed for.
_LIBRARY_ULPS = 2


class Undecided(ArithmeticError):
    """The intervals overlap where the answer matters."""


def _down(x: float) -> float:
    return math.nextafter(x, -math.inf)


def _up(x: float) -> float:
    return math.nextafter(x, math.inf)


def _low(value: float, error: float) -> float:
    """Return a lower bound of value + error, for a rounding error that may be undefined (NaN)."""
    return value if error >= 0.0 else _down(value)


def _high(value: float, error: float) -> float:
    return value if error <= 0.0 else _up(value)


def _sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b rounded, and what the rounding left out."""
    total = a + b
    back = total - a
    return total, (a - (total - back)) + (b - back)


_SPLIT = 2.0**27 + 1.0
_SAFE = (1e-280, 1e280)  # beyond, the parts of a product may underflow or overflow


def _product(a: float, b: float) -> tuple[float, float]:
    """Return a * b rounded, and what the rounding left out; NaN where that is not known."""
    product = a * b
    if a == 0.0 or b == 0.0:
        return 0.0, 0.0
    if not _SAFE[0] < abs(product) < _SAFE[1] or not abs(a) < _SAFE[1] or not abs(b) < _SAFE[1]:
        return product, math.nan
    head_a, head_b = _SPLIT * a, _SPLIT * b
    head_a -= head_a - a
    head_b -= head_b - b
    tail_a, tail_b = a - head_a, b - head_b
    return product, tail_a * tail_b - (((product - head_a * head_b) - tail_a * head_b) - head_a * tail_b)


def _quotient(a: float, b: float) -> tuple[float, float]:
    """Return a / b rounded, and a number with the sign of what the rounding left out."""
    quotient = a / b
    back, error = _product(quotient, b)
    rest = (a - back) - error
    return quotient, rest if b > 0.0 else -rest


def _root(a: float) -> tuple[float, float]:
    """Return sqrt(a) rounded, and a number with the sign of what the rounding left out."""
    root = math.sqrt(a)
    back, error = _product(root, root)
    return root, (a - back) - error


class Interval:
    """All numbers from low to high."""

    __slots__ = ("high", "low")

    def __init__(self, low: float, high: float) -> None:
        self.low = low
        self.high = high

    @property
    def width(self) -> float:
        """Return high - low."""
        return self.high - self.low

    def __repr__(self) -> str:
        return f"[{self.low!r}, {self.high!r}]"

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __abs__(self) -> Interval:
        if self.low >= 0.0:
            return self
        return -self if self.high <= 0.0 else Interval(0.0, max(-self.low, self.high))

    def __add__(self, other: Interval | float) -> Interval:
        b = _interval(other)
        return Interval(_low(*_sum(self.low, b.low)), _high(*_sum(self.high, b.high)))

    __radd__ = __add__

    def __sub__(self, other: Interval | float) -> Interval:
        b = _interval(other)
        return Interval(_low(*_sum(self.low, -b.high)), _high(*_sum(self.high, -b.low)))

    def __rsub__(self, other: float) -> Interval:
        return -(self - other)

    def __mul__(self, other: Interval | float) -> Interval:
        if other is self:  # a square is not negative
            a = abs(self)
            return Interval(max(_low(*_product(a.low, a.low)), 0.0), _high(*_product(a.high, a.high)))
        return self._corners(_product, _interval(other))

    __rmul__ = __mul__

    def __truediv__(self, other: Interval | float) -> Interval:
        b = _interval(other)
        if b.low <= 0.0 <= b.high:
            raise Undecided(f"division by {b}")
        return self._corners(_quotient, b)

    def _corners(self, operation: Callable[[float, float], tuple[float, float]], b: Interval) -> Interval:
        ends = [operation(x, y) for x in (self.low, self.high) for y in (b.low, b.high)]
        return Interval(min(_low(*end) for end in ends), max(_high(*end) for end in ends))

    def __rtruediv__(self, other: float) -> Interval:
        return _interval(other) / self

    def __lt__(self, other: Interval | float) -> bool:
        b = _interval(other)
        if self.high < b.low:
            return True
        if self.low >= b.high:
            return False
        raise Undecided(f"{self} < {b}")

    def __le__(self, other: Interval | float) -> bool:
        b = _interval(other)
        if self.high <= b.low:
            return True
        if self.low > b.high:
            return False
        raise Undecided(f"{self} <= {b}")

    def __gt__(self, other: Interval | float) -> bool:
        return _interval(other) < self

    def __ge__(self, other: Interval | float) -> bool:
        return _interval(other) <= self

    def __eq__(self, other: object) -> bool:
        b = _interval(other)
        if self.high < b.low or b.high < self.low:
            return False
        if self.low == self.high == b.low == b.high:
            return True
        raise Undecided(f"{self} == {b}")

    __hash__ = None  # type: ignore[assignment]  # equality may be undecided

    def __bool__(self) -> bool:
        return self.low != 0.0 or self.high != 0.0


def _interval(x: object) -> Interval:
    if isinstance(x, Interval):
        return x
    if isinstance(x, int | float):
        return Interval(float(x), float(x))
    raise TypeError(f"{x!r} is not a number")


def middle(x: Interval) -> float:
    """Return a float in the middle."""
    return x.low if x.low == x.high else 0.5 * (x.low + x.high)


def spread(x: Interval) -> float:
    """Return how far from the middle the ends are, at most."""
    return 0.0 if x.low == x.high else x.high - x.low


def ratio(q: Fraction) -> Interval:
    """Enclose a fraction."""
    x = float(q)
    return Interval(x, x) if Fraction(x) == q else Interval(_down(x), _up(x))


def sqrt(x: Interval) -> Interval:
    """Enclose the square root, which floats round correctly."""
    if x.low < 0.0:
        raise Undecided(f"sqrt {x}")
    return Interval(max(_low(*_root(x.low)), 0.0), _high(*_root(x.high)))


def _widened(low: float, high: float) -> Interval:
    for _ in range(_LIBRARY_ULPS):
        low, high = _down(low), _up(high)
    return Interval(low, high)


def _rising(function: Callable[[float], float], x: Interval) -> Interval:
    return _widened(function(x.low), function(x.high))


def exp(x: Interval) -> Interval:
    """Enclose e^x."""
    return _rising(math.exp, x)


def log1p(x: Interval) -> Interval:
    """Enclose ln(1 + x), x > -1."""
    if x.low <= -1.0:
        raise Undecided(f"log1p {x}")
    return _rising(math.log1p, x)


def power(x: Interval | float, y: Interval | float) -> Interval:
    """Enclose x^y, x >= 0: monotonic in each of the two, so the corners bound it."""
    a, b = _interval(x), _interval(y)
    if a.low < 0.0 or (a.low == 0.0 and b.low < 0.0):
        raise Undecided(f"{a} ** {b}")
    corners = [math.pow(s, t) for s in (a.low, a.high) for t in (b.low, b.high)]
    return _widened(min(corners), max(corners))


def atan2(y: Interval, x: Interval) -> Interval:
    """Enclose the angle of (x, y); undecided across the cut along -x and around the origin."""
    if y.low == y.high == 0.0 and x.low >= 0.0:
        return Interval(0.0, 0.0)
    known = y.low == y.high and x.low == x.high
    if not known and x.low <= 0.0 and (y.low < 0.0 <= y.high or (y.low == 0.0 and x.high >= 0.0)):
        raise Undecided(f"atan2 {y} {x}")
    corners = [math.atan2(s, t) for s in (y.low, y.high) for t in (x.low, x.high)]
    return _widened(min(corners), max(corners))


def floor(x: Interval) -> int:
    """Return the whole number below all of x."""
    below = math.floor(x.low)
    if math.floor(x.high) != below:
        raise Undecided(f"floor {x}")
    return below
