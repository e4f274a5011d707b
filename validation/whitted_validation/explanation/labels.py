"""Words beside points of a drawing."""

from __future__ import annotations

import html

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LETTER, LINE = 6.4, 14.0
"""Width and height of a letter, about, in the units of the drawing."""

STEP = 6.0
"""Lines are kept clear of at points so far apart."""


class Labels:
    """Puts words where they cover each other, and what is to be seen, as little as possible."""

    def __init__(self, width: float, height: float) -> None:
        self._width, self._height = width, height
        self._taken: list[tuple[float, float, float, float]] = []
        self._waiting: list[tuple[str, Array, str]] = []

    def keep_clear(self, at: Array, radius: float) -> None:
        """Leave the square about a point free, if possible."""
        self._taken.append((at[0] - radius, at[1] - radius, at[0] + radius, at[1] + radius))

    def keep_clear_of(self, start: Array, end: Array) -> None:
        """Leave a line free, if possible."""
        count = int(np.linalg.norm(end - start) / STEP)
        for i in range(min(count, 200)):
            self.keep_clear(start + (end - start) * (i + 0.5) / count, 2.0)

    def put(self, text: str, at: Array, kind: str) -> None:
        """Put a text of that CSS class beside a point, when everything else is known."""
        if all((text, kind) != (known, other) or abs(at - place).max() > 1.0 for known, place, other in self._waiting):
            self._waiting.append((text, at, kind))

    def placed(self) -> str:
        """Return all texts as SVG."""
        return "".join(self._place(*label) for label in self._waiting)

    def _place(self, text: str, at: Array, kind: str) -> str:
        width = LETTER * len(text)
        corners = [
            (at[0] + {-1: -r - width, 0: -width / 2, 1: r}[side], at[1] + {-1: -r, 0: 4.0, 1: r + 8.0}[level])
            for r in (9.0, 16.0, 26.0, 40.0)
            for side in (1, -1, 0)
            for level in (0, -1, 1)
            if side or level
        ]
        inside = [
            (min(max(x, 2.0), self._width - width - 2.0), min(max(y, LINE), self._height - 4.0)) for x, y in corners
        ]
        x, y = min(inside, key=lambda corner: self._covered(corner[0], corner[1], width))
        self._taken.append((x, y - LINE + 3, x + width, y + 3))
        return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}">{html.escape(text)}</text>'

    def _covered(self, x: float, y: float, width: float) -> float:
        left, top, right, bottom = x, y - LINE + 3, x + width, y + 3
        return sum(
            max(0.0, min(right, r) - max(left, p)) * max(0.0, min(bottom, s) - max(top, q))
            for p, q, r, s in self._taken
        )
