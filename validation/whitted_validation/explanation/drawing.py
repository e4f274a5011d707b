"""The scene from above and from the side, with the rays of one pixel: inline SVG, coloured by `page.STYLE`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.seen import LightSeen, RaySeen
from whitted_reference import scene
from whitted_validation.explanation.labels import Labels
from whitted_validation.explanation.outlines import Outline, outlines
from whitted_validation.printable import named

Array = NDArray[np.float64]

WIDTH = 380.0
LOWEST, HIGHEST = 170.0, 340.0
MARGIN = 34.0
FAR = 30.0
"""What is farther off than so many sizes of what the rays touch is shown at the border, in its direction."""
OUTSIDE = 1e5
"""Nothing is drawn farther off than this, in units of the drawing."""
COARSE = 0.3
"""Outlines are drawn to this, in units of the drawing, which are about a pixel."""
NORMAL = 24.0
"""Length of a normal."""
MOST_HITS = 4
"""Of a long chain of mirrors only so many hits get a name and their ways to the lights."""


def drawing(description: scene.Scene, sensor: int, samples: Sequence[Sequence[RaySeen]]) -> str:
    """Draw plan and elevation; up is the world's axis next to the camera's up."""
    camera = description.sensors[sensor]
    up = _nearest_axis(np.array(camera.to_world.column(1), float))
    ahead = np.array(camera.to_world.column(2), float)
    ahead = _unit(ahead - (ahead @ up) * up)
    right = np.cross(ahead, up)
    views = (("from above", np.stack([right, ahead])), ("from the side", np.stack([ahead, up])))
    figures = [
        f"<figure>{_View(description, samples, axes).svg(name)}<figcaption>{name}</figcaption></figure>"
        for name, axes in views
    ]
    return f'<div class="sight">{"".join(figures)}</div>'


def _nearest_axis(v: Array) -> Array:
    axis = np.zeros(3)
    i = int(np.abs(v).argmax())
    axis[i] = math.copysign(1.0, v[i])
    return axis


def _unit(v: Array) -> Array:
    return np.asarray(v / (np.linalg.norm(v) or 1.0))


class _View:
    """One projection, scaled so that everything that the rays touch is in it."""

    def __init__(self, description: scene.Scene, samples: Sequence[Sequence[RaySeen]], axes: Array) -> None:
        self._axes = axes
        self._samples = samples
        self._lights = {light.id: light for light in description.lights}
        rays = [ray for sample in samples for ray in sample]
        self._touched = {ray.shape for ray in rays if ray.shape is not None}
        self._blockers = {light.blocked_by for ray in rays for light in ray.lights if light.blocked_by is not None}
        # What the rays have to do with is drawn last, on top.
        self._outlines = sorted(
            outlines(description.shapes, axes), key=lambda o: o.id in self._touched | self._blockers
        )
        self._frame(rays)

    def svg(self, name: str) -> str:
        labels = Labels(WIDTH, self._height)
        lines: list[str] = []
        marks: list[str] = []
        for number, sample in enumerate(self._samples):
            for ray in sample:
                lines += self._ray(ray, labels, marks, first=number == 0)
        if self._samples and self._samples[0]:
            self._eye(self._samples[0][0], labels, marks)
        body = "".join([*map(self._shape, self._outlines), *lines, *marks, labels.placed()])
        return (
            f'<svg viewBox="0 0 {WIDTH:.0f} {self._height:.0f}" role="img" '
            f'aria-label="the scene {name}, with the rays of this pixel">{body}</svg>'
        )

    # ------------------------------------------------------------------------------------------ the frame
    def _frame(self, rays: Sequence[RaySeen]) -> None:
        hits = [self._flat(ray.p) for ray in rays if ray.shape is not None]
        core = np.array(hits or [self._flat(rays[0].o)])
        drawn = [np.concatenate(o.rings) for o in self._outlines if o.id in self._touched | self._blockers]
        if not hits:
            drawn = [np.concatenate(o.rings) for o in self._outlines] or [core + 1.0, core - 1.0]
        reach = max((ray.t for ray in rays if ray.shape is not None), default=math.inf)
        small = [ring for ring in drawn if _extent(ring) <= 2 * reach]
        core = np.concatenate([core, *small])
        # On a floor without end it is the ray itself that gives the scale.
        size = _extent(core) if small else max(_extent(core), reach)
        size = max(size, 1e-6 * float(np.abs(core).max()), 1e-30)
        near = [self._flat(rays[0].o)]
        near += [self._flat(light.position) for light in self._lights.values() if hasattr(light, "position")]
        middle = (core.min(axis=0) + core.max(axis=0)) / 2
        core = np.concatenate([core, *[p[None] for p in near if math.dist(p, middle) <= FAR * size]])
        low, high = core.min(axis=0), core.max(axis=0)
        across, down = np.maximum(high - low, 0.02 * size)
        room = WIDTH - 2 * MARGIN
        self._height = min(max(room * down / across, LOWEST - 2 * MARGIN), HIGHEST - 2 * MARGIN) + 2 * MARGIN
        self._scale = min(room / across, (self._height - 2 * MARGIN) / down)
        self._middle = (low + high) / 2

    def _flat(self, p: Sequence[float] | Array) -> Array:
        return np.asarray(self._axes @ np.array(p, float))

    def _at(self, flat: Array) -> Array:
        """Turn coordinates of the view, (2,) or (n, 2), into those of the page."""
        away = (flat - self._middle) * self._scale
        far = np.abs(away).max(axis=-1, keepdims=True)
        away = away * (OUTSIDE / np.maximum(far, OUTSIDE))  # in the same direction, but not beyond all digits
        return np.asarray(away * (1.0, -1.0) + (WIDTH / 2, self._height / 2))

    # ------------------------------------------------------------------------------------------- the parts
    def _shape(self, outline: Outline) -> str:
        rings = [self._at(ring) for ring in outline.rings if len(ring)]
        every = np.concatenate(rings)
        low, high = every.min(axis=0), every.max(axis=0)
        if (high < 0).any() or low[0] > WIDTH or low[1] > self._height:
            return ""
        kind = "touched" if outline.id in self._touched else "blocker" if outline.id in self._blockers else "shape"
        if (high - low).max() < 2.0:
            return f'<circle class="{kind}" cx="{low[0]:.1f}" cy="{low[1]:.1f}" r="1"/>'
        path = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in _thinned(ring)) + "Z" for ring in rings)
        return f'<path class="{kind}" d="{path}"/>'

    def _ray(self, ray: RaySeen, labels: Labels, marks: list[str], first: bool) -> list[str]:
        start = self._at(self._flat(ray.o))
        missed = ray.shape is None
        end = start + self._direction(ray.d) * 1e4 if missed else self._at(self._flat(ray.p))
        parts = [self._arrow(start, end, "ray" if ray.k < MOST_HITS else "ray later", open_end=missed)]
        labels.keep_clear_of(start, self._last_inside(start, end, 0.0))
        if ray.shape is None:
            return parts
        marks.append(f'<circle class="hit" cx="{end[0]:.1f}" cy="{end[1]:.1f}" r="3"/>')
        labels.keep_clear(end, 4.0)
        if ray.k >= MOST_HITS:
            return parts
        parts.append(self._arrow(end, end + self._direction(ray.n) * NORMAL, "normal"))
        if first:
            labels.put(f"p{ray.k} {_short(ray.shape)}", end, "label")
        for light in ray.lights:
            if light.n_l > 0 and light.n_g_l > 0 and any(light.irradiance):
                parts.append(self._to_light(end, ray, light, labels, marks))
        return parts

    def _to_light(self, start: Array, ray: RaySeen, light: LightSeen, labels: Labels, marks: list[str]) -> str:
        kind = "lit" if light.visible else "blocked"
        if light.distance < math.inf:
            end = self._at(self._flat(np.array(ray.p) + light.distance * np.array(light.l)))
        else:
            end = start + self._direction(light.l) * 1e4
        sun = self._last_inside(start, end, 16.0)
        mark = f'<g class="sun {kind}">{_sun(sun)}</g>'
        if mark not in marks:
            marks.append(mark)
            labels.keep_clear(sun, 9.0)
        labels.put(_short(light.id), sun, "label light" if light.visible else "label quiet")
        labels.keep_clear_of(start, sun)
        return f'<line class="shadow {kind}" {_ends(start, sun)}/>'

    def _eye(self, ray: RaySeen, labels: Labels, marks: list[str]) -> None:
        target = self._at(self._flat(ray.p)) if ray.p else self._at(self._flat(ray.o)) + self._direction(ray.d)
        eye = self._last_inside(target, self._at(self._flat(ray.o)), 12.0)
        marks.append(f'<circle class="eye" cx="{eye[0]:.1f}" cy="{eye[1]:.1f}" r="4"/>')
        labels.keep_clear(eye, 5.0)
        labels.put("eye", eye, "label")

    def _direction(self, d: Sequence[float]) -> Array:
        return np.asarray(self._flat(d) * (1.0, -1.0))

    def _last_inside(self, start: Array, end: Array, border: float) -> Array:
        """Go from start towards end as far as the page reaches, less a border."""
        s = 1.0
        for i, size in enumerate((WIDTH, self._height)):
            step = end[i] - start[i]
            limit = (size - border if step > 0 else border) - start[i]
            if step and limit / step < s:
                s = max(limit / step, 0.0)
        return np.asarray(start + s * (end - start))

    def _arrow(self, start: Array, end: Array, kind: str, open_end: bool = False) -> str:
        start, tip = self._last_inside(end, start, 0.0) if not open_end else start, self._last_inside(start, end, 6.0)
        along = tip - start
        length = float(np.linalg.norm(along))
        if length < 2.0:
            return ""
        along = along / length
        aside = np.array([-along[1], along[0]])
        size = 6.0 if kind == "ray" else 4.0
        stop = tip if open_end or kind == "normal" else tip - 3.0 * along
        back = stop - size * along
        head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (stop, back + 0.45 * size * aside, back - 0.45 * size * aside))
        return f'<line class="{kind}" {_ends(start, back)}/><polygon class="{kind}" points="{head}"/>'


def _ends(a: Array, b: Array) -> str:
    return f'x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"'


def _sun(at: Array) -> str:
    beams = "".join(
        f"<line {_ends(at + 6 * w, at + 9 * w)}/>"
        for w in (np.array([math.cos(a), math.sin(a)]) for a in np.arange(8) * math.pi / 4)
    )
    return f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="4"/>{beams}'


def _thinned(ring: Array) -> Array:
    """Leave out points of a closed line that the chord of their neighbours passes closely."""
    kept, points = [0], np.concatenate([ring, ring[:1]])
    for i in range(2, len(points)):
        start, chord = points[kept[-1]], points[i] - points[kept[-1]]
        between = points[kept[-1] + 1 : i] - start
        length = float(np.linalg.norm(chord))
        off = np.abs(between @ np.array([-chord[1], chord[0]])) / length if length else np.linalg.norm(between, axis=1)
        if off.max() > COARSE:
            kept.append(i - 1)
    return ring[kept]


def _extent(points: Array) -> float:
    return float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))


def _short(name: str) -> str:
    text = named(name).strip("`")
    return text if len(text) <= 20 else f"{text[:18]}…"
