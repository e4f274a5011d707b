"""What it takes to look for things that no corner of a pixel meets: refinement with other numbers of such checks.

With none, what is left is what finding edges takes; with many, fewer pixels are far off.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any
from unittest import mock

NO_CHECKS = "target error, no checks"

CHECKS = {NO_CHECKS: 0.0, "target error, 16 times the checks": 16.0}
"""Ways to refine, and the factor of their checks."""


def checks_times(factor: float) -> AbstractContextManager[Any]:
    """Let refinement take so many times the checks of each pixel, before it rounds them and up to its most for a pixel.

    Left as they are: those of one pixel in some of clutter, and the least next to where something was found.
    """
    from mitsuba_whitted import hidden  # its names need a variant

    shares = {name: factor * getattr(hidden, name) for name in ("NEAR", "ANYWHERE", "FAR")}
    patched: AbstractContextManager[Any] = mock.patch.multiple(hidden, **shares)
    return patched
