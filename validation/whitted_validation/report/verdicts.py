"""What `whitted validate` writes.

results.json of validate, after the keys of all commands (see the package):
    exit        0 if every pixel of every scene is equal or explained, 1 if not, 2 if a scene was not judged
    complete    false while scenes are still missing, and after an interruption
    sentence    the verdict in words
    scenes      one object a scene, in the order in which they were judged:
        name, file, variant, against, grid, width, height, seconds, sentence
        pixels      equal, explained, unexplained: numbers of pixels
        certified   what vouches for B and its bound: rounding, noise, interval, decimal (numbers of pixels)
        chaotic     number of pixels where most draws decide otherwise: beyond float32
        loose       numbers of pixels with a bound above what a coefficient off by 1e-3 changes, by why it is:
                    texture, grazing, mirrors
        error       median, largest: of |A - B| over all pixels, worst channel
        bound       median, largest
        by_bounce   one object for each number of mirrors on the way of the pixel's middle: bounces, pixels, unequal,
                    median, largest (error), ratio (largest of error / bound), errors (numbers of pixels: no error,
                    then one for each of DECADES, the last one open)
        differences the pixels that are not equal, unexplained ones first, the largest error first, at most
                    MOST_LISTED: x, y, status, error, bound, reasons, told (why, in words), alternatives, complete,
                    settled_by (the arithmetic in which B was computed again, or empty)
    not_judged  one object a scene: scene, why
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_validation.bounds import Cause, Means
from whitted_validation.explanation.page import STYLE
from whitted_validation.report.charts import Bars
from whitted_validation.report.page import write
from whitted_validation.report.pair import pair
from whitted_validation.report.sections import Cell, Group, Markup, Section, Sentence, Table
from whitted_validation.report.viewer import Viewer
from whitted_validation.report.words import of_everything, of_scene, why
from whitted_validation.seen import Seen
from whitted_validation.validation import Verdict
from whitted_validation.verdict import Difference, Status

MOST_LISTED = 1000
DECADES = range(-10, 1)  # errors are counted by powers of ten: below 1e-10, 1e-10 to 1e-9, ..., from 1 on
MOST_LAYERS = 5  # numbers of bounces told apart in the chart

_MEANS = {
    Means.ROUNDING: "by the rounding model",
    Means.NOISE: "by draws within rounding",
    Means.INTERVAL: "by the rounding model, B by intervals",
    Means.DECIMAL: "by the rounding model, B to forty digits",
}
_CAUSES = {
    Cause.NONE: "",
    Cause.TEXTURE: "; loose, for its texture is steep",
    Cause.GRAZING: "; loose, for a ray grazes or comes from afar",
    Cause.MIRRORS: "; loose, for errors grow from mirror to mirror",
}
BOUND_TEXTS = [_MEANS[means] + _CAUSES[cause] for means in Means for cause in Cause]

Refused = Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Judged:
    """A scene on the page.

    Attributes
    ----------
    explained : {"x,y": HTML}: the rays of a pixel drawn, for those that are most likely to be asked about
    """

    verdict: Verdict
    seen: Seen
    explained: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def facts(self) -> dict[str, Any]:
        """What results.json says of the scene."""
        return _scene(self.verdict, self.seen)

    @cached_property
    def shown(self) -> str:
        """What the page shows of it: made once, though the page is written again after each scene."""
        return "".join(section.html() for section in _about(self))


def exit_code(verdicts: Sequence[Verdict], refused: Refused) -> int:
    """Return 1 if a pixel is unexplained, else 2 if a scene was refused, else 0."""
    return 1 if not all(verdict.good for verdict in verdicts) else 2 if refused else 0


def write_verdicts(folder: Path, scenes: Sequence[Judged], refused: Refused, complete: bool) -> None:
    """Write the report of `whitted validate`.

    Raises
    ------
    Refusal
        If the folder cannot be written to.
    """
    facts = results(scenes, refused, complete)
    write(folder, facts, "whitted validate", sections(facts, scenes), STYLE)


def results(scenes: Sequence[Judged], refused: Refused, complete: bool) -> dict[str, Any]:
    """Return what results.json holds of these scenes."""
    facts = [scene.facts for scene in scenes]
    return {
        "exit": exit_code([scene.verdict for scene in scenes], refused),
        "complete": complete,
        "sentence": of_everything(facts, len(refused), complete),
        "scenes": facts,
        "not_judged": [{"scene": scene, "why": reason} for scene, reason in refused],
    }


def _scene(verdict: Verdict, seen: Seen) -> dict[str, Any]:
    judgement, bounds = verdict.judgement, verdict.judgement.bounds
    error, bound = error_of(verdict), bounds.bound.max(axis=2)
    height, width = judgement.status.shape
    facts = {
        "name": verdict.scene.stem,
        "file": str(verdict.scene),
        "variant": verdict.variant,
        "against": verdict.against,
        "grid": verdict.grid,
        "width": width,
        "height": height,
        "seconds": round(verdict.seconds, 2),
        "pixels": {status.name.lower(): judgement.count(status) for status in Status},
        "certified": {means.name.lower(): int((bounds.means == means).sum()) for means in Means},
        "chaotic": int(bounds.chaotic.sum()),
        "loose": {cause.name.lower(): int((bounds.cause == cause).sum()) for cause in Cause if cause},
        "error": {"median": float(np.median(error)), "largest": float(error.max())},
        "bound": {"median": float(np.median(bound)), "largest": float(bound.max())},
        "by_bounce": [_bounce(verdict, error, seen.bounces == k, int(k)) for k in np.unique(seen.bounces)],
        "differences": [_difference(d, error[d.y, d.x]) for d in judgement.differences[:MOST_LISTED]],
    }
    return {"sentence": of_scene(facts, judgement.differences), **facts}


def _bounce(verdict: Verdict, error: NDArray[np.float64], there: NDArray[np.bool_], k: int) -> dict[str, Any]:
    judgement, chosen = verdict.judgement, error[there]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(judgement.picture - judgement.bounds.colour)[there] / judgement.bounds.bound[there]
    edges = [0.0, np.nextafter(0.0, 1.0), *(10.0**power for power in DECADES), np.inf]
    counts = [int(((low <= chosen) & (chosen < high)).sum()) for low, high in pairwise(edges)]
    counts[-1] += int(np.isinf(chosen).sum())
    return {
        "bounces": k,
        "pixels": int(there.sum()),
        "unequal": int((judgement.status[there] != Status.EQUAL).sum()),
        "median": float(np.median(chosen)),
        "largest": float(chosen.max()),
        "ratio": float(np.where(np.isnan(ratio), 0.0, ratio).max()),
        "errors": counts,
    }


def _difference(d: Difference, largest: float) -> dict[str, Any]:
    finite = bool(np.isfinite(largest))
    return {
        "x": d.x,
        "y": d.y,
        "status": d.status.name.lower(),
        "error": d.error if finite else largest,
        "bound": d.bound,
        "reasons": list(d.reasons),
        "told": why(d, finite),
        "alternatives": d.alternatives,
        "complete": d.complete,
        "settled_by": d.settled_by,
    }


def error_of(verdict: Verdict) -> NDArray[np.float64]:
    """Return |A - B| of the worst channel, (height, width); infinite where A is no number."""
    error = np.abs(verdict.judgement.picture - verdict.judgement.bounds.colour).max(axis=2)
    return np.where(np.isfinite(error), error, np.inf)


def sections(facts: Mapping[str, Any], scenes: Sequence[Judged]) -> list[Section]:
    """Return the page: the verdict, a table with the worst scene first, and each scene with its viewer."""
    worst_first = sorted(
        zip(facts["scenes"], scenes, _titles([scene.verdict for scene in scenes]), strict=True),
        key=lambda scene: (-scene[0]["pixels"]["unexplained"], -scene[0]["pixels"]["explained"], -_ratio(scene[0])),
    )
    page: list[Section] = [Sentence(facts["sentence"], "bad" if facts["exit"] else "good" if facts["complete"] else "")]
    page += [Sentence(f"Not judged: {item['scene']}. {item['why']}", "bad") for item in facts["not_judged"]]
    if worst_first:
        page.append(_table([(scene, title) for scene, _, title in worst_first]))
    for scene, judged, title in worst_first:
        note = scene["sentence"] if scene["sentence"] != facts["sentence"] else ""
        page.append(Group(title, [Markup(judged.shown)], note))
    return page


def _ratio(scene: Mapping[str, Any]) -> float:
    return max(float(bounce["ratio"]) for bounce in scene["by_bounce"])


def _titles(verdicts: Sequence[Verdict]) -> list[str]:
    """Name the scenes by their files' names, and by their paths where those are alike."""
    stems = [verdict.scene.stem for verdict in verdicts]
    return [
        verdict.scene.stem if stems.count(verdict.scene.stem) == 1 else f"{verdict.scene} ({place})"
        for place, verdict in enumerate(verdicts, 1)
    ]


