"""A ray with its errors, and what these may make it meet or miss."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from whitted_reference.instances import Placed
from whitted_reference.margins import Place, passing
from whitted_reference.shapes import Cylinder, Primitive, Sphere
from whitted_reference.vectors import Vec, dot
from whitted_validation.forms import length
from whitted_validation.patch import matrices
from whitted_validation.rounding import Ray
from whitted_validation.roundoffs import EDGE_TEST, QUADRATIC_TEST, TO_LIGHT, TRANSFORMED, U


@dataclass
class Beam:
    """A ray with its errors, between its ends; `end_off` is how far the end itself may be off."""

    e: Vec
    d: Vec
    errors: Ray
    start: float
    end: float
    end_off: float

    def may_turn(self, primitive: Primitive, wall: int) -> bool:
        """Tell whether float32 may decide otherwise: about the outline (wall 0), or one place (1, 2)."""
        near = passing(primitive, self.e, self.d)
        if near is None:
            return True  # seen edge-on
        if wall == 0:
            size = math.dist(primitive.box[:3], primitive.box[3:])
            return any(
                abs(near.distance) <= self.aside(primitive, place.t)
                and self.start - size <= place.t <= self.end + self.end_off + size
                for place in near.places
            )
        place = near.places[wall - 1]
        along = self._along(primitive, place)
        at_end = abs(place.t - self.start) <= along or abs(place.t - self.end) <= along + self.end_off
        return at_end or abs(place.distance) <= self.aside(primitive, place.t)

    def first_place(self, primitive: Primitive) -> float:
        """Return the least distance at which the ray may meet the primitive, made to meet it or not."""
        near = passing(primitive, self.e, self.d)
        if near is None:
            return -math.inf
        places = [(place.t, self._along(primitive, place)) for place in near.places]
        return min((t - along for t, along in places if t + along >= self.start), default=math.inf)

    def along(self, primitive: Primitive) -> float:
        """Bound how far the first meeting is off along the ray."""
        near = passing(primitive, self.e, self.d)
        places = near.places if near else ()
        return next((self._along(primitive, place) for place in places if self.start <= place.t <= self.end), math.inf)

    def _along(self, primitive: Primitive, place: Place) -> float:
        """Bound how far a meeting is off along the ray."""
        t = place.t
        p = (self.e[0] + t * self.d[0], self.e[1] + t * self.d[1], self.e[2] + t * self.d[2])
        cosine = abs(dot(primitive.normals(self.e, self.d, t, p)[1], self.d))
        return 8 * U * abs(t) + (self.aside(primitive, t) / cosine if cosine > 0.0 else math.inf)

    def aside(self, primitive: Primitive, t: float) -> float:
        """Bound how far the ray is off across itself at distance t, and the test of the primitive with it.

        Skewed axes make the coordinates on a disk inexact; but so much shorter is its smaller half-axis, in which its
        margin is measured (`margins`).
        """
        e_form, d_form = self.errors.e, self.errors.d
        moved = np.zeros((3, max(e_form.shape[1], d_form.shape[1])))
        moved[:, : e_form.shape[1]] = e_form
        moved[:, : d_form.shape[1]] += t * d_form
        low, high = np.array(primitive.box[:3], float), np.array(primitive.box[3:], float)
        size = float(np.linalg.norm(high - low))
        at = float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high)))) + math.hypot(*self.e)
        aside = length(moved) + self.errors.offset + EDGE_TEST * (abs(t) + size) + TRANSFORMED * at
        aside += TO_LIGHT * abs(t)  # the direction of a search: at worst one to a light
        inner = primitive
        if isinstance(primitive, Placed):
            inner = primitive.primitive
            if isinstance(inner, Sphere):  # of an ellipsoid the ray is brought inside: there and back
                _, inverse = matrices(primitive)
                spread = float(np.linalg.norm(np.abs(np.linalg.inv(inverse)) @ np.abs(inverse), 2))
                aside += TRANSFORMED * at * (spread - 1.0)
            else:  # a vertex, or each number of a matrix, is put into world space in float64 and rounded once
                aside += U * at
        if isinstance(inner, Cylinder):
            aside += QUADRATIC_TEST * (abs(t) + size) ** 2 / math.sqrt(float(inner.data[7]))
        return aside if math.isfinite(aside) else math.inf
