"""The tracer checks itself: one pixel in floats, in forty digits and in intervals.

Intervals decide first, without a look at any colour: a pixel is *certain* if every yes/no decision on
its way is decided and the colour is enclosed within `TARGET`. The float colour and the forty-digit
colour of a certain pixel both lie in that enclosure, so they agree to `TARGET`. A pixel that is not
certain is flagged, with the reason.

Who only wants the colour asks `settle`: intervals, and forty digits where they leave anything open.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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


@dataclass(frozen=True)
class Settled:
    """A colour from more than doubles.

    Attributes
    ----------
    colour : the nearest floats
    off : how far the exact colour may be from it, a channel
    means : name of the arithmetic that settled it
    """

    colour: Colour
    off: Colour
    means: str


class Prover:
    """One scene in three arithmetics, each prepared when it is first asked."""

    def __init__(self, scene: Scene, sensor: int = 0) -> None:
        self._scene = scene
        self._sensor = sensor

    @cached_property
    def _plain(self) -> Tracer:
        return Tracer(self._scene, FLOAT, self._sensor)

    @cached_property
    def _long(self) -> Tracer:
        return Tracer(self._scene, DECIMAL, self._sensor)

    @cached_property
    def _enclosing(self) -> Tracer:
        return Tracer(self._scene, INTERVAL, self._sensor)

    def settle(self, x: int, y: int, grid: int = 1, enough: float = TARGET) -> Settled:
        """Return the colour of one pixel by the first arithmetic that settles it.

        Intervals enclose it. Where they leave a decision open, or the colour by more than `enough`, forty digits
        carry the path on: no enclosure, but 24 digits more than doubles, far beyond what a mirror chain of a few
        dozen bounces can lose.
        """
        try:
            low_high = self._enclosing.pixel(x, y, grid)
            red, green, blue = (INTERVAL.approximate(c) for c in low_high)
            off = (low_high[0].width, low_high[1].width, low_high[2].width)
            if all(w <= enough * max(1.0, abs(c)) for w, c in zip(off, (red, green, blue), strict=True)):
                return Settled((red, green, blue), off, INTERVAL.name)
        except Undecided:
            pass
        red, green, blue = (float(c) for c in self._long.pixel(x, y, grid))
        half_ulp = 2.0**-53  # of the conversion to floats
        return Settled((red, green, blue), (half_ulp * red, half_ulp * green, half_ulp * blue), DECIMAL.name)

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
