"""The kinds of number that the tracer computes with.

The tracer uses + - * /, comparison, and what an `Arithmetic` holds. Three are given: `FLOAT`, the plain
one; `DECIMAL`, forty digits; `INTERVAL`, pairs of floats that are certain to enclose the exact result.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from whitted_reference.vectors import Number


@dataclass(frozen=True)
class Arithmetic:
    """One kind of number.

    Attributes
    ----------
    of : the number equal to a float (or the enclosure of it alone)
    ratio : the number closest to a fraction
    approximate : the nearest float
    sqrt, exp, log1p, power, atan2 : the functions of that name; `power(x, y)` for x >= 0
    floor : the whole number below, as an int
    before : the closest number below: turns a closed end of an interval into an open one
    pi, infinity : constants
    closeness : two distances closer than this, relatively, are reported as a tie
    """

    name: str
    of: Callable[[float], Number]
    ratio: Callable[[Fraction], Number]
    approximate: Callable[[Number], float]
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
)
