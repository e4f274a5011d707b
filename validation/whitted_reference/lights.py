"""Lights without extent: what arrives at a point, and from where (Mitsuba's emitters)."""

from __future__ import annotations

from whitted_reference import scene
from whitted_reference.arithmetic import Arithmetic
from whitted_reference.transforms import inverse_linear
from whitted_reference.vectors import BLACK, Colour, Number, Vec

# Unit vector towards the light, its distance, and the colour that arrives where nothing blocks it.
Arrival = tuple[Number, Number, Number, Number, Colour]


class Directional:
    """Light of constant irradiance from infinitely far away."""

    def __init__(self, light: scene.DirectionalLight, arithmetic: Arithmetic) -> None:
        self.id = light.id
        x, y, z = arithmetic.vec(light.direction)
        length = arithmetic.sqrt(x * x + y * y + z * z)
        colour: Colour = arithmetic.vec(light.irradiance)
        self._arrival: Arrival = (-x / length, -y / length, -z / length, arithmetic.infinity, colour)

    def arrive(self, x: Number, y: Number, z: Number) -> Arrival | None:
        """Return the same everywhere."""
        return self._arrival


class Point:
    """Light from one position; I = intensity / distance^2, or the intensity itself without falloff."""

    def __init__(self, light: scene.PointLight | scene.SpotLight, falloff: bool, arithmetic: Arithmetic) -> None:
        self.id = light.id
        self.position: Vec = arithmetic.vec(light.position)
        self._intensity: Colour = arithmetic.vec(light.intensity)
        self.falloff = falloff
        self._sqrt = arithmetic.sqrt

    def arrive(self, x: Number, y: Number, z: Number) -> Arrival | None:
        """Return what arrives at (x, y, z): exactly at the light nothing, from nowhere."""
        lx, ly, lz = self.position
        red, green, blue = self._intensity
        lx -= x
        ly -= y
        lz -= z
        squared = lx * lx + ly * ly + lz * lz
        if squared == 0:
            return 0, 0, 0, 0, BLACK
        distance = self._sqrt(squared)
        if self.falloff:
            red /= squared
            green /= squared
            blue /= squared
        return lx / distance, ly / distance, lz / distance, distance, (red, green, blue)


class Spot(Point):
    """A point light times f, linear in the angle theta to the local +z axis between beam and cutoff."""

    def __init__(self, light: scene.SpotLight, falloff: bool, arithmetic: Arithmetic) -> None:
        super().__init__(light, falloff, arithmetic)
        self.to_local = [[arithmetic.ratio(x) for x in row] for row in inverse_linear(light.to_world.matrix)]
        self.cutoff = arithmetic.of(light.cutoff_angle)
        self.beam = arithmetic.of(light.beam_width)
        self._atan2 = arithmetic.atan2

    def angle(self, lx: Number, ly: Number, lz: Number) -> Number:
        """Return theta of the direction (-lx, -ly, -lz) away from the light."""
        x, y, z = (-(a * lx + b * ly + c * lz) for a, b, c in self.to_local)
        return self._atan2(self._sqrt(x * x + y * y), z)

    def share(self, theta: Number) -> Number:
        """Return f(theta)."""
        if theta <= self.beam:
            return 1
        if theta < self.cutoff:
            return (self.cutoff - theta) / (self.cutoff - self.beam)
        return 0

    def arrive(self, x: Number, y: Number, z: Number) -> Arrival | None:
        """Return what arrives at (x, y, z); None outside the cone."""
        arrival = super().arrive(x, y, z)
        if arrival is None or arrival[3] == 0:
            return arrival
        lx, ly, lz, distance, (red, green, blue) = arrival
        f = self.share(self.angle(lx, ly, lz))
        if f == 0:
            return None
        return lx, ly, lz, distance, (f * red, f * green, f * blue)


Light = Directional | Point


def prepare(light: scene.Light, settings: scene.Settings, arithmetic: Arithmetic) -> Light:
    """Build the light that a description asks for."""
    if isinstance(light, scene.DirectionalLight):
        return Directional(light, arithmetic)
    if isinstance(light, scene.SpotLight):
        return Spot(light, settings.falloff, arithmetic)
    return Point(light, settings.falloff, arithmetic)
