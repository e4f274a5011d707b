"""What corners say of cells, and the level to which errors are poured: held against plain numpy."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 6), (2, 3), (5, 2), (9, 7)])
def test_the_error_of_one_path_is_that_of_its_differences(llvm_ad_rgb, width, height):
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners

    shown = np.random.default_rng(width).random((height + 1, width + 1, 3)).astype(np.float32)
    table = mi.Float(shown.ravel())

    def look(x, y, active):
        colour = dr.gather(mi.Color3f, table, mi.UInt32(y) * (width + 1) + mi.UInt32(x), active)
        return mi.Vector4f(colour.x, colour.y, colour.z, 1), mi.UInt32(0)

    some = cells.pixels(look, width, 0, height)
    estimate, _ = from_corners(some, 1e-3)
    found = np.full((height, width), np.nan)
    inside = np.array(some.inside)
    found[np.array(some.j)[inside], np.array(some.i)[inside]] = np.array(estimate.error)[inside]

    _assert_bends(found, shown)


def test_cells_of_one_split_are_not_compared_with_those_of_another(llvm_ad_rgb):
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import _bend

    shown = np.random.default_rng(6).random((5, 7, 3)).astype(np.float32)  # at every half pixel of 3 x 2
    table = mi.Float(shown.ravel())

    def look(x, y, active):
        colour = dr.gather(mi.Color3f, table, mi.UInt32(2 * y) * 7 + mi.UInt32(2 * x), active)
        return mi.Vector4f(colour.x, colour.y, colour.z, 1), mi.UInt32(0)

    some = cells.pixels(look, 3, 0, 2)
    split = dr.compress(some.inside)
    i, j = (np.array(dr.gather(mi.UInt32, part, split)) for part in (some.i, some.j))
    parts = cells.quarters(look, some, split)
    found = np.array(_bend(parts, [parts.colour(sample) for sample in parts.corners()])).reshape(-1, 2, 2)
    assert len(found) == 6
    for of_split, column, row in zip(found, i, j, strict=True):
        _assert_bends(of_split, shown[2 * row : 2 * row + 3, 2 * column : 2 * column + 3])


def _assert_bends(found, shown):
    """Compare errors of cells, (rows, columns), with what the samples at their corners say, (rows + 1, columns + 1)."""
    from mitsuba_whitted.corners import OF_BEND, OF_STEP

    def along(samples, at):
        """Take the largest of what second and third differences say, of a side's ends and the samples next to them."""
        some = samples[max(0, at - 1) : at + 3].astype(float)
        said = [np.zeros(3), *(OF_BEND * each for each in np.diff(some, 2, axis=0))]
        return max(
            np.sqrt(np.mean(each**2)) for each in (*said, *(OF_STEP * each for each in np.diff(some, 3, axis=0)))
        )

    for j, i in np.ndindex(found.shape):
        across = max(along(shown[j + side], i) for side in (0, 1))
        down = max(along(shown[:, i + side], j) for side in (0, 1))
        # Differences of numbers below 1: three roundings each, of at most 4; squares, their sum, the weight and root.
        assert abs(found[j, i] - across - down) <= (3 * 4 * max(OF_BEND, OF_STEP) + 8 * (across + down)) * 2.0**-24


def test_the_level_is_the_highest_whose_averages_meet_the_budget(llvm_ad_rgb):
    from mitsuba_whitted.cells import Kind
    from mitsuba_whitted.water import AVERAGED, BINS, FALL, LEAST_SAMPLES, UNTOUCHED, levels, water_level

    target, errors, rng = 2e-3, np.zeros((3, BINS)), np.random.default_rng(8)
    errors[Kind.CLUTTER] = rng.integers(0, 50, BINS)
    of_bins = levels(target)

    def left(limit):
        error = UNTOUCHED[Kind.CLUTTER] * of_bins
        averaged = AVERAGED * error / np.maximum(LEAST_SAMPLES, error / limit) ** FALL
        return np.sum(errors[Kind.CLUTTER] * np.where(of_bins > limit, averaged, error) ** 2)

    for place in (20, 50, 80):
        budget = left(of_bins[place])
        for less in (False, True):
            found = water_level(errors, target, budget * (0.999 if less else 1.001))  # one level is 1.19 times another
            assert found == of_bins[place - less]


def test_clutter_is_averaged_as_if_it_were_what_it_mostly_turns_out_to_be(llvm_ad_rgb, monkeypatch):
    from mitsuba_whitted import antialias, averages, cells
    from mitsuba_whitted.cells import Kind
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.water import UNTOUCHED

    def look(x, y, active):  # squares that corners meet at random, and an edge
        square = (mi.UInt32(x * 1.37) + mi.UInt32(y * 1.61)) & 1
        path = dr.select(
            x < 20, square + 2 * mi.UInt32(y * 1.61), 1000 + dr.select(x + 0.3 * y > 31.7, mi.UInt32(1), 0)
        )
        colour = dr.select((path & 1) == 1, mi.Float(1), 0)
        return mi.Vector4f(colour, colour, colour, 1), path

    def guessed(part):
        asked, averaged, parts = [], [], averages.OF_KIND.copy()
        parts[Kind.CLUTTER] = part
        monkeypatch.setattr(antialias, "OF_KIND", parts)
        monkeypatch.setattr(antialias, "needed", lambda *some: asked.append(some) or averages.needed(*some))
        monkeypatch.setattr(antialias, "suffice", lambda *_: True)
        monkeypatch.setattr(antialias, "average_to", lambda *some: averaged.append(some[3]))
        antialias.refined(look, 40, 0, 40, 1e-2)
        return asked[0][0], averaged[0]

    (once, which), (half, _) = guessed(1.0), guessed(0.5)
    estimate, _ = from_corners(cells.pixels(look, 40, 0, 40), 1e-2)
    clutter = np.array(estimate.kind)[which] == Kind.CLUTTER
    assert np.any(clutter)
    assert not np.all(clutter)
    assert np.array_equal(half, np.where(clutter, 0.5, 1) * once)
    assert averages.OF_KIND[Kind.EDGE] == 1
    assert averages.OF_KIND[Kind.CLUTTER] == np.float32(UNTOUCHED[Kind.CLUTTER])
