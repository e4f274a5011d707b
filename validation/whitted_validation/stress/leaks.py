"""Light where none can get: under lids, behind walls, at contacts, in the umbra of far balls, past the last plate.

Gaps are narrow on purpose, and the eye lies in them: a probe starts half-way across. What counts is where the
float32 numbers of scene and probe put it, worked out in double precision.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from whitted_validation.stress.acne import HEAD
from whitted_validation.stress.case import Case, Outcome, U, limited, log_uniform, shares, together
from whitted_validation.stress.geometry import (
    GENERAL,
    Array,
    about,
    affine,
    directions,
    dot,
    inside_rectangle,
    meet_plane,
    meet_sphere,
    plane_of,
    rotation,
    single,
    triple,
    unit,
)
from whitted_validation.stress.trial import Trial

PROBES = 200_000

NARROWEST = 1e-6
"""Gaps of this share of the floor's side must stay dark: the promise. They are 17 u wide, close to float32's grid."""

DRAWN_FROM = 2e-7
"""Gaps are tried from here on, to see where a policy ends."""


def cases() -> Iterator[Case]:
    """List them."""
    for scale in (1e-6, 1e-3, 1.0, 1e3, 1e6):
        yield _gap(f"gap under a lid, scale {scale:g}", angle=1e-2, scale=scale)
    for scale in (1e-6, 1.0, 1e6):
        yield _gap(f"foot of a thin wall, scale {scale:g}", angle=np.pi / 2, scale=scale)
    for scale in (1e-6, 1e-3, 1.0, 1e3, 1e6):
        statement = "around its contact with the floor a ball is dark from below, and the floor from above: no lit ring"
        yield Case("light leaks", f"ball on a floor, scale {scale:g}", statement, partial(_contact, scale=scale))
    for ratio in (1e2, 1e3, 1e4):
        statement = "a ball in front of the sun darkens the floor within its radius, and nothing beside it"
        yield Case("far balls", f"umbra from {ratio:g} radii", statement, partial(_umbra, ratio=ratio))
    for share in (1e-3, 1e-4, 1e-5):
        before = f"plate before the lamp, {share:g} of the way"
        behind = f"plate behind the lamp, {share:g} of the way"
        yield Case("ends of shadow rays", before, "all of the floor is dark", partial(_plate, share=share))
        yield Case("ends of shadow rays", behind, "all of the floor is lit", partial(_plate, share=-share))


def _gap(name: str, **where: float) -> Case:
    statement = (
        f"gaps of {NARROWEST:g} of the size and more are dark, and where nothing is above, it is lit; "
        "shown: the widest gap that fails"
    )
    return Case("light leaks", name, statement, lambda trial: _wedge(trial, **where))


def _wedge(trial: Trial, angle: float, scale: float) -> Outcome:
    """Put a second rectangle through the middle line of a floor: a lid over one half, out of the way of the other."""
    rng, count = trial.random(), trial.count(PROBES)
    lid = scale * GENERAL @ rotation((0, 1, 0), -angle)
    scene, exact = trial.pair(
        f"""{HEAD}<emitter type="directional">
        <vector name="direction" value="{triple(GENERAL @ (0.6, -0.2, -0.7746))}"/></emitter>
        <shape type="rectangle" id="floor"><transform name="to_world">{affine(scale * GENERAL)}</transform>
        <ref id="white"/></shape><shape type="rectangle" id="lid"><transform name="to_world">{affine(lid)}</transform>
        </shape></scene>"""
    )
    floor, cover = exact.shapes
    origin, n, _ = plane_of(floor)
    cover_origin, cover_n, _ = plane_of(cover)
    sun: Any = exact.lights[0]
    l = -unit(np.array(sun.direction))  # noqa: E741
    gap = log_uniform(rng, 2 * DRAWN_FROM, 0.4 * np.sin(angle), count)  # in units of `scale`, half a side
    side = np.where(rng.random(count) < 0.7, 1.0, -1.0)
    x = side * gap / np.sin(angle)
    q = scale * np.column_stack([x, rng.uniform(-0.5, 0.5, count), np.zeros(count)]) @ GENERAL.T
    v = about(n, rng.uniform(0.3, 1.0, count), rng)
    if angle > 1:  # the eye beside the wall, on the same side
        away = GENERAL[:, 0]
        v *= np.where(dot(v, away) * side < 0, -1.0, 1.0)[:, None]
        v = unit(v - 2 * np.minimum(dot(v, n), 0)[:, None] * n)
        reach = np.ones(count)
    else:
        reach = np.where(side > 0, 0.5 * gap / dot(v, n), 1.0)
    o, d = single(q + scale * reach[:, None] * v), single(-v)
    p, t = meet_plane(o, unit(d), origin, n)
    above, lid_at = meet_plane(p, np.broadcast_to(l, p.shape), cover_origin, cover_n)
    covered = (lid_at > 0) & inside_rectangle(above, cover, 0.99)
    off_lid = np.abs(dot(p - cover_origin, cover_n)) / (2 * scale)
    # Whether the eye's own way to the floor is free: the lid may not lie between, however near.
    _, lid_t = meet_plane(o, unit(d), cover_origin, cover_n)
    sees = (t > 0) & ~((lid_t > 0) & (lid_t < t)) & (dot(o - origin, n) > 0) & (off_lid > DRAWN_FROM)
    seen = trial.look(scene, o, d).max(axis=1)
    lit_under_lid = sees & covered & ~(seen == 0)
    open_but_dark = sees & ~covered & ~(seen > 0)
    return _widest(off_lid, lit_under_lid | open_but_dark, sees, int(lit_under_lid.sum()), int(open_but_dark.sum()))


def _widest(gap: Array, wrong: Any, tried: Any, leaks: int, black: int) -> Outcome:
    width = float(gap[wrong].max(initial=0.0))
    outcome = limited(
        "widest gap that fails", width, NARROWEST, probes=int(tried.sum()), lit=leaks, **{"black in the open": black}
    )
    return Outcome(width < NARROWEST and bool(tried.any()), "0" if width == 0 else outcome.figure, outcome.values)


def _contact(trial: Trial, scale: float) -> Outcome:
    """Light with one sun above and one below the floor, in different channels."""
    rng, count = trial.random(), trial.count(PROBES)
    up = GENERAL[:, 2]
    radius = float(single(scale))
    centre = single(radius * up)
    suns = "".join(
        f'<emitter type="directional"><vector name="direction" value="{triple(GENERAL @ (0.3, 0.1, -side))}"/>'
        f'<rgb name="irradiance" value="{colour}"/></emitter>'
        for side, colour in ((1, "1, 0, 0"), (-1, "0, 1, 0"))
    )
    scene, exact = trial.pair(
        f"""{HEAD}{suns}<shape type="rectangle" id="floor"><transform name="to_world">{affine(2 * scale * GENERAL)}
        </transform><ref id="white"/></shape><shape type="sphere" id="ball"><point name="center"
        value="{triple(centre)}"/><float name="radius" value="{radius!r}"/><ref id="white"/></shape></scene>"""
    )
    origin, n, _ = plane_of(exact.shapes[0])
    l = -unit(np.array(exact.lights[0].direction))  # type: ignore[union-attr]  # noqa: E741
    gap = log_uniform(rng, 4 * DRAWN_FROM, 0.3, count)  # in radii; the floor is 4 of them wide
    beside = about(up, np.zeros(count), rng)
    q = centre - radius * ((1 - gap)[:, None] * up - np.sqrt(1 - (1 - gap) ** 2)[:, None] * beside)
    v = about(-n, rng.uniform(0.5, 1.0, count), rng)  # from the ball's underside down into the gap
    o = single(q + (0.5 * radius * gap / -dot(v, n))[:, None] * v)
    sees = (dot(o - origin, n) > 0) & (dot(o - centre, o - centre) > radius**2)

    up_ray = single(-v)
    normal, _ = meet_sphere(o, unit(up_ray), centre, radius)
    p = centre + radius * normal
    height = dot(p - origin, n) / (4 * scale)
    ball = trial.look(scene, o, up_ray)
    ball_wrong = sees & np.isfinite(height) & (height > DRAWN_FROM) & ~(ball.max(axis=1) == 0)

    down_ray = single(unit(about(-n, rng.uniform(0.5, 1.0, count), rng)))
    p, _ = meet_plane(o, unit(down_ray), origin, n)
    from_axis = _off_line(centre, p, l)
    under = radius - np.sqrt(np.maximum(radius**2 - dot(p - centre - dot(p - centre, n)[:, None] * n, p - centre), 0))
    floor = trial.look(scene, o, down_ray)
    in_umbra = sees & (from_axis < radius * (1 - 64 * U))
    floor_wrong = in_umbra & ~(floor.max(axis=1) == 0)
    wrong_gap = np.concatenate([height[ball_wrong], under[floor_wrong] / (4 * scale)])
    tried = np.concatenate([sees, in_umbra])
    return _widest(wrong_gap, np.ones(len(wrong_gap), bool), tried, len(wrong_gap), 0)


def _off_line(c: Array, p: Array, l: Array) -> Array:  # noqa: E741
    """Return how far `c` lies from the lines through `p` along `l`."""
    w = c - p
    w = w - dot(w, l)[:, None] * l
    return np.asarray(np.sqrt(dot(w, w)))


def _umbra(trial: Trial, ratio: float) -> Outcome:
    """Put the ball at distance 1 from the floor, along the light's direction."""
    rng, count = trial.random(), trial.count(PROBES)
    radius = float(single(1 / ratio))
    toward = GENERAL @ unit(np.array([0.3, 0.2, 1.0]))
    centre = single(toward)
    scene, exact = trial.pair(
        f"""{HEAD}<emitter type="directional"><vector name="direction" value="{triple(-toward)}"/></emitter>
        <shape type="rectangle" id="floor"><transform name="to_world">{affine(0.5 * GENERAL)}</transform>
        <ref id="white"/></shape><shape type="sphere" id="ball"><point name="center" value="{triple(centre)}"/>
        <float name="radius" value="{radius!r}"/></shape></scene>"""
    )
    origin, n, _ = plane_of(exact.shapes[0])
    l = -unit(np.array(exact.lights[0].direction))  # type: ignore[union-attr]  # noqa: E741
    middle, _ = meet_plane(centre[None], l[None], origin, n)
    w = directions(rng, count)
    w = unit(w - dot(w, l)[:, None] * l)
    q, _ = meet_plane(middle + (radius * np.sqrt(rng.uniform(0, 4, count)))[:, None] * w, l[None], origin, n)
    v = about(n, rng.uniform(0.2, 0.6, count), rng)
    o, d = single(q + 0.1 * v), single(-v)
    p, _ = meet_plane(o, unit(d), origin, n)
    off = _off_line(centre, p, l) / radius
    # The point (2 u of the way and of its coordinates, stretched by the slant) and l, 2 u over a distance of 1.
    doubt = 16 * U * ratio
    dark, lit = off < 1 - doubt, off > 1 + doubt
    seen = trial.look(scene, o, d).max(axis=1)
    return shares(
        ("points of the umbra lit", (dark & ~(seen == 0)).sum(), dark.sum()),
        ("points beside it black", (lit & ~(seen > 0)).sum(), lit.sum()),
    )


