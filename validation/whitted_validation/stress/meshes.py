"""Meshes that leak, triangles that are hardly there, and surfaces seen from so low that they nearly vanish."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from whitted_validation.stress.acne import HEAD
from whitted_validation.stress.case import Case, Outcome, U, limited, percent, shares
from whitted_validation.stress.geometry import (
    GENERAL,
    Array,
    about,
    affine,
    directions,
    dot,
    meet_plane,
    plane_of,
    single,
    triple,
    unit,
)
from whitted_validation.stress.trial import Trial

PROBES = 200_000

V = 2.0**-53
"""Largest relative error of one rounding in double."""

VERTEX_LEAKS = 5e-4
"""Share of rays aimed at a vertex that may slip through: Embree's edge test is exact at edges, not at vertices.

All signs about a vertex may agree where the ray passes it within what differences and sums of points, and products of
these, round. Most of it comes of the former: the outcome tells how many rays are lost where those are exact.
"""

GLOW = """<scene version="3.0.0"><integrator type="whitted"><integer name="max_depth" value="1"/></integrator>
<sensor type="perspective"/><bsdf type="twosided" id="glow"><bsdf type="diffuse"/></bsdf>
<emitter type="constant"><rgb name="radiance" value="1"/></emitter>
"""
"""White sky, and black inside what it surrounds: whatever is seen from inside a closed body has leaked."""


def cases() -> Iterator[Case]:
    """List them."""
    for aim in ("anywhere", "at edges", "at vertices"):
        statement = "rays from inside a closed, crumpled mesh meet it" + (
            f"; Embree may lose {VERTEX_LEAKS:.2%} of them" if aim == "at vertices" else ""
        )
        yield Case("closed meshes", f"aimed {aim}", statement, partial(_closed, aim=aim))
    for width in (1e-2, 1e-4, 1e-6):
        statement = "rays through a thin triangle meet it, rays beside it do not, and its colour is right"
        yield Case("slivers", f"width {width:g} of the length", statement, partial(_sliver, width=width))
    for degrees in (89.0, 89.9, 89.99, 89.999):
        statement = (
            "the point met is right to 32 v (distance + coordinates) / cosine with v = 2^-53, and to 32 v sum |n_i| "
            "reach_i off the plane (shown: the former, without the 32)"
        )
        yield Case("grazing view", f"plane at {degrees:g} degrees", statement, partial(_low_plane, degrees=degrees))
        statement = (
            "balls are met up to their outline, not beyond; the point lies on the ray to 52 v with v = 2^-53, and on "
            "the ball to 40 v where the ray meets it"
        )
        yield Case("grazing view", f"ball at {degrees:g} degrees", statement, partial(_low_ball, degrees=degrees))


def crumpled_ball(rng: np.random.Generator, rings: int = 16) -> tuple[Array, Any]:
    """Make a closed mesh, every vertex of a ball moved along its radius (pbrt's test shape is alike)."""
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    turn = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    ball = [(np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)) for a in polar for b in turn]
    vertices = np.array([(0, 0, 1), *ball, (0, 0, -1)])
    vertices *= rng.uniform(0.7, 1.3, len(vertices))[:, None]
    around, last = len(turn), len(vertices) - 1
    faces: list[tuple[int, int, int]] = []
    for j in range(around):
        k = (j + 1) % around
        faces.append((0, 1 + j, 1 + k))
        faces.append((last, last - around + k, last - around + j))
        for i in range(len(polar) - 1):
            a, b = 1 + i * around, 1 + (i + 1) * around
            faces += [(a + j, b + j, b + k), (a + j, b + k, a + k)]
    return vertices @ GENERAL.T, np.array(faces)


def obj(vertices: Array, faces: Any) -> str:
    """Write an obj file."""
    points = (f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist())
    return "\n".join([*points, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()), ""])


