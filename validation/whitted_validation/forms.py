"""Linear forms in error symbols, each symbol between -1 and 1 (first-order affine arithmetic: Comba and Stolfi 1993).

A number is a row of coefficients, a vector three such rows: arrays (symbols,) and (3, symbols).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def radius(form: Matrix) -> Any:
    """Return the largest value of a linear form: a number, or one a component."""
    return np.abs(form).sum(axis=-1)


def length(form: Matrix) -> float:
    """Bound the length of a vector of three forms."""
    return float(np.linalg.norm(radius(form)))
