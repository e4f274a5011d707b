"""Shapes so few that the kernel tries them one by one: no search, no offset, no epsilon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.precise import UNIT_ROUNDOFF
from mitsuba_whitted.ray import Found, Ray
from mitsuba_whitted.shapes import PLANES, Kind, Row
from mitsuba_whitted.tables import column, fetch

MOST_ALONE = 8
"""So many spheres, rectangles and disks are tried one by one where a scene holds nothing else.

Measured: as fast as Embree at 8 to 16, three times faster at 6 (`whitted benchmark speed`).
"""

MOST_FLAT = 6
"""So many rectangles and disks are tried one by one beside Embree, whose scene is better off without them."""

CLOSED = 1 + 16 * UNIT_ROUNDOFF
"""How far out a rectangle or disk is met, in units of its own half side: its edge belongs to it.

The coordinates of a point on it carry at most 16 roundings (the point 5, the difference 1, two products of three
5 each): where two sides of a box meet, no ray slips through between them.
"""


def few_of(rows: Sequence[Row], instanced: bool) -> list[int]:
    """Choose the shapes that the kernel tries one by one, by their numbers."""
    flat = [i for i, row in enumerate(rows) if row.kind in PLANES]
    alone = [i for i, row in enumerate(rows) if row.kind in {*PLANES, Kind.SPHERE}]
    if len(alone) == len(rows) <= MOST_ALONE and not instanced:
        return alone
    return flat if len(flat) <= MOST_FLAT and not instanced else []


class Few:
    """Spheres, rectangles and disks of a scene, each with its number in the scene's tables."""

    def __init__(self, rows: dict[int, Row]) -> None:
        self.numbers = list(rows)
        self._kinds = {number: row.kind for number, row in rows.items()}
        self._place = {number: i for i, number in enumerate(rows)}
        self._rows = column([*row.a, *row.b, *row.to_local[0], *row.to_local[1], row.r] for row in rows.values())
        self.casters = set(rows)
        """Numbers of those that can block a light: see `casters`."""

    def first(self, ray: Ray, found: Found, active: Any) -> Found:
        """Try all of them, and go on with the nearest."""
        for number in self.numbers:
            meets, t = self._meet(number, ray, found.t)
            found = found.or_nearer(active & meets, t, number)
        return found

    def blocked(self, ray: Ray, active: Any) -> Any:
        """Whether one of them lies on the ray."""
        blocked = mi.Bool(False)
        for number in self.numbers:
            if number in self.casters:
                blocked |= self._meet(number, ray, ray.end)[0]
        return active & blocked

    def described(self, numbers: set[int]) -> tuple[str, ...]:
        """Say how many of each kind these are."""
        kinds = [self._kinds[number] for number in self.numbers if number in numbers]
        return tuple(f"{kinds.count(kind)} {kind.name.lower()}" for kind in Kind if kind in kinds)

    def _meet(self, number: int, ray: Ray, end: Any) -> tuple[Any, Any]:
        """Whether the ray meets this shape before `end`, and the distance."""
        meet = self._meet_sphere if self._kinds[number] == Kind.SPHERE else self._meet_flat
        meets, t = meet(number, ray)
        return meets & (t < end), t

    def _meet_flat(self, number: int, ray: Ray) -> tuple[Any, Any]:
        """Meet a plane inside a rectangle or disk (Shirley et al. 2009, section 4.4.3)."""
        a, n, x_axis, y_axis = (self._vector(number, i) for i in range(4))
        off = a - ray.o
        t = dr.dot(off, n) * dr.rcp(dr.dot(ray.d, n))
        on_plane = dr.fma(t, ray.d, -off)
        x, y = dr.dot(on_plane, x_axis), dr.dot(on_plane, y_axis)
        if self._kinds[number] == Kind.RECTANGLE:
            inside = dr.maximum(dr.abs(x), dr.abs(y)) <= CLOSED
        else:
            inside = dr.fma(x, x, y * y) <= CLOSED**2
        return inside & (t > ray.begin) & (ray.own != number), t

    def _meet_sphere(self, number: int, ray: Ray) -> tuple[Any, Any]:
        """Meet a sphere, by the foot of the perpendicular from its centre: see `precise.sphere_normal`.

        A ray that leaves the sphere itself has one root where it begins, which is dropped, and the other at 2 b.
        """
        c, r = self._vector(number, 0), self._number(number, 12)
        oc = ray.o - c
        b = -dr.dot(oc, ray.d)
        foot = dr.fma(b, ray.d, oc)
        half_chord_2 = dr.fma(r, r, -dr.squared_norm(foot))
        half_chord = dr.sqrt(dr.maximum(half_chord_2, 0))
        leaves = ray.own == number
        near = b - half_chord
        t = dr.select((near > ray.begin) & (leaves ^ True), near, b + half_chord)
        return (half_chord_2 >= 0) & dr.select(leaves, b > 0, t > ray.begin), t

    def _vector(self, number: int, i: int) -> Any:
        return mi.Vector3f(*(self._number(number, 3 * i + j) for j in range(3)))

    def _number(self, number: int, i: int) -> Any:
        return fetch(mi.Float, self._rows, 13 * self._place[number] + i)
