"""From a place on the film to a ray (Shirley et al. 2009, section 4.3; Mitsuba's conventions)."""

from __future__ import annotations

import math

from whitted_reference import scene
from whitted_reference.arithmetic import Arithmetic
from whitted_reference.vectors import Number, Vec


class Camera:
    """Looks along the local +z axis, with +x to the left and +y up.

    Attributes
    ----------
    eye : image of the local origin
    perspective : whether all rays pass through the eye
    """

    def __init__(self, sensor: scene.Sensor, arithmetic: Arithmetic) -> None:
        self._rows = [arithmetic.vec(row) for row in sensor.to_world.matrix]
        self.eye: Vec = arithmetic.vec(sensor.to_world.column(3))
        self._film = sensor.film
        self._of = arithmetic.of
        self._sqrt = arithmetic.sqrt
        self._before = arithmetic.before
        self._principal = arithmetic.vec(sensor.principal)
        self._near, self._far = arithmetic.of(sensor.near), arithmetic.of(sensor.far)
        self.perspective = sensor.x_fov is not None
        # The tangent is computed once in double precision and is an exact input from here on.
        half_width = 1.0 if sensor.x_fov is None else math.tan(math.radians(0.5 * sensor.x_fov))
        self._half_width = arithmetic.of(half_width)

    def ray(self, x: int, y: int, i: int = 0, j: int = 0, grid: int = 1) -> tuple[Vec, Vec, Number, Number]:
        """Return the ray through sample (i, j) of a grid x grid pattern in pixel (x, y) of the picture.

        Returns
        -------
        e, d : origin on the near plane, and unit direction
        start, end : distances start < t <= end lie between the near and far planes, both included
        """
        film, of = self._film, self._of
        s, t = of(2 * i + 1) / (2 * grid), of(2 * j + 1) / (2 * grid)
        fx = (film.crop_x + x + s) / film.width + self._principal[0]
        fy = (film.crop_y + y + t) / film.height + self._principal[1]
        cx = (1 - 2 * fx) * self._half_width
        cy = (1 - 2 * fy) * self._half_width * film.height / film.width
        near, depth = self._near, self._far - self._near
        if self.perspective:
            e = self._world((cx * near, cy * near, near), 1)
            d = self._world((cx, cy, 1), 0)
        else:
            e = self._world((cx, cy, near), 1)
            d = self._world((0, 0, 1), 0)
        length = self._sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        end = depth * length if self.perspective else depth
        return e, (d[0] / length, d[1] / length, d[2] / length), self._before(of(0)), end

    def _world(self, v: Vec, w: int) -> Vec:
        x, y, z = v
        a, b, c = (m0 * x + m1 * y + m2 * z + m3 * w for m0, m1, m2, m3 in self._rows)
        return a, b, c
