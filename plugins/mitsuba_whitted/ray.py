"""A ray, and what it meets first."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

NOTHING = 2**32 - 1
"""Row of no shape."""


class Ray(NamedTuple):
    """The points o + s d with begin < s < end, but for the surface that the ray leaves.

    Origin and direction are in double: a hit is computed from them. A search takes them `rounded`.
    """

    o: Any
    d: Any
    """Unit length."""
    begin: Any
    end: Any
    shift: Any
    """From `o` to where a search that cannot leave out a surface begins."""
    own: Any
    """Row of the shape that the ray leaves: it cannot be met again where the ray begins."""

    def rounded(self) -> Ray:
        """Round origin and direction to single precision."""
        return self._replace(o=mi.Point3f(self.o), d=mi.Vector3f(self.d))

    def from_shifted(self) -> tuple[mi.Ray3f, Any]:
        """Make, of a rounded ray, that which begins at the shifted origin, and say how much further along it begins."""
        lead = dr.dot(self.shift, self.d)
        return mi.Ray3f(self.o + self.shift, self.d, mi.Float(self.end - lead), 0, []), lead


class Found(NamedTuple):
    """Which primitive a ray meets first, as far as the search has come."""

    valid: Any
    t: Any
    """Distance from the true origin, right to a few u; the end of the ray while nothing was met."""
    shape: Any
    """Row of the shape."""
    instance: Any
    """Number of the instance that placed it, counted from 1; 0 for none."""
    face: Any
    """Number of the triangle in its mesh."""

    @staticmethod
    def nothing(ray: Ray) -> Found:
        """Begin a search."""
        zero = mi.UInt32(0)
        return Found(mi.Bool(False), mi.Float(ray.end), zero, zero, zero)

    def or_nearer(self, nearer: Any, t: Any, shape: Any, instance: Any = 0, face: Any = 0) -> Found:
        """Go on with another primitive where that is nearer."""
        return Found(
            self.valid | nearer,
            dr.select(nearer, t, self.t),
            dr.select(nearer, mi.UInt32(shape), self.shape),
            dr.select(nearer, mi.UInt32(instance), self.instance),
            dr.select(nearer, mi.UInt32(face), self.face),
        )
