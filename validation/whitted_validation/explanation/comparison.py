"""The two programs side by side: which ray and which light belong together, and how far apart numbers are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mitsuba_whitted.seen import LightSeen, Numbers, RaySeen, SampleSeen
from whitted_validation.printable import named


@dataclass(frozen=True)
class Pair:
    """A number, vector or colour in both programs; None where one of them never came that far."""

    label: str
    plugin: Numbers | None
    reference: Numbers | None

    @property
    def sides(self) -> list[tuple[str, Numbers]]:
        """The values that there are, each with the name of its program."""
        return [(name, value) for name, value in (("plugin", self.plugin), ("reference", self.reference)) if value]

    @property
    def ulps(self) -> float:
        """Distance in units in the last place of float32, at the largest component of either."""
        if self.plugin is None or self.reference is None:
            return math.nan
        a, b = np.broadcast_arrays(np.array(self.plugin, float), np.array(self.reference, float))
        different = a != b  # infinities of one sign are equal
        if not different.any():
            return 0.0
        largest = np.float32(max(np.abs(a).max(), np.abs(b).max(), np.finfo(np.float32).tiny))
        unit = float(np.spacing(largest)) if np.isfinite(largest) else math.inf
        apart = float(np.abs(a - b)[different].max())
        return apart / unit if np.isfinite(apart) else apart


@dataclass(frozen=True)
class Ray:
    """One ray of both programs, or of one alone."""

    plugin: RaySeen | None
    reference: RaySeen | None

    @property
    def any(self) -> RaySeen:
        """The one to be told of where both are alike: the reference's."""
        ray = self.reference or self.plugin
        assert ray is not None
        return ray

    @property
    def sides(self) -> list[tuple[str, RaySeen]]:
        """Both, each with the name of its program."""
        return [(name, ray) for name, ray in (("plugin", self.plugin), ("reference", self.reference)) if ray]

    def pair(self, label: str, name: str) -> Pair:
        """Put one of the values side by side."""
        ours, theirs = (_numbers(ray, name) for ray in (self.plugin, self.reference))
        return Pair(label, ours, theirs)

    @property
    def lights(self) -> list[tuple[LightSeen | None, LightSeen | None]]:
        """Both programs' lights by their ids, in the order of the scene."""
        ours = {light.id: light for light in (self.plugin.lights if self.plugin else [])}
        theirs = {light.id: light for light in (self.reference.lights if self.reference else [])}
        return [(ours.get(name), theirs.get(name)) for name in (theirs or ours)]


def light_pair(ours: LightSeen | None, theirs: LightSeen | None, label: str, name: str) -> Pair:
    """Put one of the values of a light side by side."""
    return Pair(label, _numbers(ours, name), _numbers(theirs, name))


def _numbers(owner: object | None, name: str) -> Numbers | None:
    value = None if owner is None else getattr(owner, name)
    if isinstance(value, float):
        return (value,) if value < math.inf or math.isnan(value) else None  # nothing was met there
    return value or None


def paired(plugin: SampleSeen, reference: SampleSeen) -> list[Ray]:
    """Pair the rays of a sample until one program meets something else; from there on each goes alone."""
    together: list[Ray] = []
    for ours, theirs in zip(plugin.rays, reference.rays, strict=False):
        together.append(Ray(ours, theirs))
        if ours.shape != theirs.shape:
            break
    alone = len(together)
    return [
        *together,
        *(Ray(ray, None) for ray in plugin.rays[alone:]),
        *(Ray(None, ray) for ray in reference.rays[alone:]),
    ]


def fate(ray: RaySeen) -> str:
    """Say what became of a ray, in a way that two programs can be compared by."""
    if ray.shape is None:
        return "meets nothing"
    if not ray.facing:
        return "meets it from behind"
    return "meets its front" if ray.lit else "meets it at the depth limit"


def status(ray: RaySeen, light: LightSeen) -> str:
    """Say what a light does at a hit, likewise."""
    if light.distance == 0:
        return "is at this very point"
    if not any(light.irradiance):
        return "shines elsewhere"
    if light.n_l <= 0 or light.n_g_l <= 0:
        return "is behind the surface"
    if not any((*ray.k_d, *ray.k_s)):
        return "is not reflected"
    return "shines here" if light.visible else "is blocked"


def partings(rays: list[Ray]) -> Iterator[str]:
    """Yield every decision that the programs take differently, in the order of tracing."""
    for ray in rays:
        ours, theirs = ray.plugin, ray.reference
        if ours is None or theirs is None:
            continue
        where = f"ray {ray.any.k}"
        if ours.shape != theirs.shape:
            yield f"{where}: the plugin meets {named(ours.shape)}, the reference {named(theirs.shape)}"
            continue
        if fate(ours) != fate(theirs):
            yield f"{where} at {named(ours.shape)}: the plugin {fate(ours)}, the reference {fate(theirs)}"
        for one, other in ray.lights:
            if one and other and status(ours, one) != status(theirs, other):
                yield (
                    f"{where} at {named(ours.shape)}: for the plugin {named(one.id)} {status(ours, one)}, "
                    f"for the reference it {status(theirs, other)}"
                )
        if ours.goes_on != theirs.goes_on and (any(theirs.k_m) or any(ours.k_m)):
            who = "plugin" if ours.goes_on else "reference"
            yield f"{where} at {named(ours.shape)}: only the {who} follows the mirror ray"


def values(rays: Sequence[Ray]) -> list[tuple[str, float]]:
    """List every value that both programs have, in the order of tracing: its name, and how many ulp they are apart."""
    found = []
    for ray in rays:
        pairs = [ray.pair(label, name) for label, name in _VALUES]
        for ours, theirs in ray.lights:
            if ours and theirs:
                pairs += [light_pair(ours, theirs, f"{label} of {named(theirs.id)}", name) for label, name in _OF_LIGHT]
        found += [(f"{pair.label} of ray {ray.any.k}", pair.ulps) for pair in pairs if not math.isnan(pair.ulps)]
    return found


def growth(apart_by: Sequence[tuple[str, float]]) -> str:
    """Name the value whose error exceeds all before it by the greatest factor."""
    largest, steps = 1.0, []
    for where, apart in apart_by:
        steps.append((apart / largest, f"The error grows most at {where}: from {largest:.2g} to {apart:.2g} ulp."))
        largest = max(largest, apart)
    return max(steps)[1]


_VALUES = [
    ("o", "o"),
    ("d", "d"),
    ("t", "t"),
    ("p", "p"),
    ("n", "n"),
    ("k_a I_a", "ambient"),
    ("k_d", "k_d"),
    ("k_s", "k_s"),
]
_OF_LIGHT = [
    ("l", "l"),
    ("n.l", "n_l"),
    ("k_d I (n.l)", "diffuse"),
    ("n.h", "n_h"),
    ("k_s I (n.h)^p", "specular"),
    ("colour", "colour"),
]
