"""Shadows under the textbook's epsilon: the points that come out wrong in two cases of `whitted stress`."""

from __future__ import annotations

from dataclasses import dataclass

from whitted_validation.stress import acne
from whitted_validation.stress.policies import EPSILONS, OURS
from whitted_validation.stress.run import run
from whitted_validation.validation import Here

CASES = ("sphere, scale 1", "triangles, scale 1")
"""A body of size 1 that is alone: its points are lit where the light is above their horizon."""


@dataclass(frozen=True)
class Wrong:
    """Share of points that are dark and should be lit, or the other way round, whichever is more.

    Attributes
    ----------
    by_epsilon : the textbook's constant, in sizes of the body, and the share
    ours : without any constant
    """

    case: str
    by_epsilon: list[tuple[float, float]]
    ours: float


def shadows() -> list[Wrong]:
    """Try the cases, with as many probes as `whitted stress --quick`; a variant with vectors must be set."""
    cases = [case for case in acne.cases() if case.name in CASES]
    found = []
    for result in run(cases, quick=True, workers=Here(), policies=(*EPSILONS, OURS)):
        shares = {name: _share(outcome.values) for name, outcome in result.outcomes.items()}
        by_epsilon = [(policy.epsilon, shares[policy.name]) for policy in EPSILONS if policy.epsilon is not None]
        found.append(Wrong(result.case.name, by_epsilon, shares[OURS.name]))
    return found


def _share(values: dict[str, int]) -> float:
    """Return the largest share among counts, each beside the number `of` which it is a part."""
    return max(values[name] / values[f"{name} of"] for name in values if f"{name} of" in values)
