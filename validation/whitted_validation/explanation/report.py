"""What `whitted explain --report` writes, and the explanations that go into the report of `whitted validate`.

results.json of explain, after the keys of all commands:
    scene, x, y, grid       which pixel, of n x n samples
    plugin, reference       its colour in both programs, red, green, blue
    status                  equal, explained or unexplained
    answers                 the answers in words: [[question, [sentence, ...]], ...]
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path

from whitted_validation.explanation.explanation import Explainer, Explanation
from whitted_validation.explanation.page import STYLE
from whitted_validation.report import Markup, write
from whitted_validation.request import Request
from whitted_validation.validation import Verdict
from whitted_validation.verdict import Judgement

MOST_UNEQUAL = 24
"""Of the pixels that differ so many are explained on the page, the worst first."""

TYPICAL = 3
"""Besides, pixels on a grid of so many by so many over the picture."""


def write_explanation(folder: Path, explanation: Explanation) -> None:
    """Write results.json and report.html to a folder.

    Raises
    ------
    Refusal
        If the folder cannot be written to.
    """
    facts = {
        "scene": explanation.file,
        "x": explanation.x,
        "y": explanation.y,
        "grid": explanation.grid,
        "plugin": explanation.plugin.colour,
        "reference": explanation.reference.colour,
        "status": explanation.status.name.lower(),
        "answers": explanation.answers,
    }
    write(folder, facts, "whitted explain", [Markup(explanation.html())], STYLE)


def explained(verdict: Verdict, request: Request, size: tuple[int, int] | None) -> dict[str, str]:
    """Explain the pixels of a picture that differ, and some typical ones: {"x,y": HTML for a page with `STYLE`}.

    There is nothing to explain where the picture came from elsewhere.
    """
    if verdict.against:
        return {}
    judgement = verdict.judgement
    # What is to be said of the scene was said when its picture was drawn.
    with redirect_stderr(StringIO()):
        explainer = Explainer(request, verdict.sensor, verdict.grid, size)
        return {f"{x},{y}": explainer.pixel(x, y, judgement).html() for x, y in _chosen(judgement)}


def _chosen(judgement: Judgement) -> Iterable[tuple[int, int]]:
    height, width = judgement.status.shape
    unequal = [(d.x, d.y) for d in judgement.differences[:MOST_UNEQUAL]]
    places = [(2 * i + 1) / (2 * TYPICAL) for i in range(TYPICAL)]
    typical = [(int(width * across), int(height * down)) for down in places for across in places]
    return dict.fromkeys([*unequal, *typical])
