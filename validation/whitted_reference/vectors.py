"""Three numbers: points, directions and colours, over any arithmetic with + - * and comparison."""

from __future__ import annotations

from typing import Any

# A number of the arithmetic in use (see `arithmetic`): float, decimal.Decimal or Interval.
Number = Any
Vec = tuple[Number, Number, Number]
Colour = tuple[Number, Number, Number]

BLACK: Colour = (0, 0, 0)
WHITE: Colour = (1, 1, 1)


def dot(a: Vec, b: Vec) -> Number:
    """Return a.b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec, b: Vec) -> Vec:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def add(a: Vec, b: Vec) -> Vec:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def sub(a: Vec, b: Vec) -> Vec:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(a: Vec, s: Number) -> Vec:
    """Return s a."""
    return a[0] * s, a[1] * s, a[2] * s


def negated(a: Vec) -> Vec:
    """Return -a."""
    return -a[0], -a[1], -a[2]
