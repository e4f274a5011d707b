"""A case of the suite, and what came out of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from whitted_validation.stress.trial import Trial

U = 2.0**-24
"""Unit roundoff of float32."""


@dataclass(frozen=True)
class Outcome:
    """What one policy made of one case.

    Attributes
    ----------
    holds : whether the statement is true
    figure : for the table: how far from true, in few characters
    values : numbers behind it
    pictures : for the page, by caption: (height, width, 3) linear radiance
    """

    holds: bool
    figure: str
    values: dict[str, Any] = field(default_factory=dict)
    pictures: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """A statement, and how it is tried.

    Attributes
    ----------
    family : cases of one kind stand together in the table
    statement : what holds exactly; ``figure`` says what the table shows
    measure : tries it under the policy of the trial
    ours_only : whether other policies have no say in it, since no ray leaves a surface
    """

    family: str
    name: str
    statement: str
    measure: Callable[[Trial], Outcome]
    ours_only: bool = False


def shares(*parts: tuple[str, Any, Any]) -> Outcome:
    """Demand that nothing is wrong: each part is a name, how many are wrong, and of how many."""
    values: dict[str, Any] = {}
    worst, counted = 0.0, True
    for name, wrong, of in parts:
        values |= {name: int(wrong), f"{name} of": int(of)}
        counted &= int(of) > 0
        worst = max(worst, int(wrong) / max(1, int(of)))
    return Outcome(worst == 0 and counted, percent(worst) if counted else "nothing tried", values)


def percent(share: float) -> str:
    """Write a share for the table."""
    return "0" if share == 0 else f"{100 * share:.2g} %" if share < 0.995 else "100 %"


def limited(name: str, value: float, limit: float, **others: Any) -> Outcome:
    """Demand that a number is at most `limit`; one that is not a number is not."""
    return Outcome(
        bool(value <= limit), "0" if value == 0 else f"{value:.1e}", {name: float(value), "limit": limit, **others}
    )


def together(outcomes: Sequence[Outcome], names: Sequence[str]) -> Outcome:
    """Demand all of several outcomes; the table shows the worst, which is the first that fails."""
    shown = next((outcome for outcome in outcomes if not outcome.holds), outcomes[-1])
    values = {
        f"{name}: {key}": value for name, o in zip(names, outcomes, strict=True) for key, value in o.values.items()
    }
    return Outcome(all(outcome.holds for outcome in outcomes), shown.figure, values)


def log_uniform(rng: np.random.Generator, low: float, high: float, count: int) -> Any:
    """Draw numbers whose logarithms are uniform."""
    return np.exp(rng.uniform(np.log(low), np.log(high), count))
