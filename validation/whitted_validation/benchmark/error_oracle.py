"""What refinement would take if it were told how far off each pixel is: the best of its own pictures, pixel by pixel.

Each of them spends rays on pixels by what it guesses of their errors. The oracle knows these, and takes each pixel from
the picture where it gains most for its rays; by luck too, where a coarse one happens to be near. So what separates the
two is the price of guessing, and nobody who refines pixels in these ways takes fewer rays.
"""

from __future__ import annotations

import bisect

import numpy as np
from numpy.typing import NDArray

from whitted_validation.benchmark.error_drawing import Image

ORACLE = "target error, chosen by an oracle"

NO_TARGET = 1e9
"""A target error that corners alone meet; in clutter some pixels are checked even so."""

STEPS, OCTAVES = 8, 64
"""Prices of a ray that are tried: so many an octave, and so many octaves down from the largest square of an error."""


class Oracle:
    """Pictures of one scene to several targets, and what each of their pixels takes.

    Parameters
    ----------
    truth : (height, width, channels)
        The converged picture.
    """

    def __init__(self, truth: Image) -> None:
        self._truth = truth.astype(np.float64)
        self._pictures: list[Image] = []
        self._squares: list[NDArray[np.float64]] = []
        self._rays: list[NDArray[np.float64]] = []

    def learn(self, picture: Image, rays: NDArray[np.uint32]) -> None:
        """Take a picture to choose from, of the shape of the converged one, and the rays of its pixels."""
        self._pictures.append(picture)
        self._squares.append(np.mean((picture - self._truth) ** 2, axis=-1))
        self._rays.append(rays.astype(np.float64))

    def choose(self, rmse: float) -> tuple[Image, int]:
        """Choose pixels of such an RMSE at most, or else the best: the picture, and its rays.

        Where all pixels of a sum of squares weigh a ray alike, by one price, no other choice of that sum takes fewer
        rays (Lagrange; Everett 1963).
        """
        squares, rays, pictures = map(np.array, (self._squares, self._rays, self._pictures))
        highest = float(np.max(squares))

        def chosen(step: int) -> NDArray[np.intp]:
            found: NDArray[np.intp] = np.argmin(squares + highest * 2 ** (-step / STEPS) * rays, axis=0)[None]
            return found

        def suffices(step: int) -> bool:
            return bool(np.mean(np.take_along_axis(squares, chosen(step), 0)) <= rmse**2)

        last = STEPS * OCTAVES
        best = chosen(bisect.bisect_left(range(last), True, key=suffices))
        picture = np.take_along_axis(pictures, best[..., None], 0)[0]
        return picture, int(np.take_along_axis(rays, best, 0).sum())
