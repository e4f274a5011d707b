"""The ray tree as headed lists of values, to be shown in a terminal or on a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from mitsuba_whitted.seen import LightSeen, Numbers, RaySeen, SampleSeen
from whitted_validation.explanation.closeness import Closeness
from whitted_validation.explanation.comparison import Pair, Ray, light_pair, paired, status
from whitted_validation.printable import named

MOST_LIGHTS = 12
"""So many lights of a hit are listed; of a hundred, those that add most."""


@dataclass
class Branch:
    """A heading, and what stands under it: values, remarks, further branches.

    Attributes
    ----------
    tone : `light`, `dark` or empty: whether it adds anything
    """

    title: str
    tone: str = ""
    items: list[Pair | Branch | str] = field(default_factory=list)


def tree_of(plugin: SampleSeen, reference: SampleSeen, closeness: Closeness) -> list[Branch]:
    """Return one branch for each ray, from the camera on."""
    totals = {id(ray): total for side in (plugin, reference) for ray, total in _totals(side)}
    branches = []
    for ray in paired(plugin, reference):
        branch = Branch(_title(ray))
        branch.items += [ray.pair("from", "o"), ray.pair("along", "d")]
        if ray.any.shape is not None or len({side.shape for _, side in ray.sides}) > 1:
            branch.items += [ray.pair("distance t", "t"), ray.pair("hit point p", "p"), ray.pair("normal n", "n")]
        branch.items += list(_shading(ray, closeness))
        branch.items += [f"close: {call.words}" for call in closeness.of_hit(ray.any)]
        branch.items.append(
            Pair("sum so far", *(None if side is None else totals[id(side)] for side in (ray.plugin, ray.reference)))
        )
        branches.append(branch)
    return branches


def _totals(sample: SampleSeen) -> Iterator[tuple[RaySeen, Numbers]]:
    """Yield each ray with what has been gathered up to it; the last sum is the colour itself."""
    total: Numbers = (0.0,) * len(sample.colour)
    for ray in sample.rays:
        total = tuple(t + w * c for t, w, c in zip(total, ray.throughput, ray.colour or total, strict=True))
        yield ray, sample.colour if ray is sample.rays[-1] else total


def _title(ray: Ray) -> str:
    origin = "from the camera" if ray.any.k == 0 else "mirrored"
    ends = [(name, _end(side)) for name, side in ray.sides]
    if len({end for _, end in ends}) == 1:
        alone = "" if len(ends) == 2 else f" (only in the {ends[0][0]})"
        return f"ray {ray.any.k}, {origin}: {ends[0][1]}{alone}"
    return f"ray {ray.any.k}, {origin}: " + "; ".join(f"{name} {end}" for name, end in ends)


def _end(ray: RaySeen) -> str:
    if ray.shape is None:
        return "meets nothing"
    return f"meets {named(ray.shape)}" + ("" if ray.facing else " from behind")


def _shading(ray: Ray, closeness: Closeness) -> Iterator[Pair | Branch | str]:
    sides = [side for _, side in ray.sides]
    if any(any(side.emitted) for side in sides):
        yield ray.pair("background" if ray.any.shape is None else "emitted", "emitted")
    if any(side.lit for side in sides):
        yield ray.pair("ambient k_a I_a", "ambient")
        for name in ("k_d", "k_s"):
            if any(any(getattr(side, name)) for side in sides):
                yield ray.pair(name, name)
        lights = ray.lights
        if len(lights) > MOST_LIGHTS:
            lights = sorted(lights, key=lambda pair: -sum((pair[1] or pair[0]).colour))  # type: ignore[union-attr]
            yield f"the {MOST_LIGHTS} strongest of {len(lights)} lights:"
        for ours, theirs in lights[:MOST_LIGHTS]:
            yield _light(ray, ours, theirs, closeness)
        yield ray.pair("this point", "colour")
        if any(any(side.k_m) for side in sides):
            yield ray.pair("mirror k_m", "k_m")
            yield ray.pair("mirrored along r", "r")
    if ray.any.k:
        yield ray.pair("weight (all k_m)", "throughput")


def _light(ray: Ray, ours: LightSeen | None, theirs: LightSeen | None, closeness: Closeness) -> Branch:
    seen = [(side, light) for side, light in ((ray.plugin, ours), (ray.reference, theirs)) if side and light]
    fates = [status(hit, light) for hit, light in seen]
    side, light = seen[-1]  # the ray of this program has met something here, which the other's may have missed
    if len(set(fates)) == 1:
        words = f"is in the shadow of {named(light.blocked_by)}" if fates[0] == "is blocked" else fates[0]
        title = f"light {named(light.id)} {words}"
    else:
        title = f"light {named(light.id)}: plugin: {fates[0]}; reference: {fates[1]}"
    shines = "shines here" in fates
    branch = Branch(title, "light" if shines else "dark")

    def row(label: str, name: str) -> Pair:
        return light_pair(ours, theirs, label, name)

    branch.items.append(row("to the light l", "l"))
    if light.distance < float("inf"):
        branch.items.append(row("distance", "distance"))
    branch.items.append(row("n.l", "n_l"))
    if shines:
        branch.items.append(row("light arriving I", "irradiance"))
        branch.items.append(row("k_d I (n.l)", "diffuse"))
        if any(any(hit.k_s) for hit, _ in seen):
            branch.items += [row("half vector h", "h"), row("n.h", "n_h")]
            branch.items.append(row(f"k_s I (n.h)^{side.exponent:g}", "specular"))
        branch.items.append(row("adds", "colour"))
    if shines or "is blocked" in fates:
        branch.items += [f"close: {call.words}" for call in closeness.of_light(side, light)]
    return branch


def alike(samples: Sequence[tuple[SampleSeen, SampleSeen]]) -> list[list[int]]:
    """Sort samples by what their rays meet and which lights they see; the most frequent first."""
    groups: dict[object, list[int]] = {}
    for i, pair in enumerate(samples):
        path = tuple(
            (ray.shape, ray.facing, tuple((light.id, light.visible) for light in ray.lights))
            for side in pair
            for ray in side.rays
        )
        groups.setdefault(path, []).append(i)
    return sorted(groups.values(), key=len, reverse=True)