def _closed(trial: Trial, aim: str) -> Outcome:
    rng, count = trial.random(), trial.count(PROBES)
    vertices, faces = crumpled_ball(rng)
    file = trial.folder / "crumpled.obj"
    file.write_text(obj(vertices, faces), encoding="utf-8")
    scene, exact = trial.pair(
        f"""{GLOW}<shape type="obj" id="crumpled"><string name="filename" value="crumpled.obj"/>
        <boolean name="face_normals" value="true"/><ref id="glow"/></shape></scene>"""
    )
    mesh: Any = exact.shapes[0]
    corners = np.array(mesh.vertices)
    triangles = corners[np.array(mesh.faces)[rng.integers(len(faces), size=count)]]
    o = single(0.3 * directions(rng, count))  # well inside: no vertex is nearer to the middle than 0.7
    share = rng.random((count, 1))
    one = rng.integers(len(corners), size=count)
    target = {
        "anywhere": o + directions(rng, count),
        "at edges": triangles[:, 0] * (1 - share) + triangles[:, 1] * share,
        "at vertices": corners[one],
    }[aim]
    d = unit(target - o)
    through = trial.look(scene, o, single(d)).max(axis=1) > 0
    lost = float(through.mean())
    limit = VERTEX_LEAKS if aim == "at vertices" else 0.0
    values = {"leaks": int(through.sum()), "of": count, "limit": limit, "leaks of Embree alone": _missed(file, o, d)}
    if aim == "at vertices":  # where they come from: how many are left if Embree's differences of points are exact
        coarse = trial.folder / "coarse.obj"
        coarse.write_text(obj(_on_grid(corners), faces), encoding="utf-8")
        o = _on_grid(o)
        values["leaks of Embree alone on a grid"] = _missed(coarse, o, unit(_on_grid(corners)[one] - o))
    return Outcome(lost <= limit, percent(lost), values)


def _on_grid(points: Array) -> Array:
    """Round to multiples of 2^-10: differences and sums of such points are exact in single precision."""
    return np.round(points * 2**10) / 2**10


def _missed(file: Path, o: Array, d: Array) -> int:
    """Count the rays that Embree, with its robust flag, loses of itself."""
    import mitsuba as mi

    mesh = {"type": "obj", "filename": str(file), "face_normals": True}
    scene = mi.load_dict({"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh}, optimize=False)
    ray = mi.Ray3f(mi.Point3f(o.T.astype(np.float32)), mi.Vector3f(d.T.astype(np.float32)))
    return int(np.count_nonzero(~np.array(scene.ray_test(ray))))


def _sliver(trial: Trial, width: float) -> Outcome:
    """Take one triangle, as long as 1, seen from 1/2; rays aimed at it, and past its long edges."""
    rng, count = trial.random(), trial.count(PROBES)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.4, width, 0]]) @ GENERAL.T
    (trial.folder / "sliver.obj").write_text(obj(vertices, np.array([[0, 1, 2]])), encoding="utf-8")
    toward = GENERAL @ unit(np.array([0.2, 0.3, 1.0]))
    scene, exact = trial.pair(
        f"""{HEAD}<emitter type="directional"><vector name="direction" value="{triple(-toward)}"/></emitter>
        <shape type="obj" id="sliver"><string name="filename" value="sliver.obj"/>
        <boolean name="face_normals" value="true"/><ref id="white"/></shape></scene>"""
    )
    mesh: Any = exact.shapes[0]
    a, b, c = np.array(mesh.vertices)
    n = unit(np.cross(b - a, c - a))
    l = -unit(np.array(exact.lights[0].direction))  # type: ignore[union-attr]  # noqa: E741
    along, up = rng.uniform(0.05, 0.95, count), rng.uniform(-1, 2, count)
    thick = np.where(along < 0.4, along / 0.4, (1 - along) / 0.6)
    across = np.cross(n, unit(b - a))
    beside = np.where(rng.random(count) < 0.3, 256 * U * np.sign(up - 0.5), 0.0)  # well past an edge
    q = a + along[:, None] * (b - a) + (up * thick * width + beside)[:, None] * across
    v = about(n, rng.uniform(0.4, 1.0, count), rng)
    o, d = single(q + 0.5 * v), single(-v)
    p, _ = meet_plane(o, unit(d), a, n)
    room = np.min([dot(p - x, np.cross(n, unit(y - x))) for x, y in ((a, b), (b, c), (c, a))], axis=0)
    # Vertices and origin are exact. Differences of them (at most 1.5) and two products round, 4 u in all; the
    # direction turns by 2 u over 1/2; on the plane all that is longer by the cosine.
    doubt = 8 * U / -dot(unit(d), n)
    seen = trial.look(scene, o, d)[:, 0]
    inside, outside = room > doubt, room < -doubt
    n_l = float(n @ l)
    off = np.abs(seen - n_l)[inside & (seen > 0)].max(initial=0.0)
    outcome = shares(
        ("rays through it that miss", (inside & (seen == 0)).sum(), max(1, inside.sum())),
        ("rays beside it that hit", (outside & (seen != 0)).sum(), outside.sum()),
        ("colours not finite", (~np.isfinite(seen)).sum(), count),
        ("colours off by more than 32 u", (off > 32 * U), 1),
    )
    outcome.values["largest error of the colour, u"] = float(off / U)
    return outcome