def _plate(trial: Trial, share: float) -> Outcome:
    """Put a lamp 10 above the floor, and a plate as far from it as a share of that: below it, or above if negative."""
    return together(
        [_one_plate(trial, share, scale) for scale in (1e-3, 1.0, 1e3)], [f"scale {s:g}" for s in (1e-3, 1.0, 1e3)]
    )


def _one_plate(trial: Trial, share: float, scale: float) -> Outcome:
    rng, count = trial.random(), trial.count(PROBES)
    up = GENERAL[:, 2]
    lamp = single(10 * scale * up)
    plate = lamp - 10 * scale * share * up
    scene, exact = trial.pair(
        f"""{HEAD}<emitter type="point"><point name="position" value="{triple(lamp)}"/></emitter>
        <shape type="rectangle" id="floor"><transform name="to_world">{affine(2 * scale * GENERAL)}</transform>
        <ref id="white"/></shape><shape type="rectangle" id="plate"><transform name="to_world">
        {affine(2 * scale * GENERAL, plate)}</transform></shape></scene>"""
    )
    _, n, _ = plane_of(exact.shapes[0])
    q = scale * np.column_stack([rng.uniform(-1.5, 1.5, (count, 2)), np.zeros(count)]) @ GENERAL.T
    v = about(n, rng.uniform(0.3, 1.0, count), rng)
    o, d = single(q + scale * v), single(-v)
    seen = trial.look(scene, o, d).max(axis=1)
    above, _, _ = plane_of(exact.shapes[1])
    is_before = dot(lamp - above, n) > 0
    if is_before != (share > 0):
        return Outcome(False, "no case")  # rounding the plate's place has moved it to the other side of the lamp
    if is_before:
        return shares(("points lit through the plate", (~(seen == 0)).sum(), count))
    return shares(("points dark before the plate", (~(seen > 0)).sum(), count))
