"""The two formulas that lose digits: the power of a highlight, and the edge of a narrow cone."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from whitted_validation.stress.acne import HEAD
from whitted_validation.stress.case import Case, Outcome, U, limited, log_uniform
from whitted_validation.stress.geometry import GENERAL, about, affine, directions, dot, single, unit
from whitted_validation.stress.trial import Trial

PROBES = 400_000

LARGEST_ERROR = 1e-4
"""The promise for (n.h)^p, up to p = 10^6."""


def cases() -> Iterator[Case]:
    """List them."""
    for exponent in (0.0, 1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6):
        statement = f"(n.h)^p is right to {LARGEST_ERROR:g} and never above 1 (shown: largest error)"
        if exponent == 0:
            statement = "(n.h)^0 = 1 exactly wherever n.h > 0"
        yield Case("highlight", f"exponent {exponent:g}", statement, partial(_power, exponent=exponent))
    for cutoff in (0.5, 5.0):
        statement = "light falls off linearly in the angle, right to 8 u / (cutoff - beam) (shown: in units of that)"
        yield Case("narrow cones", f"spot of {cutoff:g} degrees", statement, partial(_cone, cutoff=cutoff))


def _power(trial: Trial, exponent: float) -> Outcome:
    """Call the plugin's own function on given unit vectors, n as near to h as the power can be seen."""
    import mitsuba as mi

    from mitsuba_whitted import precise

    rng, count = trial.random(), trial.count(PROBES)
    h = directions(rng, count)
    # 1 - n.h from where the power has died away (e^-20) down to nothing at all.
    y = np.minimum(log_uniform(rng, 1e-12, 1.0, count) * 20 / max(exponent, 20.0), 1.0)
    w = rng.normal(size=h.shape)
    w = unit(w - dot(w, h)[:, None] * h)
    n = single((1 - y)[:, None] * h + np.sqrt(y * (2 - y))[:, None] * w)
    h = single(h)
    sine = np.cross(unit(n), unit(h))
    n_h = dot(unit(n), unit(h))
    truth = np.where(n_h > 0, np.exp(0.5 * exponent * np.log1p(-np.minimum(dot(sine, sine), 1 - 1e-300))), 0.0)
    known = n_h > 16 * U  # n.h = 0 itself is a tie
    half = mi.Vector3f(h.T.astype(np.float32))
    power = precise.specular_power(mi.Normal3f(n.T.astype(np.float32)), half, mi.Float(exponent))
    seen = np.array(power, np.float64)[known]
    error = float(np.abs(seen - truth[known]).max())
    largest = float(seen.max())
    if exponent == 0:
        return limited("largest error", error, 0.0, largest=largest)
    outcome = limited("largest error", error, LARGEST_ERROR, largest=largest)
    return Outcome(outcome.holds and largest <= 1, outcome.figure, outcome.values)


def _cone(trial: Trial, cutoff: float) -> Outcome:
    """Put a spot 5 above a floor; its beam is 3/4 of the cone."""
    rng, count = trial.random(), trial.count(PROBES)
    at = single(5 * GENERAL[:, 2])
    turned = GENERAL @ np.diag([1.0, -1.0, -1.0])  # local +z looks down
    scene, exact = trial.pair(
        f"""{HEAD}<emitter type="spot"><transform name="to_world">{affine(turned, at)}</transform>
        <float name="cutoff_angle" value="{cutoff!r}"/></emitter><shape type="rectangle" id="floor">
        <transform name="to_world">{affine(GENERAL)}</transform><ref id="white"/></shape></scene>"""
    )
    spot: Any = exact.lights[0]
    floor: Any = exact.shapes[0]
    m = np.array(floor.to_world.matrix)
    n = unit(np.cross(m[:, 0], m[:, 1]))
    theta = rng.uniform(0.5, 1.1, count) * spot.cutoff_angle
    ring = about(np.array([0.0, 0.0, 1.0]), np.zeros(count), rng)[:, :2]
    q = np.column_stack([5 * np.tan(theta)[:, None] * ring, np.zeros(count)]) @ GENERAL.T
    v = about(n, rng.uniform(0.3, 0.8, count), rng)
    o, d = single(q + 0.5 * v), single(-v)
    t = dot(m[:, 3] - o, n) / dot(unit(d), n)
    p = o + t[:, None] * unit(d)
    position = np.array(spot.position)
    local = np.linalg.solve(np.array(spot.to_world.matrix)[:, :3], (p - position).T).T
    theta = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    ramp = np.clip((spot.cutoff_angle - theta) / (spot.cutoff_angle - spot.beam_width), 0, 1)
    truth = ramp * dot(n, unit(position - p))
    seen = trial.look(scene, o, d)[:, 0]
    # p is off by a few u of its coordinates and of its way, both below 1/5 of the distance to the spot: 2 u of angle;
    # l and its three products with the matrix turn it by 6 u more. The rest of the colour rounds to 16 u.
    allowed = 8 * U / (spot.cutoff_angle - spot.beam_width) + 16 * U
    worst = float((np.abs(seen - truth) / allowed).max())
    return limited("largest error in units of the bound", worst, 1.0, bound=float(allowed))
