"""The lattice of samples that pixels share, and the order in which cells are looked at."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


@pytest.mark.parametrize(("width", "top", "bottom"), [(1, 0, 1), (64, 0, 32), (33, 5, 36), (70, 0, 3), (3, 2, 72)])
def test_every_corner_is_sampled_once(llvm_ad_rgb, width, top, bottom):
    from mitsuba_whitted import cells

    height = bottom - top
    taken, order = dr.zeros(mi.UInt32, (width + 1) * (height + 1)), []

    def look(x, y, active):
        order.append(np.stack([np.array(x), np.array(y) - top], 1))
        number = mi.UInt32(y - top) * (width + 1) + mi.UInt32(x)
        dr.scatter_add(taken, mi.UInt32(1), number, active)
        return mi.Vector4f(x, y, 0, 1), 7 + number

    some = cells.pixels(look, width, top, bottom)
    assert np.array_equal(np.array(some.paths), 7 + np.arange((width + 1) * (height + 1)))
    assert np.all(np.array(taken) == 1)
    across, down = np.meshgrid(np.arange(width + 1), np.arange(top, bottom + 1))
    assert np.array_equal(np.array(some.colours).reshape(-1, 4)[:, :2], np.stack([across.ravel(), down.ravel()], 1))
    inside = np.array(some.inside)
    assert np.count_nonzero(inside) == width * height
    assert len(set(zip(np.array(some.i)[inside], np.array(some.j)[inside], strict=True))) == width * height
    (places,) = order
    if width % cells.BLOCK == height % cells.BLOCK == 0:
        assert len(places) == (width + 1) * (height + 1)  # no lane is idle
    first = places[: cells.BLOCK**2].astype(int)
    assert np.all(first < cells.BLOCK)  # the first square, and along its Z curve every 16 are one of 4 x 4
    assert np.all(np.ptp(first.reshape(-1, 16, 2), axis=1) == 3)


@pytest.mark.parametrize("count", [500, 3072, 5000])
def test_cells_with_an_edge_come_first_in_each_square(llvm_ad_rgb, count):
    from mitsuba_whitted.cells import BLOCK, picked

    run, rng = BLOCK * BLOCK, np.random.default_rng(3)
    wanted, edge = rng.random(count) < 0.3, rng.random(count) < 0.4
    found = np.array(picked(mi.Bool(wanted), mi.Bool(edge)))
    assert np.array_equal(found, sorted(np.flatnonzero(wanted), key=lambda cell: (cell // run, not edge[cell], cell)))
    assert not np.array_equal(found, np.sort(found))


def test_none_is_picked_where_none_is_wanted(llvm_ad_rgb):
    from mitsuba_whitted.cells import picked

    assert dr.width(picked(dr.full(mi.Bool, False, 100), dr.full(mi.Bool, True, 100))) == 0
