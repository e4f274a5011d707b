"""Whitted's pipeline as one kernel: the textbook's ``raycolor``, its recursion turned into a loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted import precise
from mitsuba_whitted.camera import Rays
from mitsuba_whitted.lights import Sample
from mitsuba_whitted.materials import Coefficient
from mitsuba_whitted.plan import Plan
from mitsuba_whitted.stage import Stage
from mitsuba_whitted.surfaces import Hit


class Traced(NamedTuple):
    """What came back along a ray."""

    colour: Any
    """Spectrum, linear radiance."""
    hit: Any
    """Whether the camera ray met a surface."""
    shadow_rays: Any
    mirror_rays: Any
    path: Any
    """Number of the path: equal where the same objects were met and the same lights seen, bounce after bounce."""
    cut_rays: Any
    """Whether a mirror was not followed since it passes too little: see `Stage.least_throughput`."""


class _Ray(NamedTuple):
    """State of the loop: ray number k of a chain of mirrors, and what has been gathered so far."""

    k: Any
    o: Any
    d: Any
    shift: Any
    end: Any
    throughput: Any
    """Product of k_m over the mirrors before."""
    colour: Any
    hit: Any
    shadow_rays: Any
    mirror_rays: Any
    path: Any
    cut_rays: Any
    active: Any


Note = Callable[..., None]
"""Called with the name of what has happened to a ray, and the values of that: see `explain`."""


def _unheard(_what: str, **_values: Any) -> None:
    """Take no notes; Dr.Jit drops what nobody reads, so that the kernel stays as it is."""


def trace(stage: Stage, plan: Plan, rays: Rays, active: Any = True, note: Note = _unheard) -> Traced:
    """Follow camera rays and all that they cause (Shirley et al. 2009, section 4.8; Whitted 1980).

    Parameters
    ----------
    stage : Stage
        The scene as tables, and the integrator's parameters as numbers.
    plan : Plan
        What the kernel must hold; all else is left out of it.
    rays : Rays
        Camera rays, one a lane.
    active : Bool
        Lanes that count.
    note
        Told what happens in between. It may keep values only while loops are evaluated, not recorded.
    """
    rays = stage.surfaces.approached(rays) if plan.shapes else rays
    state = _Ray(
        k=mi.UInt32(0),
        o=rays.o,
        d=rays.d,
        shift=rays.shift,
        end=mi.Float(rays.end),
        throughput=mi.Spectrum(1),
        colour=mi.Spectrum(0),
        hit=mi.Bool(False),
        shadow_rays=mi.UInt32(0),
        mirror_rays=mi.UInt32(0),
        path=mi.UInt32(0),
        cut_rays=mi.UInt32(0),
        active=mi.Bool(active),
    )
    if plan.mirrors:
        final: tuple[Any, ...] = dr.while_loop(
            tuple(state),
            lambda *ray: ray[-1],
            lambda *ray: tuple(_bounce(stage, plan, _Ray(*ray), note)),
            label="mirror bounces",
        )
        state = _Ray(*final)
    else:
        state = _bounce(stage, plan, state, note)
    return Traced(state.colour, state.hit, state.shadow_rays, state.mirror_rays, state.path, state.cut_rays)


def _bounce(stage: Stage, plan: Plan, ray: _Ray, note: Note) -> _Ray:
    """Do what ``raycolor`` does for one ray, and return the mirrored ray in place of the recursive call."""
    note("ray", k=ray.k, o=ray.o, d=ray.d, throughput=ray.throughput)
    depth = ray.k + 1
    sees_lamps = ray.active & (depth <= stage.max_depth)
    colour = mi.Spectrum(0)
    if not plan.shapes:
        if plan.background:
            colour = dr.select(sees_lamps, stage.background(ray.d, sees_lamps), 0)
        note("sum", colour=colour)
        return ray._replace(colour=colour)

    traversal = mi.Ray3f(ray.o + ray.shift, ray.d, ray.end, 0, [])
    pi = stage.surfaces.first_hit(traversal, ray.active)
    found = ray.active & pi.is_valid()
    if plan.background:
        missed = sees_lamps & (found ^ True)
        colour = dr.select(missed, stage.background(ray.d, missed), colour)

    hit = stage.surfaces.hit(pi, traversal, ray.o, plan.textured)
    v = -ray.d
    in_front = found & (dr.dot(hit.n, v) > 0) & (dr.dot(hit.n_g, v) > 0)
    behind = mi.Bool(False)
    n, n_g = hit.n, hit.n_g
    if plan.two_sided:
        behind = found & (dr.dot(n, v) < 0) & (dr.dot(n_g, v) < 0)
        n, n_g = dr.select(behind, -n, n), dr.select(behind, -n_g, n_g)
    si = _surface_interaction(hit) if plan.textured else None
    if plan.emission:
        shines = sees_lamps & in_front
        colour = dr.select(shines, stage.emission.at(hit.shape, si, shines), colour)

    note("surface", pi=pi, found=found, p=hit.p, n=n, n_g=n_g, in_front=in_front, behind=behind, emitted=colour)

    lit = (in_front | behind) & (depth < stage.max_depth)
    material = stage.materials.row_of(hit.shape, behind, lit)

    def coefficient(k: Coefficient) -> Any:
        return k.at(material, si, lit)

    if plan.ambient:
        ambient = dr.select(lit, coefficient(stage.materials.k_a) * stage.ambient, 0)
        note("ambient", colour=ambient)
        colour += ambient

    path = _joined(ray.path, dr.select(found, 2 * hit.shape + dr.select(behind, mi.UInt32(2), mi.UInt32(1)), 0))
    shadow_rays, seen = mi.UInt32(0), mi.UInt32(0)
    if plan.lights:
        k_d = coefficient(stage.materials.k_d) if plan.diffuse else mi.Spectrum(0)
        k_s = coefficient(stage.materials.k_s) if plan.specular else mi.Spectrum(0)
        exponent = coefficient(stage.materials.exponent) if plan.specular else mi.Float(0)
        reflects = lit & dr.any((k_d + k_s) > 0)

        note("coefficients", k_d=k_d, k_s=k_s, exponent=exponent)

        def contribution(light: Sample) -> tuple[Any, Any, Any]:
            """k_d I (n.l) + k_s I (n.h)^p if the light is above the horizon and not in shadow; rays asked; its name."""
            n_l = dr.dot(n, light.l)
            facing = reflects & (n_l > 0) & (dr.dot(n_g, light.l) > 0)
            f = k_d * n_l
            if plan.specular:
                h = dr.normalize(v + light.l)
                f += k_s * precise.specular_power(n, h, exponent)
            visible = facing
            if plan.shadows:
                shadow_ray = _shadow_ray(stage, plan, hit, n_g, light)
                visible = facing & (stage.surfaces.blocked(shadow_ray, facing) ^ True)
                note("shadow ray", ray=shadow_ray)
            added = dr.select(visible, f * light.colour, 0)
            note("light", light=light, facing=facing, visible=visible, colour=added)
            asked = dr.select(facing, mi.UInt32(1), mi.UInt32(0)) if plan.shadows else mi.UInt32(0)
            return added, asked, dr.select(visible, light.name, 0)

        for lights in stage.lights:
            light_sum, asked, names = lights.sum(contribution, hit.p, plan.inverse_square)
            colour += light_sum
            shadow_rays += asked
            seen += names
    path = _joined(path, seen)
    note("sum", lit=lit, colour=colour)
    if not plan.mirrors:
        return ray._replace(colour=colour, hit=found, shadow_rays=shadow_rays, path=path)

    k_m = coefficient(stage.materials.k_m)
    throughput = ray.throughput * k_m
    r = mi.Vector3f(dr.normalize(dr.fma(-2 * dr.dot(ray.d, n), n, ray.d)))
    goes_on = lit & dr.any(k_m != 0) & (dr.dot(n_g, r) > 0)
    # Only with max_depth = -1 the two limits can end a chain: see Stage.
    passes = (depth <= stage.last_ray) & dr.any(throughput >= stage.least_throughput)
    cut = goes_on & (passes ^ True)
    goes_on &= passes
    if plan.epsilon:
        shift = stage.epsilon * r
    else:
        shift, _ = precise.ray_offset(n_g, r, hit.reach, stage.surfaces.least_reach)
    note("mirror", k_m=k_m, r=r, goes_on=goes_on)
    return _Ray(
        k=depth,
        o=hit.p,
        d=r,
        shift=mi.Vector3f(shift),
        end=mi.Float(dr.inf),
        throughput=throughput,
        colour=dr.select(ray.active, dr.fma(ray.throughput, colour, ray.colour), ray.colour),
        hit=ray.hit | (found & (ray.k == 0)),
        shadow_rays=ray.shadow_rays + shadow_rays,
        mirror_rays=ray.mirror_rays + dr.select(goes_on, mi.UInt32(1), mi.UInt32(0)),
        path=dr.select(ray.active, path, ray.path),
        cut_rays=ray.cut_rays + dr.select(cut, mi.UInt32(1), mi.UInt32(0)),
        active=goes_on,
    )


def _joined(path: Any, more: Any) -> Any:
    """Take one more number into that of a path (the hash of Fowler, Noll and Vo, a word at a time)."""
    return (path ^ more) * 16777619


def _shadow_ray(stage: Stage, plan: Plan, hit: Hit, n_g: Any, light: Sample) -> mi.Ray3f:
    """Make the open segment from the hit point to the light."""
    if plan.epsilon:
        shift, end = stage.epsilon * light.l, light.distance - stage.epsilon
    else:
        shift, length = precise.ray_offset(n_g, light.l, hit.reach, stage.surfaces.least_reach)
        end = light.end - length
    return mi.Ray3f(hit.p + shift, mi.Vector3f(light.l), mi.Float(end), 0, [])


def _surface_interaction(hit: Hit) -> mi.SurfaceInteraction3f:
    """As much of Mitsuba's record as a texture reads."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p, si.n, si.uv = hit.p, mi.Normal3f(hit.n_g), hit.uv
    return si
