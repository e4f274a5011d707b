"""Probes in double precision: directions, rotations, and rays met by spheres and planes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def dot(a: Array, b: Array) -> Array:
    """Multiply vectors along the last axis."""
    product: Array = np.sum(a * b, axis=-1)
    return product


def unit(v: Array) -> Array:
    """Normalise vectors along the last axis."""
    return np.asarray(v / np.sqrt(dot(v, v))[..., None])


def single(x: Any) -> Array:
    """Round to float32, as the scene's numbers and the probes are."""
    return np.asarray(x, np.float32).astype(np.float64)


def directions(rng: np.random.Generator, count: int) -> Array:
    """Draw unit vectors uniformly."""
    return unit(rng.normal(size=(count, 3)))


def about(axis: Array, cosine: Array, rng: np.random.Generator) -> Array:
    """Draw unit vectors at a given cosine to `axis`, in any direction about it."""
    w = rng.normal(size=(len(cosine), 3))
    w = unit(w - dot(w, axis)[:, None] * axis)
    return cosine[:, None] * axis + np.sqrt(1 - cosine**2)[:, None] * w


def rotation(axis: tuple[float, float, float], angle: float) -> Array:
    """Return Rodrigues' matrix; `angle` in radians."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


GENERAL = rotation((1, 2, 3), 1.0)
"""A rotation that puts nothing along an axis."""


def affine(linear: Array, translation: Any = (0, 0, 0)) -> str:
    """Write a matrix for a scene file; every digit that a double has."""
    rows = [[*linear[i], np.asarray(translation, float)[i]] for i in range(3)]
    numbers = " ".join(repr(float(x)) for row in rows for x in row)
    return f'<matrix value="{numbers} 0 0 0 1"/>'


def triple(v: Any) -> str:
    """Write a point or colour for a scene file."""
    return ", ".join(repr(float(x)) for x in v)


def meet_sphere(o: Array, d: Array, c: Array, r: float, far: bool = False) -> tuple[Array, Array]:
    """Return the outward unit normals at the hit, and the cosine there between ray and normal (NaN: missed)."""
    oc = o - c
    foot = oc - dot(oc, d)[:, None] * d
    foot -= dot(foot, d)[:, None] * d
    with np.errstate(invalid="ignore"):
        half = np.sqrt(r * r - dot(foot, foot))
    n = (foot + (half if far else -half)[:, None] * d) / r
    return n, half / r


def meet_plane(o: Array, d: Array, a: Array, n: Array) -> tuple[Array, Array]:
    """Return where rays meet the plane through `a` with unit normal `n`, and the distance t."""
    t = dot(a - o, n) / dot(d, n)
    return o + t[:, None] * d, t


def plane_of(shape: Any) -> tuple[Array, Array, Array]:
    """Return origin, unit normal and the columns (3, 3) of a rectangle's matrix, as the reference has rounded it."""
    m = np.array(shape.to_world.matrix)
    n = np.cross(m[:, 0], m[:, 1])
    return m[:, 3], unit(n), m[:, :3]


def inside_rectangle(p: Array, shape: Any, within: float = 1.0) -> NDArray[np.bool_]:
    """Tell which points of its plane lie in a rectangle, made smaller by the factor `within`."""
    m = np.array(shape.to_world.matrix)
    xy, *_ = np.linalg.lstsq(m[:, :2], (p - m[:, 3]).T, rcond=None)
    return np.asarray((np.abs(xy) < within).all(axis=0))
