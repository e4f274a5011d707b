"""What refinement would take if it were told how far off each pixel is: the best of its own pictures, pixel by pixel.

Each of them spends rays on pixels by what it guesses of their errors. The oracle knows these, and takes each pixel from
the picture where it gains most for its rays. It profits from errors that are small by luck, and its rays are those of
samples that lie in its pixels, though neighbours share some: what separates the two is the price of guessing, and this.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from whitted_validation.benchmark.error_drawing import Image

ORACLE = "chosen by an oracle"

NO_TARGET = 1e9
"""A target error above any that colours of these scenes can have, so that corners alone do; in clutter some pixels are
checked even so.
"""

STEPS, OCTAVES = 8, 64
"""Prices of a ray that are tried: so many an octave, and so many octaves down from the largest square of an error."""


class Oracle:
    """Knows how far off the pixels of some pictures are.

    Parameters
    ----------
    truth : (height, width, channels)
        The converged picture.
    pictures : of the same shape
        To choose from.
    rays : (height, width) each
        Of all kinds, by the pixel that they are traced for.
    """

    def __init__(self, truth: Image, pictures: Sequence[Image], rays: Sequence[NDArray[np.uint32]]) -> None:
        self._pictures = np.array(pictures)
        self._squares = np.array([np.mean((picture - truth.astype(float)) ** 2, axis=-1) for picture in pictures])
        self._rays = np.array(rays, float)

    def choose(self, rmse: float) -> tuple[Image, int]:
        """Choose pixels by one price of a ray for all of them: the highest tried that reaches this RMSE, or the lowest.

        Returns
        -------
        Image, int
            The picture, and its rays in all. No choice with as small an RMSE as it has takes fewer (Everett 1963); one
            between two prices, with an RMSE between theirs, may.
        """
        highest = float(np.max(self._squares))

        def chosen(step: int) -> NDArray[np.intp]:
            price = highest * 2 ** (-step / STEPS)
            found: NDArray[np.intp] = np.argmin(self._squares + price * self._rays, axis=0)[None]
            return found

        def suffices(step: int) -> bool:
            return bool(np.mean(np.take_along_axis(self._squares, chosen(step), 0)) <= rmse**2)

        best = chosen(bisect.bisect_left(range(STEPS * OCTAVES), True, key=suffices))
        picture = np.take_along_axis(self._pictures, best[..., None], 0)[0]
        return picture, int(np.take_along_axis(self._rays, best, 0).sum())
