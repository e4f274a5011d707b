"""Lattices of samples: how far off averages over them are, for edges at random."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)

NODES, WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(64))
ALL = np.stack(np.meshgrid(NODES + 0.5, NODES + 0.5), axis=-1).reshape(-1, 2)
OF_ALL = np.outer(WEIGHTS, WEIGHTS).ravel()

APART = (2 + np.sqrt(2) + 5 * np.arcsinh(1)) / 15
"""Mean distance of two points of a square (Ghosh 1951)."""


def placed(count, step, start):
    k = np.arange(count)
    places = np.array([(k + 0.5) / count, (start + k * step) % 1]).T
    return places + (0.5 - places) * 2 / (count + 4)


def distances(some, others):
    return np.linalg.norm(some[:, None] - others[None], axis=2)


def squares(places):
    """Energies of what the average is off, and of what two halves of it differ."""
    count = len(places)
    corners = 2 / (count + 4)
    weights = np.append(np.full(count, (1 - corners) / count), np.full(4, corners / 4))
    samples = np.concatenate([places, CORNERS])
    off = 2 * weights @ (distances(samples, ALL) @ OF_ALL) - weights @ distances(samples, samples) @ weights - APART
    signs = np.append(np.where(np.arange(count) % 2, -1, 1) * weights[:count], np.zeros(4))
    return off, -signs @ distances(samples, samples) @ signs


def test_squares_are_those_of_edges_at_random():
    # Lines at a random angle and distance from the middle, as far as they meet the square; some miss it.
    places, rng = placed(6, 0.37, 0.4), np.random.default_rng(4)
    angle, distance = rng.uniform(0, np.pi, 20_000), rng.uniform(-(0.5**0.5), 0.5**0.5, 20_000)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]

    def beyond(points):
        return c * (points[:, 0] - 0.5) + s * (points[:, 1] - 0.5) > distance[:, None]

    across = (np.arange(200) + 0.5) / 200 - 0.5
    cut = (distance[:, None] - across * np.where(abs(s) > abs(c), c, s)) / np.where(abs(s) > abs(c), s, c)
    area = np.clip(0.5 - cut, 0, 1).mean(axis=1)
    area = np.where(np.where(abs(s) > abs(c), s, c)[:, 0] > 0, area, 1 - area)
    off = 0.8 * beyond(places).mean(axis=1) + 0.2 * beyond(CORNERS).mean(axis=1) - area
    differ = 0.8 / 6 * (beyond(places[::2]).sum(axis=1) - beyond(places[1::2]).sum(axis=1))
    # A quarter of the energy for lines that meet the square, whose mean width is 4 / pi, of all on a width of sqrt(2).
    expected = np.array(squares(places)) / 4 * (4 / np.pi) / 2**0.5
    found = np.array([off**2, differ**2])
    deviation = found.std(axis=1) / len(area) ** 0.5
    assert np.all(np.abs(found.mean(axis=1) - expected) < 4 * deviation)  # 1 of 8000 such pairs is further off


@pytest.mark.parametrize("count", [2, 4, 14, 62, 64, 66, 200])
def test_points_are_those_of_the_lattice(llvm_ad_rgb, count):
    from mitsuba_whitted.lattices import BEST, GOLDEN, point

    found = np.array(point(dr.arange(mi.UInt32, count), dr.full(mi.UInt32, count, count))).T
    expected = placed(count, *(BEST[count // 2 - 1] if count <= 64 else (GOLDEN, GOLDEN / 2)))
    # The quotient or the cut to 2^-24, the share, and two for the move.
    assert np.all(np.abs(found - expected) <= 4 * 2.0**-24)


@pytest.mark.parametrize("count", range(2, 66, 2))
def test_lattices_are_better_than_by_the_golden_ratio_and_than_others_at_random(count):
    from mitsuba_whitted.lattices import BEST, GOLDEN

    def of_halves(off, differ):
        """Tell the error in parts of the difference of the halves' means, which are twice their shares."""
        return 0.5 * (off / differ) ** 0.5

    off, differ = squares(placed(count, *BEST[count // 2 - 1]))
    assert 0.27 <= of_halves(off, differ) <= 0.33
    assert off < squares(placed(count, GOLDEN, GOLDEN / 2))[0]
    others = np.array([squares(placed(count, *other)) for other in np.random.default_rng(count).random((100, 2))])
    fair = np.abs(of_halves(*others.T) - 0.3) <= 0.03
    assert np.any(fair)
    assert np.all(off < others[fair, 0])


def test_by_how_much():
    from mitsuba_whitted.lattices import BEST, GOLDEN

    ratios = [
        squares(placed(2 * k, *best))[0] / squares(placed(2 * k, GOLDEN, GOLDEN / 2))[0]
        for k, best in enumerate(BEST, 1)
    ]
    assert round(np.exp(np.mean(np.log(ratios)) / 2), 2) == 0.92
    # What the text of AVERAGED says. The outline of the cell is 4, which is how many lines meet it (Crofton).
    left = [round((squares(placed(n, *BEST[n // 2 - 1]))[0] / 4) ** 0.5 / 0.3, 3) for n in (2, 6, 16, 64)]
    assert left == [0.336, 0.182, 0.099, 0.037]
