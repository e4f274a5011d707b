"""Whitted's pipeline as one kernel: the textbook's ``raycolor``, its recursion turned into a loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted import precise
from mitsuba_whitted.lights import Sample
from mitsuba_whitted.materials import Coefficient
from mitsuba_whitted.plan import Plan
from mitsuba_whitted.ray import NOTHING, Found, Ray
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
    """Number of the path: equal where the same objects were met on the same side, on them the same squares of
    checkerboards and texels of bitmaps, and the same lights seen, bounce after bounce."""
    cut_rays: Any
    """Whether a mirror was not followed since it passes too little: see `Stage.least_throughput`."""


class _Chain(NamedTuple):
    """State of the loop: ray number k of a chain of mirrors, and what has been gathered so far."""

    k: Any
    o: Any
    d: Any
    begin: Any
    end: Any
    shift: Any
    own: Any
    throughput: Any
    """Product of k_m over the mirrors before."""
    colour: Any
    hit: Any
    shadow_rays: Any
    mirror_rays: Any
    path: Any
    cut_rays: Any
    active: Any

    @property
    def ray(self) -> Ray:
        """The ray that is followed now."""
        return Ray(*self[1 : 1 + len(Ray._fields)])


Note = Callable[..., None]
"""Called with the name of what has happened to a ray, and the values of that: see `explain`."""


def _unheard(_what: str, **_values: Any) -> None:
    """Take no notes; Dr.Jit drops what nobody reads, so that the kernel stays as it is."""


def trace(stage: Stage, plan: Plan, ray: Ray, active: Any = True, note: Note = _unheard) -> Traced:
    """Follow camera rays and all that they cause (Shirley et al. 2009, section 4.8; Whitted 1980).

    Parameters
    ----------
    stage : Stage
        The scene as tables, and the integrator's parameters as numbers.
    plan : Plan
        What the kernel must hold; all else is left out of it.
    ray : Ray
        Camera rays, one a lane.
    active : Bool
        Lanes that count.
    note
        Told what happens in between. It may keep values only while loops are evaluated, not recorded.
    """
    ray = stage.surfaces.approached(ray) if plan.shapes else ray
    state = _Chain(
        k=mi.UInt32(0),
        **ray._asdict(),
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
            lambda *chain: chain[-1],
            lambda *chain: tuple(_bounce(stage, plan, _Chain(*chain), note)),
            label="mirror bounces",
        )
        state = _Chain(*final)
    else:
        state = _bounce(stage, plan, state, note)
    return Traced(state.colour, state.hit, state.shadow_rays, state.mirror_rays, state.path, state.cut_rays)


def _bounce(stage: Stage, plan: Plan, chain: _Chain, note: Note) -> _Chain:
    """Do what ``raycolor`` does for one ray, and return the mirrored ray in place of the recursive call."""
    ray = chain.ray
    note("ray", k=chain.k, o=ray.o, d=ray.d, throughput=chain.throughput)
    depth = chain.k + 1
    sees_lamps = chain.active & (depth <= stage.max_depth)
    colour = mi.Spectrum(0)
    if not plan.shapes:
        if plan.background:
            colour = dr.select(sees_lamps, stage.background(mi.Vector3f(ray.d), sees_lamps), 0)
        note("emitted", colour=colour)
        note("sum", colour=colour)
        return chain._replace(colour=colour)

    met = stage.surfaces.first_hit(ray, chain.active, plan.inside)
    found = chain.active & met.valid
    background = mi.Spectrum(0)
    if plan.background:
        sees_sky = sees_lamps & (found ^ True)
        background = dr.select(sees_sky, stage.background(mi.Vector3f(ray.d), sees_sky), 0)

    note("emitted", colour=background)
    if not plan.mirrors:

        def shaded() -> tuple[Any, Any, Any]:
            return _shaded(stage, plan, chain, _surface(stage, plan, chain, met, found, note), background, note)

        def missed() -> tuple[Any, Any, Any]:
            return background, mi.UInt32(0), chain.path

        # A branch: a vector of rays that all miss does nothing more. Inside a loop Dr.Jit nests no branches.
        colour, shadow_rays, path = dr.if_stmt((), found, shaded, missed, label="surface")
        note("sum", colour=colour)
        return chain._replace(colour=colour, hit=found, shadow_rays=shadow_rays, path=path)

    surface = _surface(stage, plan, chain, met, found, note)
    colour, shadow_rays, path = _shaded(stage, plan, chain, surface, background, note)
    note("sum", colour=colour)
    k_m = surface.coefficient(stage.materials.k_m)
    throughput = chain.throughput * k_m
    r = mi.Vector3d(precise.mirrored(ray.d, surface.hit.n, surface.d_n))
    goes_on = surface.lit & dr.any(throughput != 0) & (dr.dot(surface.hit.n_g, r) > 0)
    # Only with max_depth = -1 the two limits can end a chain: see Stage.
    passes = (depth <= stage.last_ray) & dr.any(throughput >= stage.least_throughput)
    cut = goes_on & (passes ^ True)
    goes_on &= passes
    mirrored = _leaving(stage, plan, surface, r, mi.Float(dr.inf))
    note("mirror", k_m=k_m, r=r, goes_on=goes_on)
    return _Chain(
        k=depth,
        **mirrored._asdict(),
        throughput=throughput,
        colour=dr.select(chain.active, dr.fma(chain.throughput, colour, chain.colour), chain.colour),
        hit=chain.hit | (found & (chain.k == 0)),
        shadow_rays=chain.shadow_rays + shadow_rays,
        mirror_rays=chain.mirror_rays + dr.select(goes_on, mi.UInt32(1), mi.UInt32(0)),
        path=dr.select(chain.active, path, chain.path),
        cut_rays=chain.cut_rays + dr.select(cut, mi.UInt32(1), mi.UInt32(0)),
        active=goes_on,
    )


class _Surface(NamedTuple):
    """What a ray has met, seen from its side."""

    found: Any
    hit: Hit
    """In double; where a back is seen, its normals are turned to it."""
    n: Any
    """Unit normals in single precision: where rays go is told in double, light and colour are single."""
    n_g: Any
    v: Any
    """Unit vector back along the ray."""
    d_n: Any
    """Of the ray's direction with the shading normal as the hit has it."""
    offset: Any
    """See `precise.ray_offset`; None where no search could meet the surface again."""
    in_front: Any
    behind: Any
    lit: Any
    """Whether light is reflected here."""
    material: Any
    """Row of the material on this side."""

    def coefficient(self, k: Coefficient) -> Any:
        """Look up k_d, k_s, ... here."""
        return k.at(self.material, self.hit.uv, self.lit)


