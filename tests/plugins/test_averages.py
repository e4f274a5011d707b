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
            guessed = dr.gather(mi.Float, estimate.error, which)
            averages.average(look, some, estimate, which, numbers, guessed)
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
        y = np.array(some.y)[cell] + k * averages.GOLDEN_RATIO / 2**32 % 1
        lattice = np.array([x, y, x * y, np.ones(count)])
        # Each term: up to eight roundings of x and y, y being cut to 2^-24 of a cell; the sums are double; the share,
        # the mean of two halves and its place.
        limit = 8 * np.abs(lattice).mean(axis=1) + lattice.max(axis=1)
        assert np.all(np.abs(value - lattice.mean(axis=1)) <= limit * 2.0**-24)


def stripes(x, y, active):
    """Show stripes far finer than the cells: lattices meet them at random."""
    white = (mi.UInt32(x * 977.1 + y * 613.7) & 1) == 1
    colour = dr.select(white, mi.Float(1), 0)
    return mi.Vector4f(colour, colour, colour, 1), mi.UInt32(0)


def averaged_to(budget, shown=stripes, size=16):
    """Average over every cell of a picture: errors measured, errors if it is half white, and samples taken."""
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners

    taken = []

    def look(x, y, active):
        taken.append(dr.width(x))
        return shown(x, y, active)

    some = cells.pixels(shown, size, 0, size)
    estimate, _ = from_corners(some, 1e-3)
    chosen = dr.compress(some.inside)
    counts = dr.full(mi.UInt32, 8, size * size)
    dr.make_opaque(counts)
    guessed = dr.gather(mi.Float, estimate.error, chosen)
    averages.average_to(look, some, estimate, chosen, counts, guessed, budget)
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
        assert (
            averaged_to(budget)[2][1] < averages.MOST_MORE * taken[0]
        )  # not everything anew with all that one cell may need
    monkeypatch.setattr(averages, "MOST_AGAIN", 0)
    errors, off, taken = averaged_to(squares / 4)
    assert len(taken) == 1
    assert np.sum(errors**2) == squares


def test_averages_that_meet_the_budget_are_taken_once(llvm_ad_rgb):
    squares = np.sum(averaged_to(math.inf)[0] ** 2)
    assert averaged_to(squares)[2] == [8 * 256]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_no_number_keeps_nothing_else_from_its_budget(llvm_ad_rgb, bad):
    from mitsuba_whitted import averages

    def shown(x, y, active):
        colour, path = stripes(x, y, active)
        return dr.select((x > 8.3) & (x < 8.4), mi.Vector4f(bad), colour), path  # at no corner

    def sound(errors):
        return errors[np.isfinite(errors)]

    errors, _, _ = averaged_to(math.inf, shown)
    assert 0 < len(sound(errors)) < len(errors)
    squares = np.sum(sound(errors) ** 2)
    errors, _, taken = averaged_to(squares / 4, shown)
    assert len(taken) > 1
    assert np.sum(sound(errors) ** 2) <= averages.TOLERANCE**2 * squares / 4
    everything = averaged_to(1e-9, lambda x, y, active: (mi.Vector4f(bad + x), mi.UInt32(0)))
    assert len(everything[2]) == 1


def test_an_average_of_very_many_samples_is_even(llvm_ad_rgb):
    # A ramp and its complement: sums of floats, and places k g of floats, would be off by 1e-3.
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners

    def look(x, y, active):
        return mi.Vector4f(y, 1 - y, x, 1), mi.UInt32(0)

    some = cells.pixels(look, 1, 0, 1)
    estimate, _ = from_corners(some, 1e-3)
    chosen, counts = mi.UInt32([0]), mi.UInt32([1 << 20])
    dr.make_opaque(chosen, counts)
    averages.average(look, some, estimate, chosen, counts, dr.gather(mi.Float, estimate.error, chosen))
    y = (np.arange(1 << 20, dtype=np.uint32) * np.uint32(averages.GOLDEN_RATIO) + averages.GOLDEN_RATIO // 2) >> 8
    mean = np.mean(y.astype(float)) * 2.0**-24
    assert abs(mean - 0.5) <= 20 * 2.0**-20  # log2(n) / n
    # Places, 1 - y and sums of doubles are exact; the share, either half, and their sum are rounded: four times.
    assert np.all(np.abs(np.array(estimate.value)[:4] - [mean, 1 - mean, 0.5, 1]) <= 4 * 2.0**-24)


@pytest.mark.parametrize("hidden", [False, True])
def test_the_least_samples_do_and_the_count_is_even(llvm_ad_rgb, hidden):
    from mitsuba_whitted import averages
    from mitsuba_whitted.water import AVERAGED, FALL, LEAST_SAMPLES

    error = np.array([1e-6, 0.9, 1.1, 3, 20, 1e9], np.float32) / AVERAGED
    counts = np.array(averages.needed(mi.Float(error), mi.Bool([hidden] * 6), mi.Float(1)), float)
    assert np.all(counts % 2 == 0)
    exact = LEAST_SAMPLES * np.maximum(1, AVERAGED * error.astype(float)) ** (1 / FALL)
    if hidden:
        exact = np.clip(exact, *averages.OF_HIDDEN)
    exact = np.minimum(exact, 2 * averages.ENOUGH)
    assert np.all((counts >= exact * (1 - 2.0**-20)) & (counts < exact * (1 + 2.0**-20) + 2))


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

    measured, foreseen = np.array([0.0, 2.0, 1.0]), np.array([1.0, 1.0, 2.0])
    found = _steadied(measured, foreseen)
    assert np.allclose(found**2, [5 / 12, 2 + 5 / 12, 1 / 2 + 5 / 3], rtol=2.0**-50, atol=0)
    assert np.all(_steadied(np.zeros(3), np.zeros(3)) == 0)
