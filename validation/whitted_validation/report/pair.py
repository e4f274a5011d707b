"""Two pictures and their error as plain pictures, for a notebook."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from whitted_validation.report.sections import Picture
from whitted_validation.report.viewer import worst_of_blocks

MOST_PIXELS = 1 << 18  # 512 x 512, beyond which a notebook grows heavy: of each block the worst pixel is shown


def pair(a: NDArray[np.floating], b: NDArray[np.floating], names: tuple[str, str]) -> str:
    """Return A, B and |A - B| as HTML.

    Parameters
    ----------
    a, b : (height, width, 3), linear radiance
    names : what A and B are
    """
    height, width, _ = a.shape
    step = math.ceil(math.sqrt(height * width / MOST_PIXELS))
    rows, columns = worst_of_blocks(a, b, step)
    a, b = a[rows, columns].astype(np.float64), b[rows, columns].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        error = np.abs(a - b).max(axis=2)
        level = np.clip(1.0 + np.log10(np.where(np.isfinite(error), error, np.inf)) / 8.0, 0.0, 1.0)
    grey = np.repeat((255.0 * level + 0.5).astype(np.uint8)[:, :, None], 3, axis=2)
    part = f", the worst pixel of each {step} x {step}" if step > 1 else ""
    shown = (
        Picture(a, f"A: {names[0]}{part}"),
        Picture(b, f"B: {names[1]}{part}"),
        Picture(grey, f"|A - B|, logarithmic: black 1e-8, white 1{part}"),
    )
    return "".join(picture.html() for picture in shown)
