"""All cases under all policies."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from whitted_validation import scene_files
from whitted_validation.stress import acne, contacts, judged, leaks, meshes, mirrors, pictures, refusals, shading
from whitted_validation.stress.case import Case, Outcome
from whitted_validation.stress.policies import BY_EMBREE, OURS, POLICIES, Policy
from whitted_validation.stress.trial import Trial

FAMILIES = (acne, leaks, contacts, meshes, mirrors, shading, judged, refusals, pictures)


@dataclass(frozen=True)
class Result:
    """One case, and what every policy made of it, by the policy's name."""

    case: Case
    outcomes: dict[str, Outcome]
    seconds: float

    @property
    def holds(self) -> bool:
        """Tell whether the statement is true of the plugin's own arithmetic, however many shapes there are."""
        return all(self.outcomes[policy.name].holds for policy in (OURS, BY_EMBREE) if policy.name in self.outcomes)


def cases(quick: bool) -> list[Case]:
    """List the cases, those of a family together."""
    found = [case for family in FAMILIES for case in family.cases() if not quick or pictures.is_quick(case)]
    families = list(dict.fromkeys(case.family for case in found))
    return sorted(found, key=lambda case: families.index(case.family))


@contextmanager
def workplace() -> Iterator[Path]:
    """Offer a folder for scene files, with the shipped meshes and textures in it."""
    with tempfile.TemporaryDirectory(prefix="whitted_stress_") as temporary:
        folder = Path(temporary)
        for name in ("meshes", "textures"):
            shutil.copytree(scene_files.SCENES / name, folder / name)
        yield folder


def run(
    wanted: Sequence[Case],
    quick: bool,
    workers: Executor,
    cache: Path | None = None,
    policies: Sequence[Policy] = POLICIES,
    told: Callable[[str], None] = lambda _: None,
) -> Iterator[Result]:
    """Try cases one after the other; a JIT variant of Mitsuba must be set.

    Parameters
    ----------
    workers : where the reference traces its pictures
    cache : where those are kept
    told : hears the name of each case before it is tried
    """
    with workplace() as folder:
        for case in wanted:
            told(f"{case.family}: {case.name}")
            start = time.perf_counter()
            outcomes: dict[str, Outcome] = {}
            known: dict[str, Any] = {}
            for policy in policies:
                if case.ours_only and policy.name != OURS.name:
                    continue
                with policy.installed():
                    outcomes[policy.name] = _tried(case, Trial(policy, quick, folder, workers, cache, known))
            yield Result(case, outcomes, time.perf_counter() - start)


def _tried(case: Case, trial: Trial) -> Outcome:
    """Try one; a scene that one of the programs cannot draw has failed, and what was said of it is kept."""
    try:
        return case.measure(trial)
    except ValueError as error:  # of which the scene errors of both programs are made
        return Outcome(False, "error", {"error": f"{type(error).__name__}: {error}"})


def as_facts(result: Result) -> dict[str, Any]:
    """Return what results.json holds of one case."""
    return {
        "family": result.case.family,
        "name": result.case.name,
        "statement": result.case.statement,
        "holds": result.holds,
        "seconds": round(result.seconds, 2),
        "outcomes": {
            name: {"holds": outcome.holds, "figure": outcome.figure, "values": outcome.values}
            for name, outcome in result.outcomes.items()
        },
    }
