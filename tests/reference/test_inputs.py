"""Single precision on Python floats, against exact fractions."""

from __future__ import annotations

import math
import random
from fractions import Fraction

from whitted_reference import float32, transforms


def round_exactly(q: Fraction) -> float:
    """Round a fraction to the nearest binary32 number, ties to even, by integers alone."""
    if q == 0:
        return 0.0
    exponent = max(math.frexp(float(q))[1] - 24, -149)
    for shift in (exponent - 1, exponent, exponent + 1):  # frexp may be off by one after rounding
        scaled = abs(q) / Fraction(2) ** shift
        if scaled < 2**24 or shift > exponent:
            whole, rest = divmod(scaled, 1)
            whole += rest > Fraction(1, 2) or (rest == Fraction(1, 2) and whole % 2 == 1)
            if shift >= -149:
                return math.copysign(float(whole * Fraction(2) ** shift), q)
    raise AssertionError(q)


def some(rng: random.Random) -> float:
    return float32.nearest(rng.choice([-1, 1]) * 2.0 ** rng.uniform(-20, 20))


def test_fused_multiply_add_rounds_once():
    rng = random.Random(4)
    for _ in range(5000):
        a, b = some(rng), some(rng)
        # Half of the addends cancel the product, where double rounding would show.
        c = float32.nearest(-a * b) if rng.random() < 0.5 else some(rng)
        assert float32.fma(a, b, c) == round_exactly(Fraction(a) * Fraction(b) + Fraction(c))
    # The product lies in the middle of two numbers, the addend breaks the tie by far too little for doubles.
    one = 1.0 + 2.0**-23
    assert float32.fma(one, 1.0 + 2.0**-1, 2.0**-60) == round_exactly(
        Fraction(one) * Fraction(3, 2) + Fraction(2) ** -60
    )
    assert float32.fma(one, 1.5, 2.0**-60) != float32.fma(one, 1.5, -(2.0**-60))


def test_fma64_rounds_once():
    rng = random.Random(5)
    for _ in range(500):
        a, b = rng.uniform(-3, 3), rng.uniform(-3, 3)
        c = -a * b
        assert float32.fma64(a, b, c) == float(Fraction(a) * Fraction(b) + Fraction(c))


def test_nearest_overflows_to_infinity():
    assert float32.nearest(1e39) == math.inf
    assert float32.nearest(-1e39) == -math.inf
    assert float32.nearest(0.1) == 13421773 / 2**27


def test_normalize_and_frame_are_unit_to_single_precision():
    rng = random.Random(6)
    for _ in range(100):
        n = float32.normalize((some(rng), some(rng), some(rng)))
        s, t = float32.frame(n)
        for a in (n, s, t):
            # Three squares, two sums, a root, a reciprocal, a product: ten roundings of 2^-24 cover it.
            assert abs(math.hypot(*a) - 1) < 10 * 2.0**-24
        for a, b in [(n, s), (n, t), (s, t)]:
            assert abs(sum(x * y for x, y in zip(a, b, strict=True))) < 10 * 2.0**-24


def test_inverse_transpose_is_carried_along_and_matches_the_inverse():
    m = transforms.IDENTITY
    shear = ((1.0, 2.0, 0.5, 0.0), (0.0, 1.0, 1.0, 0.0), (3.0, 0.0, 1.0, 0.0))
    for step in (transforms.scaling((2.0, 0.5, 3.0)), transforms.rotation((0.6, 0.0, 0.8), 33.0),
                 transforms.translation((1.0, 2.0, 3.0)),
                 transforms.from_matrix(shear)):  # fmt: skip
        m = transforms.product(step, m)
    inverse = transforms.inverse_linear(m.matrix)
    for i in range(3):
        for j in range(3):
            # A few operations at 2^-53 on numbers up to about 10.
            assert abs(m.normal[i][j] - float(inverse[j][i])) < 100 * 2.0**-53


def test_point_transform_is_the_fused_chain():
    m = transforms.rotation((0.6, 0.0, 0.8), 33.0).rounded()
    p = (0.1, 0.7, -0.3)
    p = tuple(map(float32.nearest, p))
    for row, result in zip(m.matrix, m.point32(p), strict=True):
        chain = row[3]
        for a, x in zip(row, p, strict=False):
            chain = round_exactly(Fraction(a) * Fraction(x) + Fraction(chain))
        assert result == chain
