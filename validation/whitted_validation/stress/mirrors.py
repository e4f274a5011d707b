"""Chains of mirrors: how far rounding lets a ray come before it is somewhere else."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from whitted_validation.stress.case import Case, Outcome, limited
from whitted_validation.stress.geometry import (
    GENERAL,
    Array,
    about,
    affine,
    directions,
    dot,
    meet_plane,
    meet_sphere,
    plane_of,
    single,
    triple,
    unit,
)
from whitted_validation.stress.meshes import MIRROR
from whitted_validation.stress.trial import Trial

PROBES = 20_000
BOUNCES = 64

LARGEST_MEDIAN = BOUNCES**2 * 8 * 2.0**-53
"""The promise: median error of the point met after 64 bounces, in sizes of the scene.

Each bounce may turn the ray by 8 roundings in double, and each turn is carried over at most all bounces that follow.
"""

PER_BOUNCE = 6.0
"""Roundings, in v = 2^-53, that a bounce may add: 4 of point and normal, and 1.37 times as many with all before."""


def cases() -> Iterator[Case]:
    """List them."""
    median = f"the median error of the 64th point is at most {LARGEST_MEDIAN:g} of the scene's size"
    for scale in (1e-6, 1.0, 1e6):
        yield Case("mirror chains", f"parallel mirrors, scale {scale:g}", median, partial(_parallel, scale=scale))
        yield Case("mirror chains", f"inside a ball, scale {scale:g}", median, partial(_inside, scale=scale))
    statement = (
        f"between balls a radius apart the median error after b bounces is at most {PER_BOUNCE:g} v 3.73^b (b = 8)"
    )
    yield Case("mirror chains", "two convex balls", statement, _convex)


def _reflected(d: Array, n: Array) -> Array:
    return unit(d - 2 * dot(d, n)[:, None] * n)


def _error(points: list[Array], found: list[Any], truth: list[Array], size: float) -> list[float]:
    """Return the median error, in sizes, bounce by bounce; a lost ray is off by any amount."""
    errors = []
    for i, exact in enumerate(truth):
        there = i < len(points)
        off = np.sqrt(dot(points[i] - exact, points[i] - exact)) / size if there else np.full(len(exact), np.inf)
        errors.append(float(np.median(np.where(found[i], off, np.inf) if there else off)))
    return errors


def _outcome(errors: list[float]) -> Outcome:
    shown = {f"after {b} bounces": errors[b] for b in (1, 4, 16, 32, 64)}
    return limited("after 64", errors[BOUNCES], LARGEST_MEDIAN, **shown)


def _parallel(trial: Trial, scale: float) -> Outcome:
    """Start between square mirrors of side 40, as far apart as 1, facing each other."""
    rng, count = trial.random(), trial.count(PROBES)
    there = np.diag([1.0, -1.0, -1.0])  # turned to face the first
    scene, exact = trial.pair(
        f"""{MIRROR}<shape type="rectangle" id="floor"><transform name="to_world">{affine(20 * scale * GENERAL)}
        </transform><ref id="mirror"/></shape><shape type="rectangle" id="ceiling"><transform name="to_world">
        {affine(20 * scale * GENERAL @ there, scale * GENERAL[:, 2])}</transform><ref id="mirror"/></shape></scene>"""
    )
    planes = [plane_of(shape) for shape in exact.shapes]
    normals = [unit(np.array(shape.to_world.normal)[:, 2]) for shape in exact.shapes]  # M^-T z, as it was rounded
    q = scale * np.column_stack([rng.uniform(-1, 1, (count, 2)), np.full(count, 0.5)]) @ GENERAL.T
    o, d = single(q), single(about(-GENERAL[:, 2], rng.uniform(0.98, 1.0, count), rng))
    points, found = trial.follow(scene, o, d)
    truth = []
    p, d = o, unit(d)
    for b in range(BOUNCES + 1):
        origin, n, _ = planes[b % 2]
        p, _ = meet_plane(p, d, origin, n)
        d = _reflected(d, normals[b % 2])
        truth.append(p)
    return _outcome(_error(points, found, truth, 40 * scale))


def _inside(trial: Trial, scale: float) -> Outcome:
    """Start within a ball of radius 2 that mirrors inwards."""
    rng, count = trial.random(), trial.count(PROBES)
    centre, radius = single(scale * np.array([0.25, -0.5, 0.125])), float(single(2 * scale))
    scene = trial.load(
        trial.write(
            f"""{MIRROR}<shape type="sphere" id="ball"><point name="center" value="{triple(centre)}"/>
            <float name="radius" value="{radius!r}"/><boolean name="flip_normals" value="true"/><ref id="mirror"/>
            </shape></scene>"""
        )
    )
    o, d = single(centre + 0.5 * radius * directions(rng, count)), single(directions(rng, count))
    points, found = trial.follow(scene, o, d)
    truth = []
    p, d = o, unit(d)
    for _ in range(BOUNCES + 1):
        n, _ = meet_sphere(p, d, centre, radius, far=True)
        p, d = centre + radius * n, _reflected(d, n)
        truth.append(p)
    return _outcome(_error(points, found, truth, 2 * radius))


def _convex(trial: Trial) -> Outcome:
    """Take balls of radius 1, 1 apart; rays start along the line between them, so near that eight bounces stay."""
    rng, count = trial.random(), trial.count(PROBES)
    axis = GENERAL[:, 0]
    centres = [single(1.5 * axis), single(-1.5 * axis)]
    balls = "".join(
        f'<shape type="sphere" id="ball_{i}"><point name="center" value="{triple(c)}"/><ref id="mirror"/></shape>'
        for i, c in enumerate(centres)
    )
    scene = trial.load(trial.write(f"{MIRROR}{balls}</scene>"))
    bounces = 8
    growth = 2 + np.sqrt(3)  # 1 + g + sqrt(g^2 + 2 g) at g = gap / radius = 1: what a bounce does to an error
    start = growth ** -float(bounces + 1)
    o = single(start * about(axis, np.zeros(count), rng) * rng.random((count, 1)))
    d = single(np.broadcast_to(axis, o.shape))
    points, found = trial.follow(scene, o, d)
    truth = []
    p, d = o, unit(d)
    for b in range(bounces + 1):
        n, _ = meet_sphere(p, d, centres[b % 2], 1.0)
        p, d = centres[b % 2] + n, _reflected(d, n)
        truth.append(p)
    errors = _error(points, found, truth, 1.0)
    return limited(
        "after 8",
        errors[bounces],
        PER_BOUNCE * 2.0**-53 * growth**bounces,
        **{f"after {b} bounces": errors[b] for b in (1, 2, 4, 8)},
    )
