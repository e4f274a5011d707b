"""What `whitted validate` writes.

results.json of validate, after the keys of all commands (see the package):
    exit        0 if every pixel of every scene is equal or explained, 1 if not, 2 if a scene was not judged
    complete    false while scenes are still missing, and after an interruption
    sentence    the verdict in words
    scenes      one object a scene, in the order in which they were judged:
        name, file, variant, against, grid, width, height, seconds, sentence
        pixels      equal, explained, unexplained: numbers of pixels
        certified   by whose bound: propagated, sampled, chaotic (numbers of pixels); `loose` of them have a
                    bound above what a coefficient off by 1e-3 changes
        error       median, largest: of |A - B| over all pixels, worst channel
        bound       median, largest
        differences the pixels that are not equal, unexplained ones first, the largest error first, at most
                    MOST_LISTED: x, y, status, error, bound, reasons, told (why, in words), alternatives, complete
    not_judged  one object a scene: scene, why
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_validation.report.page import write
from whitted_validation.report.pair import pair
from whitted_validation.report.sections import Cell, Group, Section, Sentence, Table
from whitted_validation.report.viewer import Viewer
from whitted_validation.report.words import of_everything, of_scene, why
from whitted_validation.validation import Verdict
from whitted_validation.verdict import Difference, Status

MOST_LISTED = 1000

Refused = Sequence[tuple[str, str]]
Explained = Mapping[str, str]


def exit_code(verdicts: Sequence[Verdict], refused: Refused) -> int:
    """Return 1 if a pixel is unexplained, else 2 if a scene was refused, else 0."""
    return 1 if not all(verdict.good for verdict in verdicts) else 2 if refused else 0


def write_verdicts(folder: Path, verdicts: Sequence[Verdict], refused: Refused, complete: bool) -> None:
    """Write the report of `whitted validate`.

    Raises
    ------
    Refusal
        If the folder cannot be written to.
    """
    facts = results(verdicts, refused, complete)
    write(folder, facts, "whitted validate", sections(facts, verdicts))


def results(verdicts: Sequence[Verdict], refused: Refused, complete: bool) -> dict[str, Any]:
    """Return what results.json holds of these verdicts."""
    scenes = [_scene(verdict) for verdict in verdicts]
    return {
        "exit": exit_code(verdicts, refused),
        "complete": complete,
        "sentence": of_everything(scenes, len(refused), complete),
        "scenes": scenes,
        "not_judged": [{"scene": scene, "why": reason} for scene, reason in refused],
    }


def _scene(verdict: Verdict) -> dict[str, Any]:
    judgement, bounds = verdict.judgement, verdict.judgement.bounds
    error, bound = error_of(verdict), bounds.bound.max(axis=2)
    height, width = judgement.status.shape
    sampled, chaotic = int(bounds.sampled.sum()), int(bounds.chaotic.sum())
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
        "certified": {
            "propagated": width * height - sampled - chaotic,
            "sampled": sampled,
            "chaotic": chaotic,
            "loose": int(bounds.loose.sum()),
        },
        "error": {"median": float(np.median(error)), "largest": float(error.max())},
        "bound": {"median": float(np.median(bound)), "largest": float(bound.max())},
        "differences": [_difference(d) for d in judgement.differences[:MOST_LISTED]],
    }
    return {"sentence": of_scene(facts, judgement.differences), **facts}


def _difference(d: Difference) -> dict[str, Any]:
    return {
        "x": d.x,
        "y": d.y,
        "status": d.status.name.lower(),
        "error": d.error,
        "bound": d.bound,
        "reasons": list(d.reasons),
        "told": why(d),
        "alternatives": d.alternatives,
        "complete": d.complete,
    }


def error_of(verdict: Verdict) -> NDArray[np.float64]:
    """Return |A - B| of the worst channel, (height, width); infinite where A is no number."""
    error = np.abs(verdict.judgement.picture - verdict.judgement.bounds.colour).max(axis=2)
    return np.where(np.isfinite(error), error, np.inf)


def sections(facts: Mapping[str, Any], verdicts: Sequence[Verdict]) -> list[Section]:
    """Return the page: the verdict, a table with the worst scene first, and each scene with its viewer."""
    worst_first = sorted(
        zip(facts["scenes"], verdicts, _titles(verdicts), strict=True),
        key=lambda scene: (-scene[0]["pixels"]["unexplained"], -scene[0]["pixels"]["explained"], -_ratio(scene[0])),
    )
    page: list[Section] = [Sentence(facts["sentence"], "bad" if facts["exit"] else "good")]
    page += [Sentence(f"Not judged: {item['scene']}. {item['why']}", "bad") for item in facts["not_judged"]]
    if worst_first:
        page.append(_table([(scene, title) for scene, _, title in worst_first]))
    page += [Group(title, _about(scene, verdict)) for scene, verdict, title in worst_first]
    return page


def _ratio(scene: Mapping[str, Any]) -> float:
    error, bound = scene["error"]["largest"], scene["bound"]["largest"]
    return float(error / bound) if 0 < bound < np.inf else 0.0


def _titles(verdicts: Sequence[Verdict]) -> list[str]:
    """Name the scenes by their files' names, and by their paths where those are alike."""
    stems = [verdict.scene.stem for verdict in verdicts]
    return [
        verdict.scene.stem if stems.count(verdict.scene.stem) == 1 else f"{verdict.scene} ({place})"
        for place, verdict in enumerate(verdicts, 1)
    ]


def _table(scenes: Sequence[tuple[Mapping[str, Any], str]]) -> Table:
    columns = ["scene", "size", "unexplained", "explained", "equal", "error, median", "largest"]
    columns += ["bound, median", "largest", "loose", "seconds"]
    rows = []
    for scene, title in scenes:
        pixels = scene["pixels"]
        rows.append(
            [
                Cell(title, to=title),
                f"{scene['width']} x {scene['height']}",
                Cell(pixels["unexplained"], "bad" if pixels["unexplained"] else ""),
                pixels["explained"],
                pixels["equal"],
                *(scene[what][which] for what in ("error", "bound") for which in ("median", "largest")),
                scene["certified"]["loose"],
                f"{scene['seconds']:.1f}",
            ]
        )
    return Table(columns, rows)


def _about(scene: Mapping[str, Any], verdict: Verdict) -> list[Section]:
    return [
        Sentence(scene["sentence"], "bad" if scene["pixels"]["unexplained"] else "good"),
        viewer(verdict),
    ]


def viewer(verdict: Verdict, explained: Explained | None = None) -> Viewer:
    """Return the pictures of a verdict, to be looked into."""
    judgement = verdict.judgement
    return Viewer(
        judgement.picture,
        judgement.bounds.colour,
        (verdict.against or f"plugin, {verdict.variant}", "reference, float64"),
        bound=judgement.bounds.bound,
        status=judgement.status,
        told={f"{d.x},{d.y}": why(d) for d in judgement.differences},
        explained=explained or {},
    )


def pictures(verdict: Verdict) -> str:
    """Return A, B and the error as plain pictures, for a notebook."""
    names = verdict.against or f"plugin, {verdict.variant}", "reference"
    return pair(verdict.judgement.picture, verdict.judgement.bounds.colour, names)
