"""What the kernel did for one pixel, step by step: the code that renders, heard while it works on a single lane."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted import film, precise
from mitsuba_whitted.plan import Plan
from mitsuba_whitted.ray import Found, Ray
from mitsuba_whitted.seen import LightSeen, Numbers, PixelSeen, RaySeen, SampleSeen
from mitsuba_whitted.stage import Stage
from mitsuba_whitted.trace import trace


def explain(stage: Stage, plan: Plan, camera: Callable[[Any, Any], Ray], x: int, y: int, n: int = 1) -> PixelSeen:
    """Trace the n x n samples of pixel (x, y) of the crop window, and keep every value on the way.

    Loops run in Python, so that their values can be read; the arithmetic is that of the picture, bit for bit.
    """
    samples = [_sample(stage, plan, camera(*film.sub_pixel(x, y, part, n))) for part in range(n * n)]
    colours = np.array([sample.colour for sample in samples], np.float32).T
    planes = mi.Float(colours.ravel()) if dr.is_jit_v(mi.Float) else colours
    return PixelSeen(samples, _numbers(film.means(planes, n)))


def _sample(stage: Stage, plan: Plan, ray: Ray) -> SampleSeen:
    heard: list[tuple[str, dict[str, Any]]] = []

    def note(what: str, **values: Any) -> None:
        # Colours are added to later, in place.
        kept = {name: mi.Spectrum(x) if isinstance(x, mi.Spectrum) else x for name, x in values.items()}
        heard.append((what, kept))

    with dr.suspend_grad(), _read_as_it_runs():  # type: ignore[no-untyped-call]
        traced = trace(stage, plan, ray, mi.Bool(True), note)
        names = [name for lights in stage.lights for name in lights.ids]
        dr.eval(traced, [values for _, values in heard])
        return SampleSeen(_Reader(stage, names).read(heard), _numbers(traced.colour))


@contextmanager
def _read_as_it_runs() -> Iterator[None]:
    """Let loops and branches run in Python, instead of being recorded."""
    loops, branches = dr.JitFlag.SymbolicLoops, dr.JitFlag.SymbolicConditionals
    with dr.scoped_set_flag(loops, False), dr.scoped_set_flag(branches, False):
        yield


class _Reader:
    """Turns what was heard into records."""

    def __init__(self, stage: Stage, light_names: list[str]) -> None:
        self._stage = stage
        self._light_names = light_names
        self._rays: list[RaySeen] = []
        self._shadow_ray: Any = None

    def read(self, heard: list[tuple[str, dict[str, Any]]]) -> list[RaySeen]:
        readers: dict[str, Callable[..., None]] = {
            "ray": self._ray,
            "emitted": self._emitted,
            "surface": self._surface,
            "ambient": self._ambient,
            "coefficients": self._coefficients,
            "shadow ray": self._shadow,
            "light": self._light,
            "sum": self._sum,
            "mirror": self._mirror,
        }
        for what, values in heard:
            readers[what](**values)
        return self._rays

    def _ray(self, k: Any, o: Any, d: Any, throughput: Any) -> None:
        self._rays.append(RaySeen(int(_number(k)), self._place(o), _numbers(d), _numbers(throughput)))
        self._o, self._d = o, d

    def _emitted(self, colour: Any) -> None:
        self._rays[-1].emitted = _numbers(colour)

    def _surface(self, met: Found, found: Any, p: Any, n: Any, n_g: Any, facing: Any, lit: Any) -> None:
        ray = self._rays[-1]
        if _number(found):
            ray.shape = self._name(met)
            ray.t = _number(dr.dot(p - self._o, self._d))
            ray.p, ray.n, ray.n_g = self._place(p), _numbers(n), _numbers(n_g)
            ray.facing, ray.lit = bool(_number(facing)), bool(_number(lit))
        self._n, self._n_g = n, n_g

    def _ambient(self, colour: Any) -> None:
        self._rays[-1].ambient = _numbers(colour)

    def _coefficients(self, k_d: Any, k_s: Any, exponent: Any) -> None:
        ray = self._rays[-1]
        ray.k_d, ray.k_s, ray.exponent = _numbers(k_d), _numbers(k_s), _number(exponent)
        self._k_d, self._k_s, self._exponent = k_d, k_s, exponent

    def _shadow(self, ray: Any) -> None:
        self._shadow_ray = ray

    def _light(self, light: Any, facing: Any, visible: Any, colour: Any) -> None:
        ray = self._rays[-1]
        if not ray.facing:
            return
        blocked = bool(_number(facing)) and not _number(visible)
        n_l, h = dr.dot(self._n, light.l), dr.normalize(light.l - mi.Vector3f(self._d))
        highlight = precise.specular_power(self._n, h, self._exponent)
        ray.lights.append(
            LightSeen(
                id=self._light_names[len(ray.lights)],
                l=_numbers(light.l),
                distance=_number(light.distance),
                irradiance=_numbers(light.colour),
                h=_numbers(h),
                n_l=_number(n_l),
                n_g_l=_number(dr.dot(self._n_g, light.l)),
                n_h=_number(dr.dot(self._n, h)),
                above=bool(_number(facing)),
                visible=bool(_number(visible)),
                blocked_by=self._name(self._stage.surfaces.first_hit(self._shadow_ray, mi.Bool(True)))
                if blocked
                else None,
                diffuse=_numbers(self._k_d * n_l * light.colour),
                specular=_numbers(self._k_s * highlight * light.colour),
                colour=_numbers(colour),
            )
        )

    def _sum(self, colour: Any) -> None:
        self._rays[-1].colour = _numbers(colour)

    def _mirror(self, k_m: Any, r: Any, goes_on: Any) -> None:
        ray = self._rays[-1]
        ray.k_m, ray.r, ray.goes_on = _numbers(k_m), _numbers(r), bool(_number(goes_on))

    def _place(self, p: Any) -> Numbers:
        """Coordinates in the world of a point that is relative to the scene's middle."""
        return tuple(np.array(p, float).ravel() + self._stage.surfaces.centre)

    def _name(self, met: Found) -> str | None:
        """Name the shape that was met, as the reference does."""
        if not _number(met.valid):
            return None
        return self._stage.name_of(int(_number(met.shape)), int(_number(met.instance)))


def _numbers(value: Any) -> Numbers:
    return tuple(float(x) for x in np.array(value).ravel())


def _number(value: Any) -> float:
    return _numbers(value)[0]
