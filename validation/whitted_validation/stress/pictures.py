"""Whole pictures: shipped scenes told in other units and far from the origin, against the reference tracer."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import whitted_reference
from whitted_reference.image import resized
from whitted_validation import scene_files
from whitted_validation.bounds import Bounds, measure
from whitted_validation.stress.case import Case, Outcome, percent
from whitted_validation.stress.geometry import GENERAL
from whitted_validation.stress.placing import placed
from whitted_validation.stress.trial import Array, Trial
from whitted_validation.verdict import Status, judge

SCENES = ("whitted_1980", "mesh", "polygons", "hall_of_mirrors", "smooth_mesh", "spot")

FULL_SIZE, QUICK_SIZE = (50, 38), (26, 18)

FAR_OFF = 1e-3
"""A pixel off by more is seen. Only flagged ones may be."""

LARGEST_ERROR = 2e-5
"""The promise for pixels where both tracers decide alike, at every scale."""

FEW, FEW_OF_OTHERS = 12, 2
"""Up to so many pixels beyond their bounds may be explained, ours and those of other policies; more are no chance."""

AWAY = np.array([0.6, -0.48, 0.64])
"""Which way a scene is moved: a unit vector with no component of zero."""


def cases() -> Iterator[Case]:
    """List them."""
    statement = (
        f"no pixel is unexplained, none off by more than {FAR_OFF:g} is called equal, equal ones differ by at most "
        f"{LARGEST_ERROR:g} (shown: pixels off by more than {FAR_OFF:g})"
    )
    for exponent in range(-6, 7):
        for turned in (False, True):
            for name in SCENES:
                words = f"{name}, 10^{exponent}{', turned' if turned else ''}"
                linear = GENERAL if turned else None
                measured = partial(_scaled, name=name, scale=10.0**exponent, linear=linear)
                yield Case("scale", words, statement, measured)
    moved = f"no pixel is unexplained (shown: pixels off by more than {FAR_OFF:g})"
    for distance in (1e3, 1e4):
        for name in SCENES:
            yield Case("distance", f"{name}, {distance:g} away", moved, partial(_moved, name=name, distance=distance))
    lost = "reported: what float32 input has lost already, and what the tracer loses of the rest (shown)"
    for distance in (1e5, 1e6):
        for name in SCENES[:3]:
            measured = partial(_moved, name=name, distance=distance, demanded=False)
            yield Case("distance", f"{name}, {distance:g} away", lost, measured)


def is_quick(case: Case) -> bool:
    """Tell which of these cases `--quick` keeps."""
    keep = ("whitted_1980, 10^-6", "polygons, 10^6, turned", "whitted_1980, 1000 away")
    return case.family not in ("scale", "distance") or case.name in keep


def compared(trial: Trial, text: str, size: tuple[int, int] | None = None) -> tuple[Array, Bounds, Any]:
    """Draw a scene by the trial's policy; return the picture, and what the reference says of it and of the scene."""
    file = trial.write(text)
    exact = whitted_reference.load(file)
    if size is not None:
        exact = resized(exact, *size)
    return drawn(trial, file, size), measure(exact, trial.workers, cache=trial.cache), exact


def drawn(trial: Trial, file: Path, size: tuple[int, int] | None) -> Array:
    """Draw a scene at another size."""
    import mitsuba as mi

    scene = trial.load(file)
    if size is not None:
        film = mi.traverse(scene.sensors()[0].film())
        film["size"] = film["crop_size"] = size
        film.update()
        scene.sensors()[0].parameters_changed()
    return trial.draw(scene)


def verdict(trial: Trial, picture: Array, bounds: Bounds, exact: Any, few: int | None = None) -> dict[str, Any]:
    """Count; errors of colours above 1 are relative.

    Explanations are sought only if few pixels are beyond their bounds: for thousands it takes hours.
    """
    error = (np.abs(picture - bounds.colour) / np.maximum(1.0, bounds.colour)).max(axis=2)
    error = np.where(np.isfinite(error), error, np.inf)
    values: dict[str, Any] = {"off": int((error > FAR_OFF).sum()), "pixels": error.size, "largest": float(error.max())}
    beyond = int((~(np.abs(picture - bounds.colour) <= bounds.bound)).any(axis=2).sum())
    values["beyond their bounds"] = beyond
    if beyond <= (few or (FEW if trial.policy.is_ours else FEW_OF_OTHERS)):
        judgement = judge(exact, bounds, picture, trial.workers)
        equal = judgement.status == Status.EQUAL
        flagged = bounds.chaotic | bounds.loose | ~equal
        values |= {
            "unexplained": judgement.count(Status.UNEXPLAINED),
            "explained": judgement.count(Status.EXPLAINED),
            "off and not flagged": int(((error > FAR_OFF) & ~flagged).sum()),
            "largest of equal": float(error[equal & ~bounds.chaotic & ~bounds.loose].max(initial=0.0)),
        }
        values["where"] = [dataclasses.asdict(d) for d in judgement.differences if d.status == Status.UNEXPLAINED][:5]
    return values


def is_explained(values: dict[str, Any]) -> bool:
    """Tell from the numbers of `verdict` whether no pixel is unexplained."""
    return bool(values.get("unexplained", values["beyond their bounds"]) == 0)


def judged(values: dict[str, Any], holds: bool) -> Outcome:
    """Make an outcome of the numbers of `verdict`; if all that is wrong is small, the table says that."""
    is_small = values["off"] == 0 and not holds
    return Outcome(holds, f"<{FAR_OFF:.0e}" if is_small else percent(values["off"] / values["pixels"]), values)


def _size(trial: Trial) -> tuple[int, int]:
    return QUICK_SIZE if trial.quick else FULL_SIZE


def _text(name: str) -> str:
    return scene_files.find(name).read_text(encoding="utf-8")


def _scaled(trial: Trial, name: str, scale: float, linear: Any) -> Outcome:
    values = verdict(trial, *compared(trial, placed(_text(name), scale, linear), _size(trial)))
    good = (
        is_explained(values)
        and values.get("off and not flagged", values["off"]) == 0
        and values.get("largest of equal", 0.0) <= LARGEST_ERROR
    )
    return judged(values, good)


def _moved(trial: Trial, name: str, distance: float, demanded: bool = True) -> Outcome:
    text = _text(name)
    picture, bounds, exact = compared(trial, placed(text, translation=distance * AWAY), _size(trial))
    values = verdict(trial, picture, bounds, exact) if demanded else {}
    if not demanded:
        # The reference of both places: their difference is what rounding the moved numbers to float32 has done.
        here = resized(whitted_reference.load(scene_files.find(name)), *_size(trial))
        true = measure(here, trial.workers, cache=trial.cache).colour
        lost, tracer = (np.abs(a - bounds.colour).max(axis=2) for a in (true, picture))
        values = {
            "beyond their bounds": 0,
            "off": int((tracer > FAR_OFF).sum()),
            "pixels": tracer.size,
            "input alone: median": float(np.median(lost)),
            "input alone: off": int((lost > FAR_OFF).sum()),
            "tracer alone: off": int((tracer > FAR_OFF).sum()),
            "tracer alone: median": float(np.median(tracer)),
        }
    return judged(values, not demanded or is_explained(values))
