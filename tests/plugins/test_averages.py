"""Averages over cells: the mean of an even lattice, and more samples where what they show is not good enough."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


@pytest.mark.parametrize(("at_once", "launches"), [(None, [248]), (1, [14, 8, 200, 26]), (30, [22, 200, 26])])
def test_an_average_is_that_of_its_lattice_and_corners_whatever_else_is_averaged(
    llvm_ad_rgb, monkeypatch, at_once, launches
):
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.lattices import BEST, GOLDEN

    taken = []

    def look(x, y, active):
        taken.append(dr.width(x))
        return mi.Vector4f(x, y, x * y, 1), mi.UInt32(0)

    if at_once is not None:
        monkeypatch.setattr(averages, "AT_ONCE", at_once)
    chosen, counts = np.array([3, 0, 17, 40], np.uint32), np.array([14, 8, 200, 26], np.uint32)
    some = cells.pixels(look, 8, 0, 8)
    taken.clear()

    def averaged(*batches):
        estimate, _ = from_corners(some, 1e-3)
        before = np.array(estimate.value).reshape(-1, 4)
        for batch in batches:
            which, numbers = chosen[list(batch)], counts[list(batch)]
            averages.average(look, some, estimate, which, numbers, np.array(estimate.error)[which])
        after = np.array(estimate.value).reshape(-1, 4)
        others = np.setdiff1d(np.arange(len(after)), chosen)
        assert np.array_equal(after[others], before[others])
        return after[chosen], np.array(estimate.error)[chosen]

    values, errors = averaged(range(4))
    assert taken == launches
    for one_by_one in (averaged([0], [1], [2], [3]), averaged([3, 1], [], [2, 0])):
        assert np.array_equal(values, one_by_one[0])
        assert np.array_equal(errors, one_by_one[1])
    for cell, count, value in zip(chosen, counts, values, strict=True):
        k = np.arange(count)
        share = 2 / (count + 4)
        step, start = BEST[count // 2 - 1] if count <= 64 else (GOLDEN, GOLDEN / 2)
        places = np.array([(k + 0.5) / count, (start + k * step) % 1])
        x, y = np.array([some.x, some.y])[:, cell, None] + share / 2 + (1 - share) * places
        lattice = np.array([x, y, x * y, np.ones(count)])
        x, y = np.array([some.x, some.y])[:, cell] + 0.5
        exact = (1 - share) * lattice.mean(axis=1) + share * np.array([x, y, x * y, 1])
        # Each of x and y: the quotient or the cut to 2^-24, the share, two for the move, one for the place in the
        # picture; their product; the share, its complement, the weight and either half; the sum of the corners, its
        # weight and product; two sums. The sums over samples are double.
        limit = (2 * 5 + 1) + 5 + 5 + 2
        assert np.all(np.abs(value - exact) <= limit * 2.0**-24 * lattice.max(axis=1))


def test_corners_make_averages_better(llvm_ad_rgb, monkeypatch):
    # Each pixel is parted by an edge of its own, at a random place and angle; the area is that of 1000 thin strips.
    from mitsuba_whitted import averages, cells, lattices
    from mitsuba_whitted.corners import from_corners

    size, rng = 64, np.random.default_rng(3)
    angle = rng.uniform(0, 2 * np.pi, size * size)
    c, s = np.cos(angle), np.sin(angle)
    d = rng.uniform(-0.5, 0.5, size * size) * (np.abs(c) + np.abs(s))
    strips = (d[:, None] - ((np.arange(1000) + 0.5) / 1000 - 0.5) * s[:, None]) / c[:, None]
    strips = np.clip(strips + 0.5, 0, 1)
    area = np.where(c[:, None] > 0, strips, 1 - strips).mean(axis=1)
    of_pixel = [mi.Float(part) for part in (c, s, d)]

    def errors(count):
        some = cells.pixels(lambda x, y, active: (mi.Vector4f(0), mi.UInt32(0)), size, 0, size)
        chosen = np.flatnonzero(some.inside).astype(np.uint32)
        column, row = np.array(some.i)[chosen], np.array(some.j)[chosen]
        estimate, _ = from_corners(some, 1e-3)
        guessed = np.zeros(len(chosen), np.float32)

        def look(x, y, active):
            pixel = mi.UInt32(y) * size + mi.UInt32(x)
            a, b, e = (dr.gather(mi.Float, part, pixel) for part in of_pixel)
            inside = a * (x - dr.floor(x) - 0.5) + b * (y - dr.floor(y) - 0.5) < e
            return mi.Vector4f(dr.select(inside, mi.Float(1), 0)), mi.UInt32(0)

        averages.average(look, some, estimate, chosen, np.full(len(chosen), count, np.uint32), guessed)
        # Corners are black in what is drawn, since pixels that share one have different edges: each adds its own.
        corners = [c * x + s * y < d for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
        of_corners = np.mean(corners, axis=0)
        share = float(np.array(lattices.of_corners(mi.Float(count)))[0])
        found = np.array(estimate.value).reshape(-1, 4)[chosen, 0] + share * of_corners[row * size + column]
        return np.sqrt(np.mean((found - area[row * size + column]) ** 2))

    with_corners = np.array([errors(count) for count in (6, 8, 16, 32)])
    for module in (averages, lattices):
        monkeypatch.setattr(module, "of_corners", lambda count: mi.Float(0) * count)
    without = np.array([errors(count) for count in (6, 8, 16, 32)])
    assert np.all(with_corners < without)
    assert np.array_equal(np.round(with_corners / without, 2), [0.83, 0.86, 0.92, 0.96])


def stripes(x, y, active):
    """Show stripes far finer than the cells: lattices meet them at random."""
    white = (mi.UInt32(x * 977.1 + y * 613.7) & 1) == 1
    colour = dr.select(white, mi.Float(1), 0)
    return mi.Vector4f(colour, colour, colour, 1), mi.UInt32(0)


def averaged_to(budget, shown=stripes, size=16, split=False, hides=False):
    """Average over every cell of a picture: errors measured, errors if it is half white, and samples taken.

    If some of them are to be split, the limit instead of the second. `hides` are those that never are.
    """
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners

    taken = []

    def look(x, y, active):
        taken.append(dr.width(x))
        return shown(x, y, active)

    some = cells.pixels(shown, size, 0, size)
    estimate, _ = from_corners(some, 1e-3)
    chosen = np.array(dr.compress(some.inside))
    counts, guessed = np.full(size * size, 8, np.uint32), np.array(estimate.error)[chosen]
    hidden = np.full(size * size, False) | hides
    above = averages.average_to(look, some, estimate, chosen, counts, guessed, hidden, budget)
    values, errors = np.array(estimate.value).reshape(-1, 4), np.array(estimate.error)
    assert (above is not None) == split
    return errors[chosen], above if split else values[chosen, 0] - 0.5, taken


def test_averages_are_taken_again_until_their_errors_as_measured_meet_the_budget(llvm_ad_rgb, monkeypatch):
    from mitsuba_whitted import averages

    squares = np.sum(averaged_to(math.inf)[0] ** 2)
    errors, off, taken = averaged_to(squares / 4)
    assert len(taken) > 1
    assert np.sum(errors**2) <= averages.TOLERANCE**2 * squares / 4
    # Of samples at random the mean is off by half of what two halves differ, in the mean of squares. A cell that is not
    # taken again may have differed little by luck; but for the part of its error that stays as foreseen.
    most = (0.5 / averages.OF_HALVES * averages.TOLERANCE) ** 2 / averages.FORESEEN
    assert np.sum(off**2) <= most * squares / 4
    for budget in (squares / 4, 0.5 * squares):  # not everything anew with all that one cell may need
        assert averaged_to(budget)[2][1] < averages.MOST_MORE * taken[0]
    monkeypatch.setattr(averages, "MOST_AGAIN", 0)
    errors, off, taken = averaged_to(squares / 4)
    assert len(taken) == 1
    assert np.sum(errors**2) == squares


def test_halves_that_agree_by_chance_leave_part_of_what_was_foreseen(llvm_ad_rgb):
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.water import AVERAGED, FALL

    def grey(x, y, active):
        return mi.Vector4f(0.5 + 0 * x), mi.UInt32(0)

    some = cells.pixels(grey, 4, 0, 4)
    estimate, _ = from_corners(some, 1e-3)
    chosen = np.array(dr.compress(some.inside))
    counts, guessed = 2 * np.arange(1, 17, dtype=np.uint32), np.linspace(0.1, 1, 16).astype(np.float32)
    averages.average(grey, some, estimate, chosen, counts, guessed)
    foreseen = averages.FORESEEN * (AVERAGED * mi.Float(guessed) * mi.Float(counts) ** -FALL)
    assert np.array_equal(np.array(estimate.error)[chosen], np.array(foreseen))


def test_averages_that_meet_the_budget_are_taken_once(llvm_ad_rgb):
    squares = np.sum(averaged_to(math.inf)[0] ** 2)
    assert averaged_to(squares)[2] == [8 * 256]


def test_what_has_the_most_samples_is_not_averaged_again(llvm_ad_rgb, monkeypatch):
    from mitsuba_whitted import averages

    squares = np.sum(averaged_to(math.inf)[0] ** 2)
    monkeypatch.setattr(averages, "MOST_SAMPLES", 8)
    assert sum(averaged_to(squares / 4)[2]) == 8 * 256


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


def test_what_hides_takes_its_samples_even_if_the_rest_is_split(llvm_ad_rgb, monkeypatch):
    from mitsuba_whitted import averages

    squares = np.sum(averaged_to(math.inf)[0] ** 2)
    monkeypatch.setattr(averages, "OF_LAUNCHES", 0)
    monkeypatch.setattr(averages, "OF_PARTS", 0)
    hides = np.arange(256) % 3 == 0
    without, limit, once = averaged_to(squares / 4, split=True)
    errors, same, taken = averaged_to(squares / 4, split=True, hides=hides)
    assert once == [8 * 256]
    assert same == limit
    wanted = hides & (without > limit)
    assert np.any(wanted)
    assert len(taken) == 2
    assert 8 * wanted.sum() < taken[1] <= averages.MOST_MORE * 8 * wanted.sum()
    assert np.array_equal(errors != without, wanted)
    everything, _, more = averaged_to(squares / 4, hides=True)
    assert np.sum(everything**2) <= averages.TOLERANCE**2 * squares / 4
    assert len(more) > 1


def test_an_average_of_very_many_samples_is_even(llvm_ad_rgb):
    # A ramp and its complement: sums of floats, and places k g of floats, would be off by 1e-3.
    from mitsuba_whitted import averages, cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.lattices import GOLDEN

    def look(x, y, active):
        return mi.Vector4f(y, 1 - y, x, 1), mi.UInt32(0)

    some = cells.pixels(look, 1, 0, 1)
    estimate, _ = from_corners(some, 1e-3)
    chosen, counts = np.zeros(1, np.uint32), np.full(1, 1 << 20, np.uint32)
    averages.average(look, some, estimate, chosen, counts, np.array(estimate.error)[chosen])
    step, start = (np.uint32(round(part * 2.0**32)) for part in (GOLDEN, GOLDEN / 2))
    y = (np.arange(1 << 20, dtype=np.uint32) * step + start) >> 8
    mean = np.mean(y.astype(float)) * 2.0**-24
    assert abs(mean - 0.5) <= 20 * 2.0**-20  # log2(n) / n
    # Sums of doubles are exact; the share, either half, and their sum are rounded, four times, by 2^-24 of what they
    # are: together by 2 * 2^-24 of a half. Places are below 1: by 2^-25 either time they are moved, and once as 1 - y.
    assert np.all(np.abs(np.array(estimate.value)[:4] - [mean, 1 - mean, 0.5, 1]) <= 4 * 2.0**-24)


@pytest.mark.parametrize("hidden", [False, True])
def test_the_least_samples_do_and_the_count_is_even(llvm_ad_rgb, hidden):
    from mitsuba_whitted import averages
    from mitsuba_whitted.water import LEAST_SAMPLES

    errors = np.array([1e-6, 3.9, 4.1, 13, 83, 1e9, math.inf], np.float32)
    counts = averages.needed(errors, np.full(7, hidden), 1.0).astype(float)
    assert np.all(counts % 2 == 0)
    exact = np.maximum(LEAST_SAMPLES, errors.astype(float))
    if hidden:
        exact = np.where(np.isfinite(exact), np.maximum(exact, averages.OF_HIDDEN), averages.OF_HIDDEN)
    exact = np.minimum(exact, averages.MOST_SAMPLES)
    assert np.all((counts >= exact) & (counts < exact + 2))


def test_samples_are_fitted_so_that_the_errors_foreseen_meet_the_budget(llvm_ad_rgb):
    from mitsuba_whitted import averages
    from mitsuba_whitted.water import AVERAGED, FALL, LEAST_SAMPLES

    rng = np.random.default_rng(2)
    errors, counts = rng.exponential(1, 500).astype(np.float32), 2 * rng.integers(4, 100, 500).astype(np.uint32)

    def squares(counts, of=slice(None)):
        return np.sum((AVERAGED * errors * counts.astype(float) ** -FALL)[of] ** 2)

    for part in (2, 0.5, 0.01):
        fitted = averages.fitted(counts, errors, part * squares(counts))
        assert squares(fitted) <= part * squares(counts) <= squares(fitted - 2)  # each is rounded up to an even one
    assert np.all(averages.fitted(counts, errors, 1e9 * squares(counts)) == LEAST_SAMPLES)
    errors[7] = 0
    others = averages.fitted(counts, errors, 0.01 * squares(counts))
    errors[7] = math.inf
    fitted = averages.fitted(counts, errors, 0.01 * squares(counts, errors != math.inf))
    assert fitted[7] == counts[7]
    assert np.array_equal(np.delete(fitted, 7), np.delete(others, 7))
    assert np.array_equal(averages.fitted(counts, np.full(500, math.inf, np.float32), 1.0), counts)


def test_what_would_take_more_than_to_split_it_is_left_to_be_split(llvm_ad_rgb, monkeypatch):
    from mitsuba_whitted import averages

    budget = np.sum(averaged_to(math.inf)[0] ** 2) / 4
    monkeypatch.setattr(averages, "OF_LAUNCHES", 0)
    monkeypatch.setattr(averages, "OF_PARTS", 8)
    errors, above, taken = averaged_to(budget, split=True)
    assert len(taken) == 1
    assert np.any(errors > above)
    # The errors are told in float32, a rounding each; the squares, their sums and the level in double.
    left = np.sum(np.minimum(errors, above).astype(float) ** 2)
    assert np.isclose(left, averages.TOLERANCE**2 * budget, rtol=4 * 2.0**-24, atol=0)


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


def test_steadied_errors_keep_their_sum_of_squares_and_part_of_what_was_foreseen():
    from mitsuba_whitted.averages import FORESEEN, _steadied

    measured, foreseen = np.array([0.0, 2.0, 1.0]), np.array([1.0, 1.0, 2.0])
    found = _steadied(measured, foreseen)
    exact = (1 - FORESEEN) * np.array([0, 4, 1]) + FORESEEN * np.array([5 / 6, 5 / 6, 10 / 3])
    assert np.allclose(found**2, exact, rtol=2.0**-50, atol=0)
    assert np.all(_steadied(np.zeros(3), np.zeros(3)) == 0)
