"""Shadow acne: points in the light that a ray's own surface turns dark. All bodies here are alone and convex.

Of a convex body exactly those points are lit that have the light above their horizon. A probe is too close to
call where n.l is within the error of a float32 tracer that makes no mistake but rounding: u = 2^-24,

    m = u (16 + 4 D / (size cos)) + 8 u (D / cos + reach) / distance to the light

for the normal and both dot products (16 roundings); for the ray, whose direction is normalised again (2 u, over
the distance D, stretched by 1 / cos where it meets the surface at a slant); and for the point and its coordinates,
which turn l.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import whitted_reference
from whitted_validation.stress.case import Case, Outcome, U, log_uniform, shares
from whitted_validation.stress.geometry import (
    GENERAL,
    Array,
    about,
    affine,
    dot,
    meet_plane,
    meet_sphere,
    single,
    triple,
    unit,
)
from whitted_validation.stress.trial import Trial

Mask = NDArray[np.bool_]

PROBES = 1_000_000

HEAD = """<scene version="3.0.0"><integrator type="whitted"><integer name="max_depth" value="2"/>
<string name="falloff" value="none"/></integrator><sensor type="perspective"/>
<bsdf type="blinnphong" id="white"><float name="diffuse_reflectance" value="1"/></bsdf>
"""
"""Direct light of constant strength on white: the colour is n.l where it is lit, and 0 where it is not."""

SMALLEST_COSINE = 0.05  # of the view: grazing views are a case of their own


def cases() -> Iterator[Case]:
    """List them."""
    for scale in (1e-6, 1e-3, 1.0, 1e3, 1e6):
        yield _sphere(f"sphere, scale {scale:g}", scale=scale)
    yield _sphere("sphere, seen from 100 radii", distance=100.0)
    yield _sphere("sphere, seen from 10 000 radii", distance=1e4)
    yield _sphere("sphere, 1000 radii off the origin", offset=1e3)
    for scale in (1e-6, 1e-3, 1.0, 1e3, 1e6):
        yield _triangles(f"triangles, scale {scale:g}", scale=scale)
    yield _triangles("triangles, seen from 100 sizes", distance=100.0)
    yield _triangles("triangles, 1000 sizes off the origin", offset=1e3)


def _sphere(name: str, **where: float) -> Case:
    statement = "points of a ball with the light above their horizon are lit, all others are dark"
    return Case("shadow acne", name, statement, lambda trial: _tried(trial, lambda: _on_sphere(trial, **where)))


def _triangles(name: str, **where: float) -> Case:
    statement = "points of an icosahedron with the light above their horizon are lit, all others are dark"
    return Case("shadow acne", name, statement, lambda trial: _tried(trial, lambda: _on_icosahedron(trial, **where)))


@dataclass(frozen=True)
class Probes:
    """Rays, and what is known of the points that they meet.

    Attributes
    ----------
    o, d : (n, 3) float32 numbers
    lit, dark : for each light, which has a colour channel of its own: (n,) whether a point must be so
    """

    file: Path
    o: Array
    d: Array
    lit: list[Mask]
    dark: list[Mask]


def _tried(trial: Trial, make: Callable[[], Probes]) -> Outcome:
    probes: Probes = trial.once(make)
    seen = trial.look(trial.load(probes.file), probes.o, probes.d)
    black = sum(int((lit & ~(seen[:, i] > 0)).sum()) for i, lit in enumerate(probes.lit))
    bright = sum(int((dark & ~(seen[:, i] == 0)).sum()) for i, dark in enumerate(probes.dark))
    return shares(
        ("lit points black", black, sum(int(lit.sum()) for lit in probes.lit)),
        ("dark points lit", bright, sum(int(dark.sum()) for dark in probes.dark)),
    )


def margin(distance: Array | float, size: float, cosine: Array, reach: float, to_light: Array) -> Array:
    """Return the n.l that rounding may turn: see the top of this file."""
    ray = np.asarray(distance) / cosine
    return np.asarray(U * (16 + 4 * ray / size) + 8 * U * (ray + reach) / to_light)


def _on_sphere(trial: Trial, scale: float = 1.0, distance: float = 3.0, offset: float = 0.0) -> Probes:
    rng, count = trial.random(), trial.count(PROBES)
    centre = single(np.array([1.0, -2.0, 1.5]) * offset * scale)
    radius = float(single(scale))
    toward = unit(np.array([0.3, 0.8, -0.5]))
    lamp = single(centre + 10 * radius * toward)
    file = trial.write(
        f"""{HEAD}<shape type="sphere" id="ball"><point name="center" value="{triple(centre)}"/>
        <float name="radius" value="{radius!r}"/><ref id="white"/></shape>
        <emitter type="point"><point name="position" value="{triple(lamp)}"/></emitter></scene>"""
    )
    # n.l is 0 where the cosine to the lamp's direction is 1/10: most probes are close to that, on either side.
    height = log_uniform(rng, 1e-6, 0.85, count) * np.where(rng.random(count) < 0.9, 1, -1)
    n = about(toward, 0.1 + height, rng)
    v = _seen_from(n, rng)
    o = single(centre + radius * (n + distance * v))
    d = single(unit(centre + radius * n - o))
    n, cosine = meet_sphere(o, unit(d), centre, radius)
    p = centre + radius * n
    to_light = lamp - p
    n_l = dot(n, unit(to_light))
    known = cosine > SMALLEST_COSINE / 2
    doubt = margin(
        distance * radius, radius, cosine, float(np.abs(centre).max()) + radius, np.sqrt(dot(to_light, to_light))
    )
    return Probes(file, o, d, [known & (n_l > doubt)], [known & (n_l < -doubt)])


def _on_icosahedron(trial: Trial, scale: float = 1.0, distance: float = 3.0, offset: float = 0.0) -> Probes:
    rng, count = trial.random(), trial.count(PROBES)
    at = np.array([1.0, -2.0, 1.5]) * offset * scale
    mesh = f"""<shape type="obj" id="solid"><string name="filename" value="meshes/icosahedron.obj"/>
        <boolean name="face_normals" value="true"/>
        <transform name="to_world">{affine(scale * GENERAL, at)}</transform><ref id="white"/></shape>"""
    # Where the lights are: one anywhere, and two just above the plane of the first face, each in its own channel.
    first = np.array([[0, 1, -1.61803399], [0, -1, -1.61803399], [-1.61803399, 0, -1]]) @ GENERAL.T * scale + at
    up, middle = unit(np.cross(first[1] - first[0], first[2] - first[0])), first.mean(axis=0)
    up = up if up @ (middle - at) > 0 else -up
    along = unit(first[0] - middle)
    lamps = [single(x) for x in (middle + scale * (7 * up + 5 * along), middle + scale * (9 * along + 1e-2 * up),
                                 middle - scale * (9 * along - 1e-4 * up))]  # fmt: skip
    lights = "".join(
        f'<emitter type="point"><point name="position" value="{triple(lamp)}"/>'
        f'<rgb name="intensity" value="{triple(np.eye(3)[i])}"/></emitter>'
        for i, lamp in enumerate(lamps)
    )
    file = trial.write(f"{HEAD}{mesh}{lights}</scene>")
    solid: Any = whitted_reference.load(file).shapes[0]
    corners = np.array(solid.vertices)[np.array(solid.faces)]
    face = np.where(rng.random(count) < 0.5, 0, rng.integers(len(corners), size=count))  # faces lie in file order
    corners = corners[face]
    normal = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    weights = rng.dirichlet((0.5, 0.5, 0.5), count)  # many near edges
    q = np.einsum("nk,nkc->nc", weights, corners)
    v = _seen_from(normal, rng)
    o = single(q + distance * scale * v)
    d = single(unit(q - o))
    p, _ = meet_plane(o, unit(d), corners[:, 0], normal)
    cosine = -dot(unit(d), normal)
    reach = float(np.abs(corners).max())
    # How far inside its triangle the point lies: less, and the neighbour may be met.
    room = np.min([_height(p, corners[:, i], corners[:, (i + 1) % 3], normal) for i in range(3)], axis=0)
    known = room > 16 * U * (distance * scale / cosine + reach)
    probes = Probes(file, o, d, [], [])
    for lamp in lamps:
        to_light = lamp - p
        length = np.sqrt(dot(to_light, to_light))
        n_l = dot(normal, to_light) / length
        doubt = margin(distance * scale, scale, cosine, reach, length)
        probes.lit.append(known & (n_l > doubt))
        probes.dark.append(known & (n_l < -doubt))
    return probes


def _height(p: Array, a: Array, b: Array, normal: Array) -> Array:
    """Return how far points lie inside the edge from a to b."""
    inward = np.cross(normal, unit(b - a))
    return dot(p - a, inward)


def _seen_from(n: Array, rng: np.random.Generator) -> Array:
    """Draw directions on the side of `n`, at all angles but the grazing ones."""
    cosine = rng.uniform(SMALLEST_COSINE, 1.0, len(n))
    w = rng.normal(size=n.shape)
    w = unit(w - dot(w, n)[:, None] * n)
    return np.asarray(cosine[:, None] * n + np.sqrt(1 - cosine**2)[:, None] * w)