MIRROR = """<scene version="3.0.0"><integrator type="whitted"><integer name="max_depth" value="66"/></integrator>
<sensor type="perspective"/><bsdf type="blinnphong" id="mirror"><float name="mirror_reflectance" value="1"/></bsdf>
<emitter type="constant"/>
"""
"""Whole mirrors under a white sky: nothing is lost on the way."""


def _low_plane(trial: Trial, degrees: float) -> Outcome:
    rng, count = trial.random(), trial.count(PROBES)
    cosine = np.cos(np.radians(degrees))
    scene, exact = trial.pair(
        f"""{MIRROR}<shape type="rectangle" id="plane"><transform name="to_world">{affine(4 * GENERAL)}</transform>
        <ref id="mirror"/></shape></scene>"""
    )
    origin, n, _ = plane_of(exact.shapes[0])
    q = np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)]) @ GENERAL.T
    v = about(n, np.full(count, cosine), rng)
    o, d = single(q + 2 * v), single(-v)
    p, t = meet_plane(o, unit(d), origin, n)
    points, found = trial.follow(scene, o, d)
    hits = found[0] & (t > 0)
    off = np.sqrt(dot(points[0] - p, points[0] - p))
    allowed = V * (t + 4 * np.sqrt(3)) / -dot(unit(d), n)
    worst = float((off / allowed)[hits].max(initial=0.0))
    # Distance and slope round 5 and 6 times, the point twice; pulled back 5 times; as often in what is compared with.
    out = float(np.abs(dot(points[0] - origin, n))[hits].max(initial=0.0) / (V * 4 * np.abs(n).sum()))
    outcome = limited("error in units of v (t + reach) / cos", worst, 32.0, missed=int((~hits).sum()))
    good = outcome.holds and bool(hits.all()) and out <= 32
    return Outcome(good, outcome.figure, outcome.values | {"off the plane in units of v sum |n_i| reach_i": out})


def _low_ball(trial: Trial, degrees: float) -> Outcome:
    rng, count = trial.random(), trial.count(PROBES)
    scene = trial.load(
        trial.write(
            f"""{MIRROR}<shape type="sphere" id="ball"><point name="center" value="0.25, -0.5, 0.125"/>
            <ref id="mirror"/></shape></scene>"""
        )
    )
    centre, distance = np.array([0.25, -0.5, 0.125]), 3.0
    # The foot of the perpendicular lies at the sine of the angle; as far outside, or as is certain, are tried too.
    depth = 1 - np.sin(np.radians(degrees))
    off = np.where(rng.random(count) < 0.3, 1 + max(depth, 64 * U), 1 - depth)
    beside = about(np.array([0.0, 0.0, 1.0]), np.zeros(count), rng)
    toward = directions(rng, count)
    toward = unit(toward - dot(toward, beside)[:, None] * beside)
    o, d = single(centre + off[:, None] * beside - distance * toward), single(toward)
    points, found = trial.follow(scene, o, d)
    hits, p = found[0], points[0] - centre
    foot = o - centre - dot(o - centre, unit(d))[:, None] * unit(d)
    depth_here = 1 - np.sqrt(dot(foot, foot))
    # The direction turns the ray by 2 u over 3 radii; origin, centre and the steps to the foot: 16 u with room.
    inside, outside = depth_here > 16 * U, depth_here < -16 * U
    off_ray = p - dot(p, unit(d))[:, None] * unit(d) - foot
    off_ray, off_ball = np.sqrt(dot(off_ray, off_ray)), np.abs(1 - np.sqrt(dot(p, p)))
    # The foot rounds 6 times, of 3 radii, the point 2; the direction, a unit vector, 2 over 3 radii: on both sides. Off
    # the ball it is 8.5 v (radius + distance), by the radicand, and what is compared with it another 6 of the point.
    met = hits & (depth_here > 40 * V)  # past the outline, by what the search rounds, there is no ball
    outcome = shares(
        ("rays inside the outline that miss", (inside & ~hits).sum(), max(1, inside.sum())),
        ("rays outside that hit", (outside & hits).sum(), outside.sum()),
        ("points off the ray by more than 52 v", (hits & ~(off_ray <= 52 * V)).sum(), hits.sum()),
        ("points off the ball by more than 40 v", (met & ~(off_ball <= 40 * V)).sum(), max(1, met.sum())),
    )
    furthest = {"ray": off_ray[hits].max(initial=0.0) / V, "ball": off_ball[met].max(initial=0.0) / V}
    return replace(outcome, values=outcome.values | {f"furthest off the {k}, v": float(v) for k, v in furthest.items()})
