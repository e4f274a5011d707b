"""What is seen along the rays of one pixel, as plain numbers: see `explain`."""

from __future__ import annotations

from dataclasses import dataclass, field

Numbers = tuple[float, ...]
"""A vector (x, y, z), or a colour with as many channels as the variant has; each is a float32."""


@dataclass(frozen=True)
class LightSeen:
    """One light as seen from one hit point.

    Attributes
    ----------
    id : of the emitter
    l, distance : unit vector towards the light; world units, infinite for a directional light
    irradiance : I, the light that arrives where nothing blocks it
    h : unit half vector (v + l) / |v + l|
    n_l, n_g_l, n_h : the cosines n.l, n_g.l and n.h
    above : whether the light is above the horizon and the surface reflects it at all
    visible : whether it adds its colour: it is above, and not blocked
    blocked_by : id of the shape that blocks it, the one next to the surface; None if none was found
    diffuse, specular : k_d I (n.l) and k_s I (n.h)^p, if it were visible
    colour : what is added: the sum of the two, or 0
    """

    id: str
    l: Numbers  # noqa: E741  # the textbook's letter
    distance: float
    irradiance: Numbers
    h: Numbers
    n_l: float
    n_g_l: float
    n_h: float
    above: bool
    visible: bool
    blocked_by: str | None
    diffuse: Numbers
    specular: Numbers
    colour: Numbers


@dataclass
class RaySeen:
    """One ray, what it meets, and what that adds; what the kernel leaves out keeps its default.

    Attributes
    ----------
    k : number of mirrors before
    o, d : origin, world units, and unit direction
    throughput : product of k_m over the mirrors before
    shape : id of the shape that is met, after that of an instance and a slash where there is one; None for none
    t, p : distance and hit point, world units
    n, n_g : unit shading and geometric normal, turned if the back of a two-sided surface is met
    facing : whether that side may be seen at all
    lit : whether it is, and the depth allows its light to be followed
    emitted, ambient : emission or background; k_a I_a
    k_d, k_s, exponent, k_m : coefficients at the point
    lights : one entry a light, in the kernel's order
    colour : what this ray adds, before the mirror and without the throughput
    r : direction of the mirror ray
    goes_on : whether the mirror ray is followed
    """

    k: int
    o: Numbers
    d: Numbers
    throughput: Numbers
    shape: str | None = None
    t: float = float("inf")
    p: Numbers = ()
    n: Numbers = ()
    n_g: Numbers = ()
    facing: bool = False
    lit: bool = False
    emitted: Numbers = ()
    ambient: Numbers = ()
    k_d: Numbers = ()
    k_s: Numbers = ()
    exponent: float = 0.0
    lights: list[LightSeen] = field(default_factory=list)
    colour: Numbers = ()
    k_m: Numbers = ()
    r: Numbers = ()
    goes_on: bool = False


@dataclass(frozen=True)
class SampleSeen:
    """One sample of a pixel: its rays from the camera on, and its colour."""

    rays: list[RaySeen]
    colour: Numbers


@dataclass(frozen=True)
class PixelSeen:
    """All samples of a pixel, row by row, and their mean: with a box filter, the pixel of the picture."""

    samples: list[SampleSeen]
    colour: Numbers