def _surface(stage: Stage, plan: Plan, chain: _Chain, met: Found, found: Any, note: Note) -> _Surface:
    """Compute the hit, and turn it to the side that is seen."""
    hit = stage.surfaces.hit(met, chain.ray, plan.textured)
    d_n, d_n_g = dr.dot(chain.d, hit.n), dr.dot(chain.d, hit.n_g)
    in_front = found & (d_n < 0) & (d_n_g < 0)
    behind = mi.Bool(False)
    if plan.two_sided:
        behind = found & (d_n > 0) & (d_n_g > 0)
        d_n = dr.select(behind, -d_n, d_n)
        hit = hit._replace(n=dr.select(behind, -hit.n, hit.n), n_g=dr.select(behind, -hit.n_g, hit.n_g))
    n, n_g = precise.unit(hit.n), precise.unit(hit.n_g)
    lit = (in_front | behind) & (chain.k + 1 < stage.max_depth)
    note("surface", met=met, found=found, p=hit.p, n=n, n_g=n_g, facing=in_front | behind, lit=lit)
    material = stage.materials.row_of(hit.shape, behind)
    offset = precise.ray_offset(n_g, hit.reach, stage.surfaces.least_reach) if plan.searched else None
    v = -mi.Vector3f(chain.d)
    return _Surface(found, hit, n, n_g, v, d_n, offset, in_front, behind, lit, material)


