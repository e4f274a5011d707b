"""Lines and bars as inline SVG, drawn with the page's own colours."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from whitted_validation.report.sections import short

WIDTH, HEIGHT = 640, 340
LEFT, RIGHT, TOP, BOTTOM = 76, 16, 20, 52
MOST_TICKS = 9
COLOURS = 6  # classes series-0 ... of page.css; more series than that repeat them with other dashes


@dataclass(frozen=True)
class _Axis:
    """One axis: values, linear or logarithmic, onto pixels."""

    low: float
    high: float
    start: float
    end: float
    log: bool

    def __call__(self, x: float) -> float:
        low, high, at = (math.log10(v) for v in (self.low, self.high, x)) if self.log else (self.low, self.high, x)
        return self.start + (self.end - self.start) * (at - low) / (high - low)

    def ticks(self) -> list[float]:
        """Return powers of ten, or round steps."""
        if self.log:
            first, last = math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9)
            return [10.0**k for k in range(first, last + 1, max(1, math.ceil((last - first) / MOST_TICKS)))]
        step = 10 ** math.floor(math.log10((self.high - self.low) / 4))
        step *= next(m for m in (1, 2, 5, 10) if (self.high - self.low) / (m * step) <= MOST_TICKS - 3)
        return [k * step for k in range(math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9) + 1)]


def _axis(values: Iterable[float], start: float, end: float, log: bool, from_zero: bool = False) -> _Axis:
    shown = [v for v in values if _can_show(v, log)]
    low, high = min(shown, default=1.0), max(shown, default=1.0)
    if log:  # whole decades
        low, high = 10.0 ** math.floor(math.log10(low)), 10.0 ** math.ceil(math.log10(high))
        return _Axis(low, high if high > low else 10 * low, start, end, True)
    low = min(low, 0.0) if from_zero else low
    return _Axis(low, high if high > low else low + (abs(low) or 1.0), start, end, False)


def _can_show(x: float, log: bool) -> bool:
    return math.isfinite(x) and (x > 0 or not log)


@dataclass(frozen=True)
class Chart:
    """Lines through points.

    Attributes
    ----------
    series : name of each line to its points (x, y); what an axis cannot show (NaN, infinities, and zero or less
        on a logarithmic one) is left out and counted below the chart
    log_x, log_y : logarithmic axes
    """

    title: str
    x_label: str
    y_label: str
    series: Mapping[str, Sequence[tuple[float, float]]]
    log_x: bool = True
    log_y: bool = True

    def html(self) -> str:
        """Return a figure."""
        points = [point for line in self.series.values() for point in line]
        x = _axis((p[0] for p in points), LEFT, WIDTH - RIGHT, self.log_x)
        y = _axis((p[1] for p in points), HEIGHT - BOTTOM, TOP, self.log_y)
        drawn, left_out = [], 0
        for index, line in enumerate(self.series.values()):
            kept = sorted(p for p in line if _can_show(p[0], self.log_x) and _can_show(p[1], self.log_y))
            left_out += len(line) - len(kept)
            places = [f"{x(a):.1f},{y(b):.1f}" for a, b in kept]
            dash = f' stroke-dasharray="{4 * (index // COLOURS)} 3"' if index >= COLOURS else ""
            drawn.append(
                f'<g class="series-{index % COLOURS}"><polyline points="{" ".join(places)}"{dash}/>'
                + "".join(
                    f'<circle cx="{place.split(",")[0]}" cy="{place.split(",")[1]}" r="3"><title>{short(a)}, {short(b)}'
                    "</title></circle>"
                    for place, (a, b) in zip(places, kept, strict=True)
                )
                + "</g>"
            )
        note = f" ({left_out} points cannot be shown on these axes)" if left_out else ""
        return _figure(
            self.title + note, _frame(x, y, self.x_label, self.y_label, x.ticks()) + "".join(drawn), self.series
        )


@dataclass(frozen=True)
class Bars:
    """Stacked bars; counts by default, from zero.

    Attributes
    ----------
    labels : below the bars
    series : name of each layer, from the bottom, to one number a bar
    """

    title: str
    x_label: str
    y_label: str
    labels: Sequence[str]
    series: Mapping[str, Sequence[float]]

    def html(self) -> str:
        """Return a figure."""
        totals = [sum(values) for values in zip(*self.series.values(), strict=True)]
        y = _axis(totals, HEIGHT - BOTTOM, TOP, False, from_zero=True)
        pitch = (WIDTH - LEFT - RIGHT) / max(1, len(self.labels))
        base = [0.0] * len(self.labels)
        drawn = []
        for index, (name, values) in enumerate(self.series.items()):
            rectangles = []
            for place, value in enumerate(values):
                top = y(base[place] + value)
                rectangles.append(
                    f'<rect x="{LEFT + pitch * (place + 0.1):.1f}" y="{top:.1f}" width="{0.8 * pitch:.1f}" '
                    f'height="{y(base[place]) - top:.1f}"><title>{html.escape(self.labels[place])}, '
                    f"{html.escape(name)}: {short(value)}</title></rect>"
                )
                base[place] += value
            drawn.append(f'<g class="series-{index % COLOURS}">{"".join(rectangles)}</g>')
        sums = "".join(
            f'<text x="{LEFT + pitch * (place + 0.5):.1f}" y="{y(total) - 5:.1f}" text-anchor="middle">'
            f"{short(total)}</text>"
            for place, total in enumerate(totals)
            if total
        )
        every = math.ceil(len(self.labels) / MOST_TICKS)
        labels = "".join(
            f'<text x="{LEFT + pitch * (place + 0.5):.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">'
            f"{html.escape(label)}</text>"
            for place, label in enumerate(self.labels)
            if place % every == 0
        )
        return _figure(
            self.title, _frame(None, y, self.x_label, self.y_label, ()) + "".join(drawn) + sums + labels, self.series
        )


def _frame(x: _Axis | None, y: _Axis, x_label: str, y_label: str, x_ticks: Sequence[float]) -> str:
    """Draw axes, grid and labels."""
    parts = []
    for tick in y.ticks():
        at = f"{y(tick):.1f}"
        parts.append(
            f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at}" y2="{at}"/>'
            f'<text x="{LEFT - 8}" y="{at}" dy=".32em" text-anchor="end">{_tick(tick, y.log)}</text>'
        )
    for tick in x_ticks:
        assert x is not None
        at = f"{x(tick):.1f}"
        parts.append(
            f'<line class="grid" x1="{at}" x2="{at}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>'
            f'<text x="{at}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{_tick(tick, x.log)}</text>'
        )
    middle = (TOP + HEIGHT - BOTTOM) / 2
    return (
        "".join(parts) + f'<text class="label" x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 10}" text-anchor="middle">'
        f"{html.escape(x_label)}</text>"
        f'<text class="label" transform="translate(14 {middle}) rotate(-90)" text-anchor="middle">'
        f"{html.escape(y_label)}</text>"
    )


def _tick(x: float, log: bool) -> str:
    if not log:
        return f"{x:,.6g}"
    power = round(math.log10(x))
    return f"{x:g}" if -2 <= power <= 3 else f'10<tspan class="power" dy="-.5em">{power}</tspan>'


def _figure(title: str, inner: str, series: Mapping[str, object]) -> str:
    keys = "".join(
        f'<li class="series-{index % COLOURS}">{html.escape(name)}</li>' for index, name in enumerate(series)
    )
    legend = f'<ul class="legend">{keys}</ul>' if len(series) > 1 else ""
    return (
        f'<figure class="chart"><figcaption>{html.escape(title)}</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{html.escape(title)}">{inner}</svg>'
        f"{legend}</figure>"
    )
