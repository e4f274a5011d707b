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

from collections.abc import Mapping, Sequence
from pathlib import Path

from whitted_validation import report
from whitted_validation.report.charts import Chart
from whitted_validation.report.sections import Cell, Group, Markup, Picture, Section, Sentence, Table, Tone
from whitted_validation.stress.case import Outcome
from whitted_validation.stress.policies import EPSILONS, OURS, POLICIES, SPAWN_RAY
from whitted_validation.stress.run import Result, as_facts

STYLE = ".side-by-side { display: flex; flex-wrap: wrap; gap: 1rem } .side-by-side figure { margin: 0 }"


def write(folder: Path, results: Sequence[Result], expected: int, quick: bool, complete: bool) -> None:
    """Write results.json and report.html."""
    facts = {
        "quick": quick,
        "exit": 0 if all(result.holds for result in results) else 1,
        "complete": complete,
        "expected": expected,
        "cases": [as_facts(result) for result in results],
    }
    report.write(folder, facts, "whitted stress", sections(results, expected), STYLE)


def heading() -> str:
    """Return the first line of the table on the terminal."""
    return _line("", [policy.name for policy in POLICIES])


def row(result: Result) -> str:
    """Return a line of it; an exclamation mark stands before what does not hold."""
    outcomes = [result.outcomes.get(policy.name) for policy in POLICIES]
    return _line(f"  {result.case.name}", [(o and ("" if o.holds else "!") + o.figure) or "" for o in outcomes])


def _line(name: str, cells: Sequence[str]) -> str:
    return f"{name:<38}" + "".join(
        f"{cell:>{max(10, len(policy.name) + 2)}}" for cell, policy in zip(cells, POLICIES, strict=True)
    )


def summary(results: Sequence[Result], expected: int) -> str:
    """Say in one sentence what came out."""
    held = sum(result.holds for result in results)
    missing = "" if len(results) == expected else f"; {expected - len(results)} cases are missing"
    tried = {policy.name: _held(results, policy.name) for policy in (*EPSILONS, SPAWN_RAY)}
    most = max(count for _, count in tried.values())
    others = ", ".join(f"{name} {number}" for name, (number, _) in tried.items())
    return f"{held} of {len(results)} statements hold for the plugin{missing}. Of the {most} that others try: {others}."


def _held(results: Sequence[Result], policy: str) -> tuple[int, int]:
    """Count the statements that hold for a policy, and those that were tried."""
    tried = [result.outcomes[policy].holds for result in results if policy in result.outcomes]
    return sum(tried), len(tried)


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
    families = {
        family: [result for result in results if result.case.family == family]
        for family in dict.fromkeys(result.case.family for result in results)
    }
    parts.append(_overview(families))
    chart = _curves(results)
    if chart is not None:
        parts.append(Group("Error against epsilon", (chart,)))
    parts += [_family(family, those) for family, those in families.items()]
    return parts


def _overview(families: Mapping[str, Sequence[Result]]) -> Table:
    """Count the statements that hold: families by policies."""
    rows = []
    for family, results in families.items():
        row: list[str | Cell] = [Cell(family, to=family.capitalize())]
        for policy in POLICIES:
            held, tried = _held(results, policy.name)
            row.append(Cell(f"{held} of {tried}", "" if held == tried else "bad") if tried else "")
        rows.append(row)
    return Table(["statements that hold", *(policy.name for policy in POLICIES)], rows)


def _family(family: str, results: Sequence[Result]) -> Group:
    rows = []
    for result in results:
        outcomes = [result.outcomes.get(policy.name) for policy in POLICIES]
        rows.append(
            [result.case.name, *("" if o is None else Cell(o.figure, "" if o.holds else "bad") for o in outcomes)]
        )
    statements = dict.fromkeys(result.case.statement for result in results)
    told = [
        Sentence(f"{result.case.name}, {policy.name}: {_words(result.outcomes[policy.name])}", "bad")
        for result in results
        for policy in POLICIES
        if policy.is_ours and policy.name in result.outcomes and not result.outcomes[policy.name].holds
    ]
    table = Table(["case", *(policy.name for policy in POLICIES)], rows)
    pictures = "".join(
        Picture(picture, caption).html()
        for result in results
        for outcome in result.outcomes.values()
        for caption, picture in outcome.pictures.items()
    )
    side_by_side = [Markup(f'<div class="side-by-side">{pictures}</div>')] if pictures else []
    holds = (Sentence(f"Holds: {text}.") for text in statements)
    return Group(family.capitalize(), (*holds, table, *told, *_lost(results), *side_by_side))


def _lost(results: Sequence[Result]) -> list[Section]:
    """Set what float32 input has lost against what the plugin loses of the rest, where that was measured."""
    names = ("input alone: off", "input alone: median", "tracer alone: off", "tracer alone: median")
    measured = [(result.case.name, result.outcomes[OURS.name].values) for result in results]
    rows = [[name, *(values[key] for key in names)] for name, values in measured if names[0] in values]
    return [Table(["case", *names], rows, "Pixels off, and median error of all")] if rows else []


def _words(outcome: Outcome) -> str:
    return ", ".join(f"{name} {value}" for name, value in outcome.values.items())


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