def _shaded(
    stage: Stage, plan: Plan, chain: _Chain, surface: _Surface, colour: Any, note: Note
) -> tuple[Any, Any, Any]:
    """Add emission, ambient light and all lights to a colour (Shirley et al. 2009, section 4.5).

    Returns
    -------
    tuple
        Colour, number of shadow rays, and number of the path with what was met here.
    """
    hit, n, n_g, v = surface.hit, surface.n, surface.n_g, surface.v
    if plan.emission:
        shines = surface.in_front & (chain.k < stage.max_depth)
        colour = dr.select(shines, stage.emission.at(hit.shape, hit.uv, shines), colour)
        note("emitted", colour=colour)
    if plan.ambient:
        ambient = dr.select(surface.lit, surface.coefficient(stage.materials.k_a) * stage.ambient, 0)
        note("ambient", colour=ambient)
        colour = colour + ambient

    side = dr.select(surface.in_front, mi.UInt32(1), dr.select(surface.behind, mi.UInt32(2), 3))
    path = _joined(chain.path, dr.select(surface.found, 4 * hit.shape + side, 0))
    if plan.textured:
        for number in stage.squares(hit, surface.material, surface.found):
            path = _joined(path, number)
    shadow_rays, seen = mi.UInt32(0), mi.UInt32(0)
    if plan.lights:
        k_d = surface.coefficient(stage.materials.k_d) if plan.diffuse else mi.Spectrum(0)
        k_s = surface.coefficient(stage.materials.k_s) if plan.specular else mi.Spectrum(0)
        exponent = surface.coefficient(stage.materials.exponent) if plan.specular else mi.Float(0)
        reflects = surface.lit & dr.any((k_d + k_s) > 0)
        note("coefficients", k_d=k_d, k_s=k_s, exponent=exponent)

        def contribution(light: Sample) -> tuple[Any, Any, Any]:
            """k_d I (n.l) + k_s I (n.h)^p if the light is above the horizon and not in shadow; rays asked; its name."""
            n_l = dr.dot(n, light.l)
            facing = reflects & light.reaches & (n_l > 0) & (dr.dot(n_g, light.l) > 0)

            def shine() -> tuple[Any, Any]:
                f = k_d * n_l
                if plan.specular:
                    h = dr.normalize(v + light.l)
                    f += k_s * precise.specular_power(n, h, exponent)
                visible = facing
                if plan.shadows:
                    shadow_ray = _shadow_ray(stage, plan, surface, light)
                    visible = facing & (stage.surfaces.blocked(shadow_ray, facing, plan.inside) ^ True)
                return dr.select(visible, f * light.colour, 0), visible

            # A branch: a vector of rays does nothing of this where the light is below the horizon of all of them.
            added, visible = dr.if_stmt((), facing, shine, _dark, label="light")
            note("shadow ray", ray=_shadow_ray(stage, plan, surface, light))
            note("light", light=light, facing=facing, visible=visible, colour=added)
            asked = dr.select(facing, mi.UInt32(1), mi.UInt32(0)) if plan.shadows else mi.UInt32(0)
            return added, asked, dr.select(visible, light.name, 0)

        for lights in stage.lights:
            light_sum, asked, names = lights.sum(contribution, hit.p, plan.inverse_square)
            colour = colour + light_sum
            shadow_rays += asked
            seen += names
    return colour, shadow_rays, _joined(path, seen)


def _joined(path: Any, more: Any) -> Any:
    """Take one more number into that of a path (the hash of Fowler, Noll and Vo, a word at a time)."""
    return (path ^ more) * 16777619


def _dark() -> tuple[Any, Any]:
    """Add nothing for a light that is below the horizon."""
    return mi.Spectrum(0), mi.Bool(False)


def _shadow_ray(stage: Stage, plan: Plan, surface: _Surface, light: Sample) -> Ray:
    """Make the open segment from the hit point to the light."""
    return _leaving(stage, plan, surface, mi.Vector3d(light.l), light.distance if plan.epsilon else light.end)


def _leaving(stage: Stage, plan: Plan, surface: _Surface, d: Any, end: Any) -> Ray:
    """Make the ray from the hit point along `d`, which cannot meet that surface again where it begins."""
    hit = surface.hit
    if plan.epsilon:
        shift = mi.Vector3f(stage.epsilon * mi.Vector3f(d))
        return Ray(hit.p, d, mi.Float(stage.epsilon), end, shift, mi.UInt32(NOTHING))
    if surface.offset is None:
        return Ray(hit.p, d, mi.Float(0), end, mi.Vector3f(0), hit.shape)
    shift, length = surface.offset
    return Ray(hit.p, d, mi.Float(0), end - length, mi.Vector3f(shift), hit.shape)
