"""What happened to one sample, in words: why the pixel has this colour, or none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mitsuba_whitted.seen import LightSeen, Numbers, RaySeen, SampleSeen
from whitted_reference.scene import Settings
from whitted_validation.explanation.comparison import status
from whitted_validation.printable import named

MOST_NAMED = 3
"""So many names stand in one sentence; of the others it says how many there are."""

FIRST_RAYS = 4
"""Of a long chain of mirrors so many rays are told of one by one, and the last."""

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue (Rec. ITU-R BT.709)."""


def story(sample: SampleSeen, settings: Settings) -> list[str]:
    """Tell the fate of a sample, one sentence or two for each ray."""
    told = []
    middle = sample.rays[FIRST_RAYS:-1] if len(sample.rays) > FIRST_RAYS + 2 else []
    for ray in sample.rays:
        if ray in middle:
            if ray is middle[0]:
                met = _names(list(dict.fromkeys(r.shape for r in middle if r.shape is not None)))
                share = _share(middle, sample.colour)
                told.append(f"{len(middle)} more mirror rays meet {met}.{share}")
            continue
        told.append(" ".join(_of_ray(ray, settings)) + _share([ray], sample.colour))
    return told


def _share(rays: Sequence[RaySeen], colour: Numbers) -> str:
    """Say how much of the colour comes from where these rays end; nothing if that is all of it, or none."""
    whole = _brightness(colour)
    part = sum(_brightness([a * b for a, b in zip(ray.throughput, ray.colour, strict=True)]) for ray in rays)
    if not whole or not part or (rays[0].k == 0 and not rays[0].goes_on):
        return ""
    percent = 100 * part / whole
    return f" That is {'less than 1' if percent < 1 else f'{percent:.0f}'} % of the colour."


def _brightness(colour: Sequence[float]) -> float:
    if len(colour) == 1:
        return colour[0]
    return sum(weight * channel for weight, channel in zip(LUMINANCE, colour, strict=True))


def _of_ray(ray: RaySeen, settings: Settings) -> Iterator[str]:
    who = "The ray" if ray.k == 0 else "Its mirror ray" if ray.k == 1 else f"Mirror ray {ray.k}"
    limited = settings.max_depth >= 0
    if limited and ray.k + 1 > settings.max_depth:
        met = "meets nothing" if ray.shape is None else f"meets {named(ray.shape)}"
        yield f"{who} {met}, but max_depth = {settings.max_depth} lets nothing be seen here."
        return
    if ray.shape is None:
        sky = "sees the background" if any(ray.emitted) else "there is no background, so this is black"
        yield f"{who} meets nothing and {sky}." if any(ray.emitted) else f"{who} meets nothing: {sky}."
        return
    if not ray.facing:
        yield f"{who} meets {named(ray.shape)} from behind, and a one-sided surface is black there."
        return
    yield f"{who} meets {named(ray.shape)}."
    if any(ray.emitted):
        yield "It glows by itself."
    if not ray.lit:
        yield f"No light is followed to it, nor its mirror: max_depth = {settings.max_depth} is the limit."
        return
    yield from _of_lights(ray)
    if any(ray.ambient) and not any(light.visible and any(light.colour) for light in ray.lights):
        yield "Ambient light only."
    if not any(ray.ambient):
        yield "No ambient light." if not any(settings.ambient) else "It reflects no ambient light."
    if any(ray.k_m) and not ray.goes_on:
        yield "Its mirror ray is not followed: it would lead into the surface, or carry nothing."


def _of_lights(ray: RaySeen) -> Iterator[str]:
    if not any((*ray.k_d, *ray.k_s)):
        if not any(ray.ambient) and not any(ray.k_m) and not any(ray.emitted):
            yield "It reflects no light at all."
        return
    if not ray.lights:
        yield "There is no light that could shine on it."
        return
    by_fate: dict[tuple[str, str | None], list[LightSeen]] = {}
    for light in ray.lights:
        fate = status(ray, light)
        by_fate.setdefault((fate, light.blocked_by if fate == "is blocked" else None), []).append(light)
    for (fate, blocker), lights in sorted(by_fate.items(), key=lambda item: _ORDER.index(item[0][0])):
        names = _names([light.id for light in lights])
        match fate:
            case "shines here":
                yield f"Lit by {names}."
            case "is blocked":
                yield f"In the shadow of {named(blocker)} from {names}."
            case "is behind the surface":
                yield f"Facing away from {names}."
            case "shines elsewhere":
                yield f"Outside the light of {names}."
            case _:
                yield f"{names} {fate}."


_ORDER = [
    "shines here",
    "is blocked",
    "is behind the surface",
    "shines elsewhere",
    "is at this very point",
    "is not reflected",
]


def _names(ids: Sequence[str]) -> str:
    shown = [named(name) for name in ids[:MOST_NAMED]]
    more = len(ids) - len(shown)
    if more:
        shown.append(f"{more} more")
    return shown[0] if len(shown) == 1 else ", ".join(shown[:-1]) + f" and {shown[-1]}"
