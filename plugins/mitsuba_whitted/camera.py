"""Camera rays through the centres of an n x n grid of sub-pixels, from the sensor's own numbers."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.precise import LEAST, UNIT_ROUNDOFF, rcp
from mitsuba_whitted.ray import NOTHING, Ray
from mitsuba_whitted.scene_graph import Node, Stamp, number, read, recorder
from mitsuba_whitted.shapes import Row
from mitsuba_whitted.tables import opaque
from mitsuba_whitted.transforms import matrix_of

SCALE_TOLERANCE = 1e-3
"""How far from 1 the scale of a camera's to_world may be: Mitsuba measures its clip planes in camera units."""


_CLOSED = 4 * UNIT_ROUNDOFF
"""Clip planes belong to what is seen, but rays are open at both ends; their distances carry four roundings."""


class Camera:
    """Turns positions on the film into rays by section 4 of the model.

    The constants are computed in float64 and stored as data: moving the camera recompiles nothing. Mitsuba's
    own rays are used only for sensors that are neither `perspective` nor `orthographic`; they lose digits
    (their origin is the rounded point on the near plane).

    Parameters
    ----------
    sensor : Sensor
        Of a scene.
    centre : (3,) array
        Where rays have their origin of coordinates: `Surfaces.centre`.

    Raises
    ------
    SceneError
        If to_world is singular or not finite, or that of a perspective camera scales by anything but 1.
    """

    def __init__(self, sensor: mi.Sensor, centre: NDArray[np.float64]) -> None:
        self._sensor = sensor
        self._centre = centre
        self._film = sensor.film()
        self._values = Node()
        sensor.traverse(recorder(self._values))
        self._stamp = Stamp([(where, kind, sensor) for where, kind in self._values.values.values()])
        self._window = self._film_window()
        self.kind = sensor.class_name()
        self.known = self.kind in ("PerspectiveCamera", "OrthographicCamera")
        if self.known:
            self._constants = self._affine_map()

    def follows(self, sensor: mi.Sensor, centre: NDArray[np.float64]) -> bool:
        """Whether this camera still is what `sensor` says."""
        same = sensor is self._sensor and bool((centre == self._centre).all())
        return same and self._stamp.is_current() and self._window == self._film_window()

    def is_outside(self, balls: list[Row]) -> bool:
        """Whether every ray begins to see outside of all these balls, as far as the camera is known."""
        if not self.known or not balls:
            return self.known
        off = np.array([ball.a for ball in balls]) - self._eye
        distances = np.linalg.norm(off, axis=1) if self.kind == "PerspectiveCamera" else off @ self._forward
        return bool((distances - [ball.r for ball in balls] > self._blind).all())

    def rays(self, x: Any, y: Any) -> Ray:
        """Make the rays through `x`, `y`: Float or Float64, pixels from the upper left corner of the crop window."""
        if not self.known:
            return self._rays_of_mitsuba(x, y)
        centre, per_x, per_y, eye, forward, x0_y0_near, far = self._constants
        dx, dy = mi.Float64(x) - x0_y0_near.x, mi.Float64(y) - x0_y0_near.y
        on_plane = mi.Vector3d(dr.fma(dx, per_x, dr.fma(dy, per_y, centre)))
        if self.kind == "OrthographicCamera":
            return camera_ray(mi.Point3d(eye + on_plane), forward, 0, far)
        length = dr.norm(on_plane)  # of the direction whose component along the camera's z is 1
        d = on_plane * rcp(length)
        return camera_ray(mi.Point3d(eye), d, mi.Float(x0_y0_near.z * length), far * mi.Float(length))

    def _affine_map(self) -> tuple[Any, ...]:
        """Constants of the direction, or of the origin, as an affine function of the position on the film."""
        name = f"sensor `{self._sensor.id()}`"
        matrix = matrix_of(self._read("to_world"), name)
        scales = np.linalg.norm(matrix[:3, :3], axis=0)
        if self.kind == "PerspectiveCamera" and np.any(np.abs(scales - 1) > SCALE_TOLERANCE):
            raise SceneError(f"{name}: to_world scales by {scales.tolist()}; allowed is a scale of 1")
        width, height, crop_x, crop_y = self._window
        near, far = self._read("near_clip"), self._read("far_clip")
        eye = matrix[:3, 3] - self._centre
        if self.kind == "PerspectiveCamera":
            half = np.tan(np.deg2rad(number(self._read("x_fov"))) / 2)  # T of the model
            principal = [number(self._read(f"principal_point_offset_{axis}")) for axis in "xy"]
            centre = matrix[:3, 2]
        else:
            half, principal = 1.0, [0.0, 0.0]
            centre = matrix[:3, 2] * near
            far = far - near
        per_x = matrix[:3, 0] * (-2 * half / width)
        per_y = matrix[:3, 1] * (-2 * half / width)  # pixels are square: T H / W over H
        middle_x = width * (0.5 - principal[0]) - crop_x
        middle_y = height * (0.5 - principal[1]) - crop_y
        forward = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        corners = [centre + (x - middle_x) * per_x + (y - middle_y) * per_y for x in (0, width) for y in (0, height)]
        longest = max(np.linalg.norm(corners, axis=1)) if self.kind == "PerspectiveCamera" else 1.0
        self._eye, self._forward, self._blind = eye, forward, near * longest
        vectors = (centre, per_x, per_y, eye, forward)
        on_film = _opaque(mi.Vector3d, (middle_x, middle_y, near)), _opaque(mi.Float, [far])
        return *(_opaque(mi.Vector3d, vector) for vector in vectors), *on_film

    def _film_window(self) -> list[int]:
        """Size of the film, and where its crop window begins."""
        return [int(number) for number in (*self._film.size(), *self._film.crop_offset())]

    def _rays_of_mitsuba(self, x: Any, y: Any) -> Ray:
        size = self._film.crop_size()
        position = mi.Point2f(mi.Float(x) / size[0], mi.Float(y) / size[1])
        try:
            ray, _ = self._sensor.sample_ray(mi.Float(0), mi.Float(0.5), position, mi.Point2f(0.5))
        except RuntimeError as error:  # an irradiance meter, say, has no rays of its own
            raise SceneError(f"sensor `{self._sensor.id()}`: {self.kind} is not handled: {error}") from None
        return any_ray(ray, mi.Vector3f(*self._centre.tolist()))

    def _read(self, name: str) -> Any:
        return read(*self._values.values[name], self._sensor)


def camera_ray(o: Any, d: Any, near: Any, far: Any) -> Ray:
    """Make the ray that sees from `near` to `far`, both included."""
    begin = near * (1 - _CLOSED) - LEAST
    return Ray(
        o, d, mi.Float(begin), mi.Float(far * (1 + _CLOSED)), mi.Vector3f(begin * mi.Vector3f(d)), mi.UInt32(NOTHING)
    )


def any_ray(ray: mi.Ray3f, origin: Any) -> Ray:
    """Make ours of a ray of Mitsuba's, relative to `origin`; its direction may have any length."""
    d = mi.Vector3d(ray.d)
    length = dr.norm(d)
    o = mi.Point3d(mi.Point3d(ray.o) - mi.Vector3d(origin))
    return camera_ray(o, d * rcp(length), 0, ray.maxt * mi.Float(length))


def _opaque(kind: Any, values: Any) -> Any:
    return opaque(kind(*(float(value) for value in values)))
