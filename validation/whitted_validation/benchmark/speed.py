"""The measurement: which configurations of which scenes, in which order, and what is kept of each."""

from __future__ import annotations

import contextlib
import copy
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import whitted_reference
from whitted_validation import random_scenes
from whitted_validation.benchmark import povray, scenes
from whitted_validation.benchmark.speed_configurations import BY_NAME, CONFIGURATIONS, PLANNED, POVRAY, Unavailable
from whitted_validation.benchmark.speed_memory import SIDE, Large, draw_large
from whitted_validation.benchmark.speed_pairs import Comparison, compare
from whitted_validation.benchmark.speed_start import Start, start
from whitted_validation.benchmark.speed_worker import Facts, Failed, Worker

MIXED = "h"
"""Letter of the scene that `scenes` has not: the balls of b about the mesh of c."""

OFF = 1e-3
"""A pixel is off if a channel differs by more; the eye sees no less."""

RANDOM_SIZE = 512


@dataclass(frozen=True)
class Schedule:
    """What is to be measured.

    Attributes
    ----------
    names : of the configurations beside the planned one, by the letter of the scene
    details : more of them, measured last
    size : of the pictures in pixels
    pairs : of samples a configuration
    tick : a tick of the CPU's clock is at most this share of a sample
    random : how many scenes of `random_scenes`, planned against general
    sizes : for memory, scene a
    starts : pairs of whole processes, cold and warm
    large : whether the largest picture is drawn too
    """

    names: dict[str, tuple[str, ...]]
    details: dict[str, tuple[str, ...]]
    size: int
    pairs: int
    tick: float
    random: int
    sizes: tuple[int, ...]
    starts: dict[str, int]
    large: bool

    def count(self) -> int:
        """Count the steps of `run`."""
        rows = sum(len(names) + 1 for part in (self.names, self.details) for names in part.values())
        return rows + self.random + len(self.sizes) + len(self.starts) + self.large


def _of(*families: str) -> tuple[str, ...]:
    return tuple(c.name for c in CONFIGURATIONS if c.family in families and c.name != PLANNED)


_SLOW = ("scalar", "reference")
_RIVALS = tuple(name for name in _of("plugin", "peer") if name not in (POVRAY, *_SLOW))

QUICK = Schedule(
    {"a": ("limit", "general", "same", "twice", "path", POVRAY)}, {}, 256, 7, 0.1, 0, (256, 1024), {"warm": 2}, False
)

FULL = Schedule(
    {
        "a": (*_of("control"), *_RIVALS, POVRAY, *_SLOW),
        **dict.fromkeys(("b", "c"), (*_RIVALS, POVRAY)),
        **dict.fromkeys(("d", "e", "f", "g", MIXED), _RIVALS),
    },
    {**dict.fromkeys("abc", _of("skip", "remedy")), "d": _of("skip")},
    1024,
    9,
    0.02,
    20,
    (256, 1024, 2048, 4096, 8192),
    {"cold": 6, "warm": 9},
    True,
)


@dataclass(frozen=True)
class Row:
    """A configuration beside the planned one; `note` says why there is no comparison."""

    name: str
    note: str = ""
    comparison: Comparison | None = None
    facts: Facts | None = None
    off: float | None = None
    """Share of pixels that differ from the planned picture."""


@dataclass(frozen=True)
class ByPovRay:
    """What POV-Ray says of a picture: rays of camera and mirrors, rays towards lights, seconds to read the scene."""

    version: str | None
    rays: int
    shadow_rays: int
    parse: float


@dataclass
class Measured:
    """One scene."""

    title: str
    size: int
    facts: Facts | None = None
    rays: dict[str, int] = field(default_factory=dict)
    plan: str = ""
    launch: float = float("nan")
    edits: dict[str, int] = field(default_factory=dict)
    rows: list[Row] = field(default_factory=list)
    povray: ByPovRay | None = None
    note: str = ""

    def row(self, name: str) -> Row | None:
        """Find a configuration."""
        return next((row for row in self.rows if row.name == name), None)


@dataclass
class Results:
    """All that was measured so far."""

    scenes: dict[str, Measured] = field(default_factory=dict)
    random: dict[int, Row] = field(default_factory=dict)
    sizes: dict[int, Facts] = field(default_factory=dict)
    starts: dict[str, Start] = field(default_factory=dict)
    large: Large | None = None
    load: list[float] = field(default_factory=list)
    """Processes that ran or waited for a processor, the mean of a minute: at the beginning, and after each part."""
    notes: list[str] = field(default_factory=list)
    complete: bool = False


