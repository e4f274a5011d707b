"""The tracer checks itself: one pixel in floats, in forty digits and in intervals.

Intervals decide first, without a look at any colour: a pixel is *certain* if every yes/no decision on
its way is decided and the colour is enclosed within `TARGET`. The float colour and the forty-digit
colour of a certain pixel both lie in that enclosure, so they agree to `TARGET`. A pixel that is not
certain is flagged, with the reason.
"""

from __future__ import annotations

from dataclasses import dataclass

from whitted_reference.arithmetic import DECIMAL, FLOAT, INTERVAL
from whitted_reference.intervals import Undecided
from whitted_reference.scene import Scene
from whitted_reference.trace import Tracer
from whitted_reference.vectors import Colour

TARGET = 1e-12  # relative to a colour of 1, or to the colour itself if that is greater


@dataclass(frozen=True)
class Certificate:
    """What is known of one pixel.

    Attributes
    ----------
    colour : in floats
    apart : largest difference to forty digits, relative to max(1, colour)
    width : largest width of the enclosure, on the same scale; None if undecided
    flag : why the pixel is not certain, or None
    """

    colour: Colour
    apart: float
    width: float | None
    flag: str | None


class Prover:
    """One scene in three arithmetics."""

    def __init__(self, scene: Scene, sensor: int = 0) -> None:
        self._plain = Tracer(scene, FLOAT, sensor)
        self._long = Tracer(scene, DECIMAL, sensor)
        self._enclosing = Tracer(scene, INTERVAL, sensor)

    def pixel(self, x: int, y: int, grid: int = 1) -> Certificate:
        """Certify one pixel, or flag it."""
        colour = self._plain.pixel(x, y, grid)
        ties, self._plain.ties = self._plain.ties, []
        scale = [max(1.0, abs(c)) for c in colour]
        exact = self._long.pixel(x, y, grid)
        apart = max(abs(float(b - DECIMAL.of(a))) / s for a, b, s in zip(colour, exact, scale, strict=True))
        if ties:
            return Certificate(colour, apart, None, "tie of " + " and ".join(ties[0]))
        try:
            enclosure = self._enclosing.pixel(x, y, grid)
        except Undecided as reason:
            return Certificate(colour, apart, None, f"undecided: {reason}")
        width = max(c.width / s for c, s in zip(enclosure, scale, strict=True))
        flag = None if width <= TARGET else f"ill-conditioned: enclosed to {width:.1e} only"
        return Certificate(colour, apart, width, flag)
