"""What `whitted compare` writes.

results.json of compare, after the keys of all commands (see `report`):
    exit        0, or 1 if a limit is exceeded
    sentence    what came out, in words
    a, b        one object each: name, stepped (decoded from 8- or 16-bit sRGB), nan and infinite (pixels that hold one)
    remarks     what was chosen or left out when the pictures were read
    width, height, channels
    limits      error, rmse: as given, or null
    exceeded    a line for each limit that is exceeded
    error       largest, rmse: of all pixels, infinite if one is not finite; finite_largest, finite_rmse: of the others;
                percentiles: one object each: percent, error
    equal       pixels without any error
    above       pixels whose error is above SHARE_ABOVE, which is the key `above_error`
    flip        mean, or null; note: how it came about, or why it did not
    worst       at most MOST_LISTED pixels, the worst first: x, y, error, a, b (colours)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from whitted_validation import report
from whitted_validation.comparison import SHARE_ABOVE, Comparison, colour
from whitted_validation.report.sections import Tone


def write_comparison(folder: Path, comparison: Comparison, max_error: float | None, max_rmse: float | None) -> None:
    """Write results.json and report.html.

    Raises
    ------
    Refusal
        If the folder cannot be written to.
    """
    facts = results(comparison, max_error, max_rmse)
    report.write(folder, facts, "whitted compare", sections(comparison, facts))


def results(comparison: Comparison, max_error: float | None, max_rmse: float | None) -> dict[str, Any]:
    """Return what results.json holds."""
    exceeded = comparison.exceeded(max_error, max_rmse)
    height, width, channels = comparison.a.values.shape
    pictures = zip((comparison.a, comparison.b), comparison.not_finite, strict=True)
    a, b = ({"name": picture.name, "stepped": picture.stepped, **asdict(found)} for picture, found in pictures)
    return {
        "exit": 1 if exceeded else 0,
        "sentence": comparison.sentence,
        "a": a,
        "b": b,
        "remarks": comparison.remarks,
        "width": width,
        "height": height,
        "channels": channels,
        "limits": {"error": max_error, "rmse": max_rmse},
        "exceeded": exceeded,
        "error": {
            "largest": comparison.largest,
            "rmse": comparison.rmse,
            "finite_largest": comparison.finite_largest,
            "finite_rmse": comparison.finite_rmse,
            "percentiles": [{"percent": percent, "error": error} for percent, error in comparison.percentiles],
        },
        "equal": comparison.equal,
        "above": comparison.above,
        "above_error": SHARE_ABOVE,
        "flip": asdict(comparison.flip),
        "worst": [asdict(pixel) for pixel in comparison.worst],
    }


def sections(comparison: Comparison, facts: Mapping[str, Any]) -> list[report.Section]:
    """Return the page: what came out in a sentence, the pictures, the figures, the worst pixels."""
    a, b = comparison.a, comparison.b
    page: list[report.Section] = [report.Sentence(comparison.sentence, _tone(comparison, facts))]
    page += [report.Sentence(f"{line}.", "bad") for line in facts["exceeded"]]
    page += [report.Sentence(remark, "quiet") for remark in comparison.remarks]
    page.append(report.Viewer(*comparison.rgb, (a.name, b.name)))
    page.append(report.Table(["figure", "value"], comparison.table, "A pixel's error is |A - B| in its worst channel."))
    if comparison.worst:
        rows: list[list[str | float | report.Cell]] = [
            [f"({p.x}, {p.y})", p.error, colour(p.a), colour(p.b)] for p in comparison.worst
        ]
        page.append(report.Group("Worst pixels", [report.Table(["(x, y)", "error", "A", "B"], rows)]))
    return page


def _tone(comparison: Comparison, facts: Mapping[str, Any]) -> Tone:
    if facts["exceeded"] or np.isinf(comparison.largest):
        return "bad"
    held = any(limit is not None for limit in facts["limits"].values())
    return "good" if held or comparison.equal == comparison.error.size else ""
