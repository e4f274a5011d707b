"""What the kernel did for one pixel, step by step: the code that renders, heard while it works on a single lane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted import film, precise
from mitsuba_whitted.camera import Rays
from mitsuba_whitted.plan import Plan
from mitsuba_whitted.seen import LightSeen, Numbers, PixelSeen, RaySeen, SampleSeen
from mitsuba_whitted.stage import Stage
from mitsuba_whitted.trace import trace


def explain(stage: Stage, plan: Plan, camera: Callable[[Any, Any], Rays], x: int, y: int, n: int = 1) -> PixelSeen:
    """Trace the n x n samples of pixel (x, y) of the crop window, and keep every value on the way.

    Loops run in Python, so that their values can be read; the arithmetic is that of the picture, bit for bit.
    """
    samples = [_sample(stage, plan, camera(*film.sub_pixel(x, y, part, n))) for part in range(n * n)]
    colours = np.array([sample.colour for sample in samples], np.float32).T
    planes = mi.Float(colours.ravel()) if dr.is_jit_v(mi.Float) else colours
    return PixelSeen(samples, _numbers(film.means(planes, n)))


def _sample(stage: Stage, plan: Plan, rays: Rays) -> SampleSeen:
    heard: list[tuple[str, dict[str, Any]]] = []

    def note(what: str, **values: Any) -> None:
        heard.append((what, values))

    with dr.suspend_grad(), dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, False):  # type: ignore[no-untyped-call]
        traced = trace(stage, plan, rays, mi.Bool(True), note)
        names = [name for lights in stage.lights for name in lights.ids]
        dr.eval(traced, [values for _, values in heard])
        return SampleSeen(_Reader(stage, names).read(heard), _numbers(traced.colour))


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
        self._rays.append(RaySeen(int(_number(k)), _numbers(o), _numbers(d), _numbers(throughput)))
        self._o, self._d = o, d

    def _surface(self, pi: Any, found: Any, p: Any, n: Any, n_g: Any, in_front: Any, behind: Any, emitted: Any) -> None:
        ray = self._rays[-1]
        ray.emitted = _numbers(emitted)
        if _number(found):
            ray.shape = self._name(pi)
            ray.t = _number(dr.dot(p - self._o, self._d))
            ray.p, ray.n, ray.n_g = _numbers(p), _numbers(n), _numbers(n_g)
            ray.facing = bool(_number(in_front | behind))
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
        n_l, h = dr.dot(self._n, light.l), dr.normalize(light.l - self._d)
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

    def _sum(self, colour: Any, lit: Any = False) -> None:
        self._rays[-1].colour, self._rays[-1].lit = _numbers(colour), bool(_number(lit))

    def _mirror(self, k_m: Any, r: Any, goes_on: Any) -> None:
        ray = self._rays[-1]
        ray.k_m, ray.r, ray.goes_on = _numbers(k_m), _numbers(r), bool(_number(goes_on))

    def _name(self, pi: Any) -> str | None:
        """Name the shape that Embree's answer stands for, as the reference does."""
        if not _number(pi.is_valid()):
            return None
        met = self._stage.surfaces.accel.met(pi, mi.Bool(True))
        return self._stage.name_of(int(_number(met.shape)), int(_number(met.instance)))


def _numbers(value: Any) -> Numbers:
    return tuple(float(x) for x in np.array(value).ravel())


def _number(value: Any) -> float:
    return _numbers(value)[0]
