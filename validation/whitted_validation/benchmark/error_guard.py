"""What it takes to look for things that no corner of a pixel meets: refinement with more such checks, and with none.

Where some of what there is to be reached excludes the rest, these two show it: none is the least that finding edges
takes, and misses what is small; many leave no pixel far off.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mitsuba_whitted  # noqa: F401  # isort: skip  # before Mitsuba

NO_CHECKS = "target error, no checks"

CHECKS = {NO_CHECKS: 0.0, "target error, 16 times the checks": 16.0}
"""Ways to refine, and so many times the checks that each pixel gets otherwise, up to the most for one pixel."""


@contextmanager
def checks_times(factor: float) -> Iterator[None]:
    """Let refinement take so many times the checks, but where something was found already."""
    from mitsuba_whitted import hidden  # its names need a variant

    before = {name: getattr(hidden, name) for name in ("NEAR", "ANYWHERE", "FAR")}
    for name, share in before.items():
        setattr(hidden, name, factor * share)
    try:
        yield
    finally:
        for name, share in before.items():
            setattr(hidden, name, share)
