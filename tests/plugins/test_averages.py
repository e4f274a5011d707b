"""Averages over cells: the mean of an even lattice, and more samples where what they show is not good enough."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


def test_an_average_is_the_mean_of_its_lattice_whatever_else_is_averaged(llvm_ad_rgb):
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners

    def look(x, y, active):
        return mi.Vector4f(x, y, x * y, 1), mi.UInt32(0)

    chosen, counts = [3, 0, 17, 40], [14, 8, 200, 26]
    some = cells.pixels(look, 8, 0, 8)

    def averaged(*batches):
        estimate, _ = from_corners(some, 1e-3)
        before = np.array(estimate.value).reshape(-1, 4)
        for batch in batches:
            which, numbers = (mi.UInt32([part[n] for n in batch]) for part in (chosen, counts))
            dr.make_opaque(which, numbers)  # a single number would be a constant of the kernel
            averages.average(look, some, estimate, which, numbers)
        after = np.array(estimate.value).reshape(-1, 4)
        others = np.setdiff1d(np.arange(len(after)), chosen)
        assert np.array_equal(after[others], before[others])
        return after[chosen], np.array(estimate.error)[chosen]

    values, errors = averaged(range(4))
    for one_by_one in (averaged([0], [1], [2], [3]), averaged([3, 1], [2, 0])):
        assert np.array_equal(values, one_by_one[0])
        assert np.array_equal(errors, one_by_one[1])
    for cell, count, value in zip(chosen, counts, values, strict=True):
        k = np.arange(count) + 0.5
        x = np.array(some.x)[cell] + k / count
        y = np.array(some.y)[cell] + k * averages.GOLDEN_RATIO % 1
        lattice = np.array([x, y, x * y, np.ones(count)])
        # Each term: five roundings, of y one more of k g itself; count / 2 sums; and the share.
        limit = (count / 2 + 8) * np.abs(lattice).mean(axis=1) + count * lattice.max(axis=1)
        assert np.all(np.abs(value - lattice.mean(axis=1)) <= limit * 2.0**-24)


def stripes(x, y, active):
    """Show stripes far finer than the cells: lattices meet them at random."""
    white = (mi.UInt32(x * 977.1 + y * 613.7) & 1) == 1
    colour = dr.select(white, mi.Float(1), 0)
    return mi.Vector4f(colour, colour, colour, 1), mi.UInt32(0)


def averaged_to(budget, size=16):
    """Average over every cell of a picture of stripes: errors measured, errors, and samples taken."""
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners

    taken = []

    def look(x, y, active):
        taken.append(dr.width(x))
        return stripes(x, y, active)

    some = cells.pixels(stripes, size, 0, size)
    estimate, _ = from_corners(some, 1e-3)
    chosen = dr.compress(some.inside)
    counts = dr.full(mi.UInt32, 8, size * size)
    dr.make_opaque(counts)
    averages.average_to(look, some, estimate, chosen, counts, budget)
    values, errors = np.array(estimate.value).reshape(-1, 4), np.array(estimate.error)
    return errors[np.array(chosen)], values[np.array(chosen), 0] - 0.5, taken


def test_averages_are_taken_again_until_their_errors_as_measured_meet_the_budget(llvm_ad_rgb, monkeypatch):
    from mitsuba_whitted import averages

    squares = np.sum(averaged_to(math.inf)[0] ** 2)
    errors, off, taken = averaged_to(squares / 4)
    assert len(taken) > 1
    assert np.sum(errors**2) <= averages.TOLERANCE**2 * squares / 4
    assert np.sum(off**2) <= squares / 4  # what is measured is above what is, in sum
    for budget in (squares / 4, 0.7 * squares):
        assert averaged_to(budget)[2][1] < 4 * taken[0]  # not everything anew with all that one cell may need
    monkeypatch.setattr(averages, "MOST_AGAIN", 0)
    errors, off, taken = averaged_to(squares / 4)
    assert len(taken) == 1
    assert np.sum(errors**2) == squares


def test_averages_that_meet_the_budget_are_taken_once(llvm_ad_rgb):
    squares = np.sum(averaged_to(math.inf)[0] ** 2)
    assert averaged_to(squares)[2] == [8 * 256]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_averages_of_what_is_no_number_are_taken_once(llvm_ad_rgb, bad, monkeypatch):
    def look(x, y, active):
        colour = dr.select(x < 3, mi.Float(bad), x)
        return mi.Vector4f(colour, colour, colour, 1), mi.UInt32(0)

    monkeypatch.setitem(globals(), "stripes", look)
    errors, _, taken = averaged_to(1e-9)
    assert len(taken) == 1
    assert 16 * 10 < np.isfinite(errors).sum() <= 16 * 13  # guesses about cells beside them are none either


def test_a_level_cuts_errors_to_the_budget():
    from mitsuba_whitted.averages import _level

    rng = np.random.default_rng(5)
    for count in (1, 2, 7, 300):
        errors = rng.exponential(1, count)
        for part in (1e-6, 0.1, 0.5, 0.999):
            budget = part * np.sum(errors**2)
            level = _level(errors, budget)
            assert np.isclose(np.sum(np.minimum(errors, level) ** 2), budget, rtol=4 * count * 2.0**-53, atol=0)
            assert np.any(errors > level)


def test_steadied_errors_keep_their_sum_of_squares_and_half_of_what_was_foreseen():
    from mitsuba_whitted.averages import _steadied

    measured, foreseen = np.array([0.0, 2.0, 1.0], np.float32), np.array([1.0, 1.0, 2.0])
    found = _steadied(measured, foreseen)
    assert np.allclose(found**2, [5 / 12, 2 + 5 / 12, 1 / 2 + 5 / 3], rtol=2.0**-50, atol=0)
    assert np.all(_steadied(np.zeros(3, np.float32), np.zeros(3)) == 0)