def _table(scenes: Sequence[tuple[Mapping[str, Any], str]]) -> Table:
    columns = ["scene", "size", "unexplained", "explained", "equal", "median error", "largest error"]
    columns += ["largest error / bound", "loose", "seconds"]
    rows = []
    for scene, title in scenes:
        pixels = scene["pixels"]
        rows.append(
            [
                Cell(title, to=title),
                f"{scene['width']}\N{NO-BREAK SPACE}x\N{NO-BREAK SPACE}{scene['height']}",
                Cell(pixels["unexplained"], "bad" if pixels["unexplained"] else ""),
                pixels["explained"],
                pixels["equal"],
                scene["error"]["median"],
                scene["error"]["largest"],
                _ratio(scene),
                sum(scene["loose"].values()),
                scene["seconds"],
            ]
        )
    return Table(columns, rows)


def _about(judged: Judged) -> list[Section]:
    return [viewer(judged), _histogram(judged.facts), _bounces(judged.facts)]


def viewer(judged: Judged) -> Viewer:
    """Return the pictures of a scene, to be looked into."""
    verdict, seen = judged.verdict, judged.seen
    judgement, finite = verdict.judgement, np.isfinite(error_of(verdict))
    return Viewer(
        judgement.picture,
        judgement.bounds.colour,
        (verdict.against or f"plugin, {verdict.variant}", "reference, float64"),
        bound=judgement.bounds.bound,
        status=judgement.status,
        numbers={"bounces": seen.bounces},
        labels={
            "object": (seen.object, seen.objects),
            "light": (seen.lights, seen.light_texts),
            "bound": (judgement.bounds.means * len(Cause) + judgement.bounds.cause, BOUND_TEXTS),
        },
        told={f"{d.x},{d.y}": why(d, bool(finite[d.y, d.x])) for d in judgement.differences},
        explained=judged.explained,
    )