def run(schedule: Schedule, folder: Path, results: Results, told: Callable[[str], None]) -> Iterator[None]:
    """Measure, and return after each step.

    Parameters
    ----------
    folder : for the scenes and their meshes
    results : filled step by step
    told : hears what is measured next
    """
    for kind, names in schedule.names.items():
        results.load.append(os.getloadavg()[0])
        yield from _scene(kind, names, schedule, folder, results, told)
    for seed in range(schedule.random):
        told(f"random scene {seed}")
        row = _random(seed, schedule, folder)
        if row.comparison and row.comparison.cpu.most < 1:
            # Two processes may differ for as long as they live: two new ones decide.
            row = _random(seed, schedule, folder)
        results.random[seed] = row
        yield
    file = scenes.write("a", folder)
    for size in schedule.sizes:
        told(f"memory, {size} x {size}")
        with _noted(results, f"{size} x {size}"), Worker(PLANNED, file, size) as worker:
            results.sizes[size] = worker.facts
        yield
    for cache, pairs in schedule.starts.items():
        told(f"start with a {cache} cache")
        with _noted(results, f"start, {cache}"):
            results.starts[cache] = start(file, folder, cache, pairs)
        yield
    if schedule.large:
        told(f"memory, {SIDE} x {SIDE} to a file")
        with _noted(results, f"{SIDE} x {SIDE} to a file"):
            results.large = draw_large(file, folder)
        yield
    for kind, names in schedule.details.items():
        results.load.append(os.getloadavg()[0])
        yield from _scene(kind, names, schedule, folder, results, told)
    results.load.append(os.getloadavg()[0])
    results.complete = True


@contextlib.contextmanager
def _noted(results: Results, what: str) -> Iterator[None]:
    """Keep a failure as a note, and go on."""
    try:
        yield
    except (Failed, Unavailable) as error:
        results.notes.append(f"{what}: {error}")


def _scene(
    kind: str, names: tuple[str, ...], schedule: Schedule, folder: Path, results: Results, told: Callable[[str], None]
) -> Iterator[None]:
    title = scenes.KINDS[kind].title if kind in scenes.KINDS else "200 balls about a mesh of 101,760 triangles"
    measured = results.scenes.setdefault(kind, Measured(title, schedule.size))
    told(f"{kind}: {title}")
    file = scenes.write(kind, folder) if kind in scenes.KINDS else _mixed(folder)
    try:
        with Worker(PLANNED, file, schedule.size) as planned:
            measured.facts = planned.facts
            picture = planned.ask("pixels")
            measured.rays, measured.plan = planned.ask("rays"), planned.ask("plan")
            measured.launch, measured.edits = planned.ask("launch"), planned.ask("edits")
            yield
            for name in names:
                told(f"{kind}: {name}")
                if name == POVRAY:
                    _povray(measured, planned, picture, file, schedule)
                else:
                    measured.rows.append(_row(name, planned, picture, file, schedule))
                yield
    except Failed as error:
        measured.note = str(error)


def _row(name: str, planned: Worker, picture: np.ndarray, file: Path, schedule: Schedule) -> Row:
    """Measure a configuration against the planned one, which waits."""
    configuration = BY_NAME[name]
    try:
        with Worker(name, file, planned.facts.side) as worker:
            off = None
            if configuration.family != "peer" and name != "limit":
                off = _off(worker.ask("pixels"), picture)
            if configuration.in_kernel and worker.facts.kernels == planned.facts.kernels:
                return Row(name, "makes the same kernel here", None, worker.facts, off)
            return Row(name, "", compare(planned, worker, schedule.pairs, schedule.tick), worker.facts, off)
    except (Failed, Unavailable) as error:
        if isinstance(error, Failed):
            planned.sample(1)  # or it is this one that has failed: then its own error ends the scene
        return Row(name, str(error))


def _povray(measured: Measured, planned: Worker, picture: np.ndarray, file: Path, schedule: Schedule) -> None:
    """Measure POV-Ray against the planned configuration, which waits."""
    try:
        description = whitted_reference.load(file, {"size": str(planned.facts.side)})
        mode = povray.Mode(povray.PovRay(description, file.parent, float(picture.max())))
        drawn = mode.drawn
        measured.povray = ByPovRay(povray.version(), drawn.rays, drawn.shadow_rays, drawn.parse)
        compared = compare(planned, mode, schedule.pairs, schedule.tick)
        measured.rows.append(Row(POVRAY, "", compared, None, _off(drawn.pixels, picture)))
    except (Failed, Unavailable) as error:
        if isinstance(error, Failed):
            planned.sample(1)  # as in `_row`
        measured.rows.append(Row(POVRAY, str(error)))


def _off(pixels: np.ndarray, picture: np.ndarray) -> float:
    return float((np.abs(pixels - picture) > OFF).any(axis=2).mean())


def _random(seed: int, schedule: Schedule, folder: Path) -> Row:
    """Measure the general kernel against the planned one in a scene of anything."""
    file, _ = random_scenes.write(folder, seed, RANDOM_SIZE, RANDOM_SIZE)
    text = file.read_text(encoding="utf-8")
    for side in ("width", "height"):
        text = text.replace(f'name="{side}" value="{RANDOM_SIZE}"', f'name="{side}" value="$size"')
    file.write_text(text, encoding="utf-8")
    try:
        with Worker(PLANNED, file, RANDOM_SIZE) as planned:
            return _row("general", planned, planned.ask("pixels"), file, schedule)
    except Failed as error:
        return Row("general", str(error))


def _mixed(folder: Path) -> Path:
    """Put the balls of scene b into scene c."""
    tree = ET.parse(scenes.write("c", folder))
    balls = ET.parse(scenes.write("b", folder)).getroot().findall("shape[@type='sphere']")
    tree.getroot().extend(copy.deepcopy(ball) for ball in balls)
    file = folder / f"{MIXED}_0.xml"
    tree.write(file, encoding="utf-8")
    return file
