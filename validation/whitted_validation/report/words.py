"""Verdicts in words."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from whitted_validation.printable import named
from whitted_validation.verdict import Difference, Status

# As `Alternative.reasons` writes them; ids come from files and may hold anything.
_REASON = re.compile(r"(?P<kind>.+?) of `(?P<shape>.*?)`(?:, light `(?P<light>.*)`)?, bounce (?P<k>\d+)", re.DOTALL)
_HORIZON = "horizon n.l = 0"
MOST_PLACES = 3


def of_everything(scenes: Sequence[Mapping[str, Any]], refused: int, complete: bool) -> str:
    """Say in a sentence what came out of all scenes."""
    if len(scenes) == 1 and not refused and complete:
        return str(scenes[0]["sentence"])
    totals = {name: sum(s["pixels"][name] for s in scenes) for name in ("equal", "explained", "unexplained")}
    pixels = sum(totals.values())
    where = _many(len(scenes), "scene")
    said = f"{_agreeing(totals['equal'], pixels)} in {where}" if scenes else "No scene is judged yet"
    if totals["explained"]:
        said += f"; {_differ(totals['explained'])} where rounding may turn a decision"
    if totals["unexplained"]:
        bad = sum(s["pixels"]["unexplained"] > 0 for s in scenes)
        said += f"; {_many(totals['unexplained'], 'pixel')} of {_many(bad, 'scene')} differ without an explanation"
    if refused:
        said += f"; {_many(refused, 'scene')} not judged"
    return said + ("." if complete else "; not all scenes are done.")


def of_scene(scene: Mapping[str, Any], differences: Sequence[Difference]) -> str:
    """Say in a sentence what came out of one scene: how many pixels agree, and where the others lie."""
    counts = scene["pixels"]
    pixels = sum(counts.values())
    said = _agreeing(counts["equal"], pixels)
    explained = [d for d in differences if d.status == Status.EXPLAINED]
    if explained:
        places = Counter(place(d.reasons[0]) for d in explained).most_common()
        if len(places) == 1:
            share = {1: "", 2: "both "}.get(len(explained), "all ")
            said += f"; {_differ(len(explained))}, {share}{places[0][0]}"
        else:
            named = [f"{count:,} {where}" for where, count in places[:MOST_PLACES]]
            rest = sum(count for _, count in places[MOST_PLACES:])
            said += f"; {_differ(len(explained))}: " + ", ".join(named + [f"{rest:,} elsewhere"] * (rest > 0))
    if counts["unexplained"]:
        said += f"; {_differ(counts['unexplained'])} without an explanation"
        said += "" if scene["against"] else ": a fault in one of the two programs"
    return said + "."


def place(reason: str) -> str:
    """Say where a decision falls that rounding may turn, such as: on the shadow edge of `ball` from `key_light`."""
    match = _REASON.fullmatch(reason)
    if match is None:
        return f"by “{reason}”"
    kind, shape, light, k = match["kind"], named(match["shape"]), named(match["light"]), int(match["k"])
    mirrored = "" if k == 0 else " seen in a mirror" if k == 1 else f" seen over {k} mirrors"
    if kind == "facing":
        return f"where {shape} turns its back to the ray{mirrored}"
    if kind == "mirror":
        return f"where the mirror ray grazes {shape}{mirrored}"
    if kind == _HORIZON:
        return f"where {shape} turns away from {light}{mirrored}"
    if kind.startswith("spot cone of "):
        return f"on {shape} at the rim of the cone of {named(kind.removeprefix('spot cone of '))}{mirrored}"
    if match["light"] is not None:
        edge = "shadow edge" if kind == "silhouette" else f"shadow edge ({kind})"
        return f"on the {edge} of {shape} from {light}{mirrored}"
    if kind == "silhouette":
        return f"on the outline of {shape}{mirrored}"
    return f"on {'an' if kind[0] in 'aeiou' else 'a'} {kind} of {shape}{mirrored}"


def why(difference: Difference, finite: bool = True) -> str:
    """Answer a student's question: why the two differ here; `finite` tells whether A is made of numbers."""
    if not finite:
        return "Unexplained. A is infinite or no number here; the reference is finite."
    if difference.status == Status.UNEXPLAINED:
        tried = difference.alternatives - 1
        looked = (
            "no yes/no decision on the way of this pixel is close enough for rounding to turn it"
            if tried <= 0
            else f"{_many(tried, 'other way')} to decide within rounding {'was' if tried == 1 else 'were'} tried, and "
            "none gives A's colour"
        )
        again = f" B was computed again in {difference.settled_by}, and stands." if difference.settled_by else ""
        whole = "" if difference.complete else " (the search stopped at its limit)"
        return f"Unexplained. A and B differ by more than rounding may make of this pixel, and {looked}{whole}.{again}"
    if any(_REASON.fullmatch(reason) for reason in difference.reasons):
        where = ", and ".join(place(reason) for reason in difference.reasons)
        return (
            f"This pixel lies {where}, so close that float32 rounding decides whether it is on one side or the other. "
            "A has the colour that the reference finds on the other side."
        )
    return f"Explained: {'; '.join(difference.reasons)}."


def _agreeing(equal: int, pixels: int) -> str:
    if equal == pixels:
        return f"All {pixels:,} pixels agree within their bound"
    share = equal * 10_000 // pixels / 100  # rounded down: 100 % is said of all alone
    return f"{share:.2f} % of {pixels:,} pixels agree within their bound"


def _differ(count: int) -> str:
    return f"{count:,} differs" if count == 1 else f"{count:,} differ"


def _many(count: int, what: str) -> str:
    return f"{count:,} {what}" if count == 1 else f"{count:,} {what}s"