def _histogram(scene: Mapping[str, Any]) -> Bars:
    """Count pixels by their error, in layers by the number of mirrors on the way."""
    labels = ["0", f"<1e{DECADES[0]}", *(f"1e{power}" for power in DECADES)]
    layers: dict[str, list[float]] = {}
    for bounce in scene["by_bounce"]:
        k = bounce["bounces"]
        name = f"{k} bounce{'s' * (k != 1)}" if k < MOST_LAYERS - 1 else f"{MOST_LAYERS - 1} bounces or more"
        before = layers.get(name, [0.0] * len(labels))
        layers[name] = [a + b for a, b in zip(before, bounce["errors"], strict=True)]
    return Bars("Pixels by error |A - B|, each from the value below it", "error", "pixels", labels, layers)


def _bounces(scene: Mapping[str, Any]) -> Table:
    columns = ["mirrors on the way", "pixels", "unequal", "median error", "largest error", "largest error / bound"]
    names = ("pixels", "unequal", "median", "largest", "ratio")
    return Table(columns, [[str(row["bounces"]), *(row[name] for name in names)] for row in scene["by_bounce"]])


def pictures(verdict: Verdict) -> str:
    """Return A, B and the error as plain pictures, for a notebook."""
    names = verdict.against or f"plugin, {verdict.variant}", "reference"
    return pair(verdict.judgement.picture, verdict.judgement.bounds.colour, names)
