"""Cells cut in two by an edge: what is expected of the colours of either part, and of the edge."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


def linear(x, y):
    """Show colours that change evenly, and otherwise on the two sides of a line."""
    return mi.Vector4f(0.3 + 0.02 * x - 0.01 * y, 0.5 - 0.03 * y, 0.2, 1), mi.Vector4f(0.9 - 0.02 * x, 0.8, 0.1 * y, 1)


MOST_CHANGE = 0.1
"""Over a cell, of any channel on either side, along x or y."""


def spread(parts, of_a):
    """Least eigenvalue of the sum of o o^T over the corners of a part, o from its centroid, for each cell."""
    centroid = parts.centroid_a if of_a else parts.centroid_b
    total = np.zeros((2, 2, dr.width(centroid)))
    for corner, in_a in zip([(0, 0), (1, 0), (1, 1), (0, 1)], parts.in_a, strict=True):
        out = np.array(mi.Point2f(*corner) - centroid) * (np.array(in_a) == of_a)
        total += out[:, None] * out[None]
    return np.linalg.eigvalsh(total.transpose(2, 0, 1))[:, 0] + 1e-30


def look_at(line, shown=linear):
    """Make a Look of what is shown on the two sides of a line a x + b y > c."""
    a, b, c = line

    def look(x, y, active):
        first = a * x + b * y > c
        one, other = shown(x, y)
        return dr.select(first, one, other), dr.select(first, mi.UInt32(7), 3)

    return look


LINES = {
    "upright": (1, 0.1, 10.4),
    "level": (-0.07, 1, 5.3),
    "sloping": (1, 0.8, 14.2),
    "steep": (1, -0.3, 4.13),
}


def edges(line, shown=linear, size=16, limit=1e-4, checks=0):
    """Look closer at all pixels that a line cuts: their numbers, estimates before and after, and the pixels."""
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.edges import look_closer

    look = look_at(line, shown)
    some = cells.pixels(look, size, 0, size)
    estimate, _ = from_corners(some, 1e-3)
    cut = dr.compress(some.inside & (estimate.kind == cells.Kind.EDGE.value))
    before = np.array(estimate.error)[np.array(cut)]
    checks, follow = dr.full(mi.UInt32, checks, dr.width(cut)), dr.zeros(mi.UInt32, dr.width(cut))
    dr.make_opaque(checks, follow)
    look_closer(look, some, estimate, cut, checks, follow, dr.opaque(mi.Float, limit))
    return np.array(cut), before, estimate, some


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
def test_colours_that_change_evenly_are_continued_exactly(llvm_ad_rgb, line):
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.crossings import crossings
    from mitsuba_whitted.parts import LEVEL, cut

    look = look_at(line)
    some = cells.pixels(look, 16, 0, 16)
    estimate, _ = from_corners(some, 1e-3)
    two = dr.compress(some.inside & (estimate.kind == cells.Kind.EDGE.value))
    yes = dr.full(mi.Bool, True, dr.width(two))
    here = some.some(two)
    parts = cut(here, crossings(look, some, two, yes, dr.opaque(mi.Float, 1e-9)), yes)
    assert dr.all(parts.unclear == 0)

    def shown(at, first):
        one, other = linear(here.x + at.x, here.y + at.y)
        return dr.select(first, one, other)

    a_first = here.path(here.corner) == 7
    colour_a, colour_b = shown(parts.centroid_a, a_first), shown(parts.centroid_b, ~a_first)
    corners_of_a = np.sum([np.array(corner) for corner in parts.in_a], axis=0)
    least = [spread(parts, of_a) for of_a in (True, False)]
    rng = np.random.default_rng(3)
    seen = 0
    for _ in range(20):
        at = mi.Point2f(*rng.random(2).tolist())
        is_a = (line[0] * (here.x + at.x) + line[1] * (here.y + at.y) > line[2]) == a_first
        off = np.abs(np.array(parts.expected(is_a, colour_a, colour_b, at) - shown(at, is_a == a_first)))
        corners = np.where(np.array(is_a), corners_of_a, 4 - corners_of_a)
        # Colours, differences, products and sums: sixteen roundings of numbers of at most 1. And LEVEL takes from the
        # plane its part of the least sum of squares that it is fitted by, in any direction: at most that of the most
        # change over a cell, to a point no further away than across it.
        shrunk = LEVEL / np.where(np.array(is_a), *least) * MOST_CHANGE * math.sqrt(2)
        assert np.all((off <= shrunk + 16 * 2.0**-24)[:, corners >= 2])
        assert np.all(off[:, corners == 1] <= MOST_CHANGE * math.sqrt(2))  # level across the way to that corner
        seen += (corners >= 2).sum()
    assert seen > 100


def looked_at(look, checks, limit):
    """Look closer at the pixel in column and row 8: the pixel, and what was known of it before and after."""
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.edges import look_closer

    some = cells.pixels(look, 16, 0, 16)
    estimate, _ = from_corners(some, 1e-3)
    pixel = dr.compress(some.inside & (some.i == 8) & (some.j == 8))
    here, before = some.some(pixel), estimate.some(pixel)
    dr.eval(before)
    of_pixel, none = dr.opaque(mi.UInt32, checks, 1), dr.opaque(mi.UInt32, 0, 1)
    look_closer(look, some, estimate, pixel, of_pixel, none, dr.opaque(mi.Float, limit))
    return here, before, estimate.some(pixel)


def first_check(here, inside):
    """Find the number of the place of the first check, of those spread evenly, that lies inside."""
    from mitsuba_whitted.places import PLACES, numbered, of_check

    places = (of_check(here, mi.UInt32(k), mi.UInt32(0)) for k in range(1, PLACES))
    return next(numbered(at)[0] for at in places if inside(8 + at.x, 8 + at.y)[0])


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
def test_an_edge_between_colours_that_change_evenly_does_not_surprise(llvm_ad_rgb, line):
    cut, _, estimate, some = edges(line, limit=2e-3, checks=40)
    paths = np.array([np.array(some.path(corner))[cut] for corner in some.corners()])
    plane = (paths == paths[0]).sum(axis=0) == 2  # and the centroid: either part has a plane
    assert plane.sum() >= 3
    assert np.all(np.array(estimate.surprise)[cut][plane] == 0)


@pytest.mark.parametrize("slope", [0.07, 0.31, -0.83])
def test_a_straight_edge_between_two_colours_does_not_surprise_wherever_it_cuts(llvm_ad_rgb, slope):
    # Also close by a corner, where what the search leaves open of the bulge is much beside the chord.
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.edges import look_closer

    size = 64

    def look(x, y, active):
        above = y - size / 2 > slope * (x - size / 2) + 0.013
        grey = dr.select(above, mi.Float(1), 0)
        return mi.Vector4f(grey, grey, grey, 1), dr.select(above, mi.UInt32(2), 1)

    some = cells.pixels(look, size, 0, size)
    estimate, _ = from_corners(some, 1e-3)
    cut = dr.compress(some.inside & (estimate.kind == cells.Kind.EDGE.value))
    many, none = dr.full(mi.UInt32, 64, dr.width(cut)), dr.zeros(mi.UInt32, dr.width(cut))
    look_closer(look, some, estimate, cut, many, none, dr.opaque(mi.Float, 1e-3))
    assert dr.width(cut) >= size
    assert dr.all(estimate.some(cut).surprise == 0)


def test_an_edge_bends_by_its_bulge(llvm_ad_rgb):
    from mitsuba_whitted.parts import Parts

    zero = mi.Float(0)
    middle, away, length = mi.Point2f(0.5, 0.4), mi.Vector2f(0, 1), mi.Float(0.8)
    parts = Parts(*[zero] * 10, middle, length, away, mi.Bool(False))
    # Differences, two products each and their sums, a quotient: ten roundings of numbers of at most 0.8.
    for x, height in ((0.1, 0), (0.5, 0.2), (0.9, 0), (0.3, 0.15), (0.7, 0.15)):
        assert np.abs(np.array(parts.beyond(mi.Float(0.2), mi.Point2f(x, 0.4 + height)))) <= 8 * 2.0**-24
    assert np.array(parts.beyond(mi.Float(0.2), mi.Point2f(0.5, 0.9))) > 0


def test_an_edge_whose_colours_are_not_known_has_the_error_of_its_contrast(llvm_ad_rgb):
    # What an average has to find anew is all of the edge, however nearly its own estimate came to the limit.
    def shown(x, y):
        wave = 0.2 * dr.sin(7 * x) * dr.sin(9 * y)
        return mi.Vector4f(0.8 + wave, 0.8 + wave, 0.8 + wave, 1), mi.Vector4f(0.1, 0.1, 0.1, 1)

    limit = 1e-3
    cut, before, estimate, _ = edges(LINES["upright"], shown, limit=limit)
    errors = np.array(estimate.error)[cut]
    wrong = errors > limit
    assert wrong.sum() > 8
    assert np.all(errors[wrong] >= before[wrong])


@pytest.mark.parametrize("limit", [2e-3, 3.2e-3])
def test_a_bowl_does_not_surprise(llvm_ad_rgb, limit):
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.edges import look_closer

    def look(x, y, active):
        bowl = 0.01 * ((x - 8.5) ** 2 + (y - 8.5) ** 2)
        return mi.Vector4f(bowl, bowl, bowl, 1), mi.UInt32(0)

    some = cells.pixels(look, 17, 0, 17)
    estimate, _ = from_corners(some, 1e-3)
    x, y = np.array(some.x), np.array(some.y)
    chosen = np.array(some.inside)
    which = dr.compress(mi.Bool(chosen))
    checks, follow = dr.full(mi.UInt32, 20, dr.width(which)), dr.zeros(mi.UInt32, dr.width(which))
    dr.make_opaque(checks, follow)
    exact = 0.01 * ((x - 8) ** 2 + (y - 8) ** 2 + 1 / 6)[chosen]
    # Between the corners the bowl hangs by up to 0.005, a surprise for the lower limit: but the centre tells. Twice, as
    # where something is followed: the centre is not asked again then.
    for again in range(2):
        look_closer(look, some, estimate, which, checks, follow + again, dr.opaque(mi.Float, limit))
        assert np.all(np.array(estimate.surprise)[chosen] == 0)
        values = np.array(estimate.value).reshape(-1, 4)[chosen, 0]
        # 0.01 and its product with a square, which is exact; three sums for the mean, one more, the third and its
        # product: eight roundings of numbers of at most 0.01 * 2 * 8.5^2.
        assert np.all(np.abs(values - exact) <= 8 * 2.0**-24 * 0.01 * 2 * 8.5**2)


def test_a_cell_that_is_only_checked_takes_its_checks_and_keeps_its_colour(llvm_ad_rgb):
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.edges import look_closer

    taken = dr.zeros(mi.UInt32, 1)

    def look(x, y, active):
        dr.scatter_add(taken, mi.UInt32(1), mi.UInt32(0), active)
        return linear(x, y)[0], mi.UInt32(0)

    some = cells.pixels(look, 8, 0, 8)
    estimate, _ = from_corners(some, 1e-3)
    every = dr.compress(some.inside)
    before = np.array(estimate.value), np.array(estimate.error)
    checks, follow = dr.full(mi.UInt32, 3, dr.width(every)), dr.zeros(mi.UInt32, dr.width(every))
    dr.make_opaque(checks, follow, taken)
    taken -= taken
    dr.make_opaque(taken)
    look_closer(look, some, estimate, every, checks, follow, dr.opaque(mi.Float, 2e-3))
    assert np.array(taken)[0] == 3 * 64
    assert np.array_equal(np.array(estimate.value), before[0])
    assert np.array_equal(np.array(estimate.error), before[1])


@pytest.mark.parametrize(("third", "green", "clear"), [(0.25, 0.5, False), (0.375, 0.5, True), (0.375, 1, False)])
def test_a_third_path_counts_unless_it_is_faint_and_only_the_last_step_of_a_search_meets_it(
    llvm_ad_rgb, third, green, clear
):
    # An upright edge, and beside it a thin strip. The search looks at 1/2, 1/4 and 3/8, and is done within 1/8. Of
    # the 1/4 that is left before the last step, a strip that is off by 1/2 in one channel may fill all, by 1 not.
    from mitsuba_whitted import cells
    from mitsuba_whitted.crossings import CROSSING, crossings, sides

    def look(x, y, active):
        at = x - 5
        strip = dr.abs(at - third) < 0.01
        colour = dr.select(
            strip, mi.Vector4f(0, green, 0, 1), dr.select(at > 0.37, mi.Vector4f(1), mi.Vector4f(0, 0, 0, 1))
        )
        return colour, dr.select(strip, mi.UInt32(3), dr.select(at > 0.37, mi.UInt32(7), 5))

    some = cells.pixels(look, 16, 0, 16)
    cut = dr.compress(some.inside & (some.i == 5))
    found = crossings(look, some, cut, dr.full(mi.Bool, True, dr.width(cut)), dr.opaque(mi.Float, CROSSING / 8))
    top = dr.gather(mi.Float, found, sides(some.some(cut))[0])
    if clear:
        assert np.all(np.array(top) == 5 / 16)
    else:  # from black, which is nearer than white: a square, its third, and a root, each rounded, as this is
        assert np.allclose(np.array(top), -green / math.sqrt(3), rtol=4 * 2.0**-24, atol=0)


@pytest.mark.parametrize("bright", [0.5, 7.0, math.inf, math.nan])
def test_where_a_crossing_is_not_found_it_is_off_by_what_was_met_instead(llvm_ad_rgb, bright):
    # A faint edge, and before its middle something bright that no corner meets, nor any check: none is asked for.
    from mitsuba_whitted.corners import OF_RANGE

    def look(x, y, active):
        lit, right = (dr.abs(x - 8.5) < 0.2) & (dr.abs(y - 8) < 0.2), x > 8.4
        grey = dr.select(lit, mi.Float(bright), dr.select(right, mi.Float(0.03), 0))
        return mi.Vector4f(grey, grey, grey, 1), dr.select(lit, mi.UInt32(3), dr.select(right, mi.UInt32(2), 1))

    limit = 2e-3
    _, before, after = looked_at(look, 0, limit)
    assert dr.all(after.value == before.value)
    if math.isnan(bright):
        assert after.error[0] > limit
    else:
        assert after.error[0] >= OF_RANGE * (bright - 0.03) * (1 - 4 * 2.0**-24)


@pytest.mark.parametrize("without", [None, 8])
@pytest.mark.parametrize("upright", [True, False])
def test_a_side_is_sought_once_by_whichever_of_its_cells_is_looked_at(llvm_ad_rgb, upright, without):
    # An edge through 16 cells in a row, of which one may not be looked at: others have its two sides too.
    from mitsuba_whitted import cells
    from mitsuba_whitted.crossings import CROSSING, crossings, sides

    taken = dr.zeros(mi.UInt32, 1)

    def look(x, y, active):
        counts = active & (x > -dr.inf)  # as wide as the samples
        dr.scatter_add(taken, mi.UInt32(1), mi.UInt32(0), counts)
        beyond = (x if upright else y) > 5.37
        return mi.Vector4f(dr.select(beyond, mi.Float(1), 0)), dr.select(beyond, mi.UInt32(7), 5)

    some = cells.pixels(look, 16, 0, 16)
    dr.eval(some.colours, some.paths)
    corners = int(taken[0])
    place, along = (some.i, some.j) if upright else (some.j, some.i)
    cut = dr.compress(some.inside & (place == 5))
    two = dr.full(mi.Bool, True, 16) if without is None else dr.gather(mi.UInt32, along, cut) != without
    found = crossings(look, some, cut, two, dr.opaque(mi.Float, CROSSING / 8))
    assert int(taken[0]) - corners == 17 * 3  # halved to an eighth
    crossed = sides(some.some(cut))
    for side in (crossed[0], crossed[2]) if upright else (crossed[3], crossed[1]):
        assert np.all(np.array(dr.gather(mi.Float, found, side)) == 5 / 16)


@pytest.mark.parametrize(
    ("tip", "middle", "width", "fewest", "most"),
    [(10.9, 10.6, 0.4, 1, 1), (10.9, 10.75, 0.2, 2, 20), (10, 10.6, 0.4, 20, 20)],
)
def test_where_paths_have_colours_that_are_alike_centre_and_checks_tell_what_else_is_there(
    llvm_ad_rgb, tip, middle, width, fewest, most
):
    # A bright wedge meets corners of the pixel to its left only; its tip fills part of this one, or ends before it.
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import from_corners
    from mitsuba_whitted.edges import look_closer

    taken = dr.zeros(mi.UInt32, 1)

    def look(x, y, active):
        dr.scatter_add(taken, mi.UInt32(1), mi.UInt32(0), active)
        lower, wedge = y > 10.2, (x < tip) & (dr.abs(y - middle) < width * (10.9 - x))
        grey = dr.select(wedge, mi.Float(1), dr.select(lower, mi.Float(0.5), 0.5001))
        number = dr.select(wedge, mi.UInt32(3), dr.select(lower, mi.UInt32(2), 1))
        return mi.Vector4f(grey, grey, grey, 1), number

    some = cells.pixels(look, 16, 0, 16)
    estimate, _ = from_corners(some, 1e-3)
    pixel = dr.compress(some.inside & (some.i == 10) & (some.j == 10))
    limit, before = 5e-3, estimate.some(pixel)
    dr.eval(before)
    assert before.kind[0] == cells.Kind.EDGE
    assert before.error[0] > limit
    corners, checks, follow = int(taken[0]), dr.opaque(mi.UInt32, 20, 1), dr.opaque(mi.UInt32, 0, 1)
    look_closer(look, some, estimate, pixel, checks, follow, dr.opaque(mi.Float, limit))
    assert fewest <= int(taken[0]) - corners <= most  # the centre is one of the checks that were asked for
    after = estimate.some(pixel)
    if tip > 10:
        assert after.error[0] >= before.error[0]
        assert after.surprise[0] > 0
        assert dr.all(after.value == before.value)
    else:
        assert after.error[0] < limit
        assert 0.5 < after.value.x[0] < 0.5001


def test_what_an_edge_asks_at_its_centroids_counts_as_checks(llvm_ad_rgb):
    taken = dr.zeros(mi.UInt32, 1)

    def look(x, y, active):
        dr.scatter_add(taken, mi.UInt32(1), mi.UInt32(0), active)
        right = x > 8.4
        grey = dr.select(right, mi.Float(1), 0)
        return mi.Vector4f(grey, grey, grey, 1), dr.select(right, mi.UInt32(2), 1)

    def asked(checks):
        before = int(taken[0])
        _, _, after = looked_at(look, checks, 1e-2)
        assert after.surprise[0] == 0
        return int(taken[0]) - before - 17 * 17  # and the corners

    assert asked(0) == asked(1) == asked(2) == asked(5) - 3


@pytest.mark.parametrize(
    ("path", "slope", "channels", "hides"),
    [(2, 0.0, 3, True), (2, 0.5, 3, True), (1, 0.3, 3, False), (1, 0.3, 1, True), (1, 0.1, 3, True), (1, 0.0, 3, True)],
)
def test_what_checks_meet_hides_if_its_path_is_another_or_it_is_further_off_than_the_corners_range(
    llvm_ad_rgb, path, slope, channels, hides
):
    # A disc is brighter by 0.2 than its ground, which brightens by `slope` from the upper corners to the lower: grey,
    # or in red alone, which is a range of 0.17.
    def look(x, y, active):
        disc = (x - 8.3) ** 2 + (y - 8.4) ** 2 < 0.04
        red, others = (slope * (y - 8) * here + dr.select(disc, mi.Float(0.2), 0) for here in (1, channels == 3))
        return mi.Vector4f(red, others, others, 1), dr.select(disc, mi.UInt32(path), 1)

    here, _, after = looked_at(look, 64, 1e-3)
    met = first_check(here, lambda x, y: (x - 8.3) ** 2 + (y - 8.4) ** 2 < 0.04)
    assert after.surprise[0] == 2 * met + hides
    assert after.surprised()[0]
    assert after.hides()[0] == hides


@pytest.mark.parametrize(("begin", "hides"), [(8.35, False), (8.6, True)])
def test_what_checks_meet_beyond_an_edge_hides_if_it_is_too_far_off_for_a_bulge(llvm_ad_rgb, begin, hides):
    from mitsuba_whitted.edges import LARGEST_BULGE

    # An upright edge, and beyond it more of what lies before it.
    def more(x, y):
        return (x > begin) & (x < begin + 0.06) & (y > 8.6) & (y < 8.9)

    def look(x, y, active):
        left = (x < 8.3) | more(x, y)
        grey = dr.select(left, mi.Float(1), 0)
        return mi.Vector4f(grey, grey, grey, 1), dr.select(left, mi.UInt32(2), 1)

    assert (begin - 8.3 > LARGEST_BULGE) == hides == (begin + 0.06 - 8.3 > LARGEST_BULGE)
    here, _, after = looked_at(look, 96, 1e-3)
    assert after.surprise[0] == 2 * first_check(here, more) + hides
    assert not after.surprised()[0]
    assert after.hides()[0] == hides


@pytest.mark.parametrize("limit", [0.01, 0.1])
def test_a_step_within_one_path_is_as_far_off_as_an_edge_once_it_is_too_much_for_a_bend(llvm_ad_rgb, limit):
    # A corner of the pixel is another facet of one mesh: the centre is off the mean of the corners by a quarter.
    from mitsuba_whitted import cells
    from mitsuba_whitted.corners import OF_RANGE, from_corners
    from mitsuba_whitted.edges import SIMPSON, look_closer

    def look(x, y, active):
        grey = dr.select((x > 8.6) & (y > 8.6), mi.Float(1), 0)
        return mi.Vector4f(grey, grey, grey, 1), mi.UInt32(1)

    some = cells.pixels(look, 16, 0, 16)
    estimate, _ = from_corners(some, 1e-3)
    pixel = dr.compress(some.inside & (some.i == 8) & (some.j == 8))
    zero = dr.opaque(mi.UInt32, 0, 1)
    look_closer(look, some, estimate, pixel, zero, zero, dr.opaque(mi.Float, limit))
    error, bend = estimate.some(pixel).error[0], 0.25 * SIMPSON
    # Squares and sums of such numbers are exact. The third and its product, halved by the root, are one rounding, the
    # root another, the constant before it and its product two more.
    assert dr.allclose(error, OF_RANGE if bend > limit else bend, rtol=4 * 2.0**-24, atol=0)
