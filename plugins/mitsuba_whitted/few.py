"""Shapes so few that the kernel tries them one by one: no search, no offset, no epsilon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from mitsuba_whitted.precise import UNIT_ROUNDOFF
from mitsuba_whitted.ray import Found, Ray
from mitsuba_whitted.shapes import PLANES, Kind, Row
from mitsuba_whitted.tables import opaque

MOST_ALONE = 8
"""So many spheres, rectangles and disks are tried one by one where a scene holds nothing else.

Measured: as fast as Embree at 8 to 16, three times faster at 6 (`whitted benchmark speed`).
"""

MOST_FLAT = 2
"""So many rectangles and disks are tried one by one beside Embree: a floor, or a floor and a wall.

A floor is large, and slows the search for all else. More than two cost each ray as much as they save (measured on
random scenes, `whitted benchmark speed`).
"""

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


class _Numbers(NamedTuple):
    """Place and size of a shape, as data of the kernel: see `shapes.Row`."""

    a: Any
    b: Any
    x_axis: Any
    y_axis: Any
    r: Any

    @staticmethod
    def of(row: Row) -> _Numbers:
        """Take them from a row."""
        a, b, x_axis, y_axis = (mi.Vector3f(*vector.tolist()) for vector in (row.a, row.b, *row.to_local[:2]))
        return _Numbers(*opaque([a, b, x_axis, y_axis, mi.Float(row.r)]))


class Few:
    """Spheres, rectangles and disks of a scene, each with its number in the scene's tables."""

    def __init__(self, rows: dict[int, Row]) -> None:
        self.numbers = list(rows)
        self._kinds = {number: row.kind for number, row in rows.items()}
        self._numbers = {number: _Numbers.of(row) for number, row in rows.items()}
        self.casters = set(rows)
        """Numbers of those that can block a light: see `casters`."""

    def first(self, ray: Ray, found: Found, active: Any, inside: bool) -> Found:
        """Try all of them, and go on with the nearest; `inside` says whether a ray may begin inside a ball."""
        for number in self.numbers:
            meets, t = self._meet(number, ray, inside)
            found = found.or_nearer(active & meets & (t < found.t), t, number)
        return found

    def blocked(self, ray: Ray, active: Any, inside: bool) -> Any:
        """Whether one of them lies on the ray."""
        blocked = mi.Bool(False)
        for number in self.numbers:
            if number not in self.casters:
                continue
            if self._kinds[number] == Kind.SPHERE and not inside:
                # Both ends are outside: the middle of the chord lies between them just where all of it does.
                b, half_chord_2 = self._chord(number, ray)
                blocked |= (half_chord_2 >= 0) & (b > 0) & (b < ray.end) & (ray.own != number)
            else:
                meets, t = self._meet(number, ray, inside)
                blocked |= meets & (t < ray.end)
        return active & blocked

    def described(self, numbers: set[int]) -> tuple[str, ...]:
        """Say how many of each kind these are."""
        kinds = [self._kinds[number] for number in self.numbers if number in numbers]
        return tuple(f"{kinds.count(kind)} {kind.name.lower()}" for kind in Kind if kind in kinds)

    def _meet(self, number: int, ray: Ray, inside: bool) -> tuple[Any, Any]:
        """Whether the ray meets this shape after it begins, and the distance."""
        if self._kinds[number] != Kind.SPHERE:
            return self._meet_flat(number, ray)
        return self._meet_sphere(number, ray) if inside else self._meet_sphere_from_outside(number, ray)

    def _meet_flat(self, number: int, ray: Ray) -> tuple[Any, Any]:
        """Meet a plane inside a rectangle or disk (Shirley et al. 2009, section 4.4.3)."""
        a, n, x_axis, y_axis, _ = self._numbers[number]
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
        """Meet a sphere.

        A ray that leaves the sphere itself has one root where it begins, which is dropped, and the other at 2 b.
        """
        b, half_chord_2 = self._chord(number, ray)
        half_chord = dr.sqrt(dr.maximum(half_chord_2, 0))
        leaves = ray.own == number
        near = b - half_chord
        t = dr.select((near > ray.begin) & (leaves ^ True), near, b + half_chord)
        return (half_chord_2 >= 0) & dr.select(leaves, b > 0, t > ray.begin), t

    def _meet_sphere_from_outside(self, number: int, ray: Ray) -> tuple[Any, Any]:
        """Meet a sphere where every ray begins outside of it, or on it.

        Its centre is then ahead. That is asked instead of the distance, which rounding makes negative where the
        ray begins at a contact.
        """
        b, half_chord_2 = self._chord(number, ray)
        return (half_chord_2 >= 0) & (b > 0) & (ray.own != number), b - dr.sqrt(dr.maximum(half_chord_2, 0))

    def _chord(self, number: int, ray: Ray) -> tuple[Any, Any]:
        """Distance to the middle of the chord, and half its length squared: see `precise.sphere_normal`."""
        c, r = self._numbers[number].a, self._numbers[number].r
        oc = ray.o - c
        b = -dr.dot(oc, ray.d)
        foot = dr.fma(b, ray.d, oc)
        return b, dr.fma(r, r, -dr.squared_norm(foot))
