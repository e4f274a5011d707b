"""How nearly a ray's decisions fell otherwise: past which silhouette, how far from the edge of a shadow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.seen import LightSeen, RaySeen
from whitted_reference.margins import Place, passing
from whitted_reference.shapes import Primitive
from whitted_reference.textures import beyond_nearest_edge
from whitted_reference.trace import Tracer
from whitted_reference.vectors import dot
from whitted_validation.printable import named


@dataclass(frozen=True)
class Call:
    """A decision in words, and how close it was: in sizes of the scene, or as the sine of an angle."""

    words: str
    by: float


class Closeness:
    """Measures the decisions of rays in one scene."""

    def __init__(self, tracer: Tracer) -> None:
        self._primitives = tracer.primitives
        boxes = np.array([p.box for p in tracer.primitives], float).reshape(-1, 6)
        self._centres = (boxes[:, :3] + boxes[:, 3:]) / 2
        self._radii = np.linalg.norm(boxes[:, 3:] - boxes[:, :3], axis=1) / 2
        size = boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0) if len(boxes) else np.ones(3)
        self._size = float(np.linalg.norm(size)) or 1.0

    def of_hit(self, ray: RaySeen) -> Iterator[Call]:
        """Tell how nearly a ray would have met something else."""
        if ray.shape is not None:
            inside = self._inside(ray, ray.t, ray.t, ray.shape)
            if inside:
                words = f"{named(ray.shape)} is met {inside[0]:.3g} inside its {inside[1]}"
                yield Call(words, inside[0] / self._size)
            yield from self._texture(ray)
        passed = self._passed(ray, ray.t, ray.shape)
        if passed:
            yield Call(f"{named(passed[0])} is passed at a distance of {passed[1]:.3g}", passed[1] / self._size)
        if ray.shape is not None:
            n_v = -dot(_three(ray.n), _three(ray.d))
            side = "in front of" if n_v > 0 else "behind"
            yield Call(f"the eye is {_degrees(n_v)} {side} the plane of the surface (n.v = {n_v:.3g})", abs(n_v))

    def _texture(self, ray: RaySeen) -> Iterator[Call]:
        """Tell how far the next jump of colour is."""
        met = [p for p in self._near(ray, 0.0) if p.surface.id == ray.shape]
        meetings = [(abs(place.t - ray.t), p) for p in met for place in self._places(p, ray)]
        if not meetings:
            return
        primitive = min(meetings, key=lambda meeting: meeting[0])[1]
        e, d, p = _three(ray.o), _three(ray.d), _three(ray.p)
        in_front = dot(primitive.normals(e, d, ray.t, p)[0], d) < 0
        side = primitive.surface.front if in_front else primitive.surface.back
        if side is None or side.constant is not None:
            return
        edge = beyond_nearest_edge(side.textures, *primitive.uv(e, d, ray.t, p))
        if edge is not None:
            yield Call(f"the colour of {named(ray.shape)} jumps at {edge[0]:.3g} from here, in (u, v)", edge[0])

    def _places(self, primitive: Primitive, ray: RaySeen) -> Sequence[Place]:
        how = passing(primitive, _three(ray.o), _three(ray.d))
        return how.places if how is not None and how.distance >= 0 else ()

    def of_light(self, ray: RaySeen, light: LightSeen) -> Iterator[Call]:
        """Tell how nearly a light would have been seen, or not."""
        low = min(light.n_l, light.n_g_l)
        yield Call(f"{named(light.id)} is {_degrees(low)} {'above' if low > 0 else 'below'} the horizon", abs(low))
        if low <= 0:
            return
        beam = RaySeen(0, ray.p, light.l, ())
        if light.visible:
            passed = self._passed(beam, light.distance, ray.shape)
            if passed:
                yield Call(
                    f"the way to {named(light.id)} passes {named(passed[0])} at {passed[1]:.3g}",
                    passed[1] / self._size,
                )
        elif light.blocked_by is not None:
            inside = self._inside(beam, 0.0, light.distance, light.blocked_by)
            if inside:
                words = f"it lies {inside[0]:.3g} inside the shadow of {named(light.blocked_by)} from {named(light.id)}"
                yield Call(words, inside[0] / self._size)

    def _inside(self, ray: RaySeen, low: float, high: float, shape: str) -> tuple[float, str] | None:
        """How far inside its outline a shape is met between two distances, and what the outline is.

        Nothing is said of triangles: beyond their edges mostly lies the next one.
        """
        slack = 1e-9 * self._size
        best: tuple[float, str] | None = None
        for primitive in self._near(ray, 0.0):
            how = passing(primitive, _three(ray.o), _three(ray.d)) if primitive.surface.id == shape else None
            if how is None or "triangle" in how.kind:
                continue
            for place in how.places:
                if low - slack <= place.t <= high + slack and min(how.distance, place.distance) >= 0:
                    found = min((how.distance, how.kind), (place.distance, place.kind))
                    best = found if best is None else max(best, found)
        return best

    def _near(self, ray: RaySeen, within: float) -> list[Primitive]:
        """List the primitives whose bounding spheres the ray's line passes within a distance, the nearest first."""
        off = self._off(ray)
        return [self._primitives[i] for i in np.argsort(off, kind="stable") if off[i] <= within]

    def _passed(self, ray: RaySeen, end: float, but: str | None) -> tuple[str, float] | None:
        """Find what a ray passes most closely before its end, and how far off."""
        off = self._off(ray)
        best: tuple[str, float] | None = None
        for i in np.argsort(off, kind="stable"):
            if best is not None and off[i] >= best[1]:
                break
            primitive = self._primitives[i]
            if primitive.surface.id == but:
                continue
            near = passing(primitive, _three(ray.o), _three(ray.d))
            if near is None or near.distance >= 0 or not any(0 < place.t < end for place in near.places):
                continue
            if best is None or -near.distance < best[1]:
                best = primitive.surface.id, -near.distance
        return best

    def _off(self, ray: RaySeen) -> NDArray[np.float64]:
        """Bound from below how far the ray's line passes each primitive."""
        d = np.array(ray.d)
        to_centre = self._centres - np.array(ray.o)
        along = to_centre @ d
        aside: NDArray[np.float64] = np.linalg.norm(to_centre - along[:, None] * d, axis=1)
        off: NDArray[np.float64] = aside - self._radii
        return off


def _three(v: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = v
    return x, y, z


def _degrees(sine: float) -> str:
    return f"{abs(math.degrees(math.asin(min(1.0, max(-1.0, sine))))):.3g}°"
