"""What came out, for the eye: a table on the terminal, results.json, and the page.

results.json, besides what every command writes
    quick      whether `--quick` was given
    exit       0 if every statement holds for the plugin as it is, 1 if not
    complete   false while cases are missing, and after an interruption
    expected   number of cases
    cases      one object a case: family, name, statement, holds (for the plugin), seconds, and
        outcomes   by policy: holds, figure (as in the table), values (the numbers behind it)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from whitted_validation import report
from whitted_validation.report.charts import Chart
from whitted_validation.report.sections import Cell, Group, Picture, Section, Sentence, Table, Tone
from whitted_validation.stress.policies import EPSILONS, OURS, POLICIES, SPAWN_RAY
from whitted_validation.stress.run import Result, as_facts


def write(folder: Path, results: Sequence[Result], expected: int, quick: bool, complete: bool) -> None:
    """Write results.json and report.html."""
    facts = {
        "quick": quick,
        "exit": 0 if all(result.holds for result in results) else 1,
        "complete": complete,
        "expected": expected,
        "cases": [as_facts(result) for result in results],
    }
    report.write(folder, facts, "whitted stress", sections(results, expected))


def heading() -> str:
    """Return the first line of the table on the terminal."""
    return _line("", [policy.name for policy in POLICIES])


def row(result: Result) -> str:
    """Return a line of it; an exclamation mark stands before what does not hold."""
    outcomes = [result.outcomes.get(policy.name) for policy in POLICIES]
    return _line(f"  {result.case.name}", [(o and ("" if o.holds else "!") + o.figure) or "" for o in outcomes])


def _line(name: str, cells: Sequence[str]) -> str:
    return f"{name:<38}" + "".join(f"{cell:>10}" for cell in cells)


def summary(results: Sequence[Result], expected: int) -> str:
    """Say in one sentence what came out."""
    held = sum(result.holds for result in results)
    missing = "" if len(results) == expected else f"; {expected - len(results)} cases are missing"
    others = []
    for policy in (*EPSILONS, SPAWN_RAY):
        tried = [result.outcomes[policy.name] for result in results if policy.name in result.outcomes]
        others.append(f"{policy.name} {sum(outcome.holds for outcome in tried)} of {len(tried)}")
    return f"{held} of {len(results)} statements hold for the plugin{missing}. The others: {', '.join(others)}."


def sections(results: Sequence[Result], expected: int) -> list[Section]:
    """Build the page."""
    failing = [result for result in results if not result.holds]
    tone: Tone = "bad" if failing else "good"
    parts: list[Section] = [
        Sentence(summary(results, expected), tone),
        Sentence(
            "Each row is a statement that is exactly true of the picture, whatever the arithmetic; the cells say how "
            "far each policy of leaving a surface is from it. Red: the statement does not hold."
        ),
    ]
    for family in dict.fromkeys(result.case.family for result in results):
        parts.append(_family(family, [result for result in results if result.case.family == family]))
    chart = _curves(results)
    if chart is not None:
        parts.append(Group("Error against epsilon", (chart,)))
    return parts


def _family(family: str, results: Sequence[Result]) -> Group:
    rows = []
    for result in results:
        outcomes = [result.outcomes.get(policy.name) for policy in POLICIES]
        rows.append(
            [result.case.name, *("" if o is None else Cell(o.figure, "" if o.holds else "bad") for o in outcomes)]
        )
    statements = dict.fromkeys(result.case.statement for result in results)
    told = [
        Sentence(f"{result.case.name}, plugin: {', '.join(f'{k} {v}' for k, v in _values(result))}", "bad")
        for result in results
        if not result.holds
    ]
    table = Table(["case", *(policy.name for policy in POLICIES)], rows)
    pictures = [
        Picture(picture, caption)
        for result in results
        for outcome in result.outcomes.values()
        for caption, picture in outcome.pictures.items()
    ]
    return Group(family.capitalize(), (*(Sentence(f"Holds: {text}.") for text in statements), table, *told, *pictures))


def _values(result: Result) -> list[tuple[str, object]]:
    return list(result.outcomes[OURS.name].values.items())


def _curves(results: Sequence[Result]) -> Chart | None:
    """Draw the share of bad pixels over epsilon, one line a scale: no epsilon serves all."""
    series: dict[str, list[tuple[float, float]]] = {}
    for result in results:
        if (
            result.case.family == "scale"
            and result.case.name.startswith("whitted_1980")
            and "turned" not in result.case.name
        ):
            line = series.setdefault(result.case.name.split(", ")[1], [])
            for policy in EPSILONS:
                values = result.outcomes[policy.name].values
                line.append((policy.epsilon or 0.0, values["off"] / values["pixels"]))
    if not series:
        return None
    return Chart("Pixels of whitted_1980 off by more than 1e-3", "epsilon, world units", "share of pixels", series)
