"""The transforms of Mitsuba's objects as float64 matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.errors import SceneError

Matrix = NDArray[np.float64]


def matrix_of(to_world: Any, owner: str, cause: str = "to_world") -> Matrix:
    """Convert a transform as Mitsuba stores it, rounded to float32, to a (4, 4) matrix.

    Parameters
    ----------
    to_world
        Value of the parameter.
    owner, cause : str
        Whose it is and what it was made from, for the message.

    Raises
    ------
    SceneError
        If it is not finite or not invertible.
    """
    matrix: Matrix = np.array(to_world.matrix, float).reshape(4, 4)
    if not np.all(np.isfinite(matrix)):
        raise SceneError(f"{owner}: {cause} is not finite; every number must be")
    if np.linalg.det(matrix[:3, :3]) == 0:
        raise SceneError(f"{owner}: {cause} is singular; it must be invertible, and no radius 0")
    return matrix


def moved(matrix: Matrix, by: NDArray[np.float64]) -> Matrix:
    """Put a translation behind a transform."""
    result: Matrix = matrix.copy()
    result[:3, 3] += by
    return result
