"""The measurement of error against cost: which scenes, which ways to draw them, and what is kept of each."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from whitted_validation import random_scenes
from whitted_validation.benchmark import povray, scenes
from whitted_validation.benchmark.error_checks import CHECKS
from whitted_validation.benchmark.error_curves import Point
from whitted_validation.benchmark.error_drawing import PEERS, Drawing, Image, Timed, for_peers, pixels
from whitted_validation.benchmark.error_epsilon import Wrong, shadows
from whitted_validation.benchmark.error_oracle import NO_TARGET, ORACLE, Oracle
from whitted_validation.benchmark.error_picture import busy, compared, picture_point, timed
from whitted_validation.benchmark.error_povray import by_povray
from whitted_validation.benchmark.error_schedule import Schedule
from whitted_validation.benchmark.speed_configurations import Unavailable
from whitted_validation.benchmark.speed_worker import Failed
from whitted_validation.comparison import compare

FROZEN = "d4579cd2a221366b17d5370f6f99deb82ffa3a7a"
"""The commit after which no constant of the refinement was changed. Its own number gives the seeds of what is judged
here: nobody could know them before.
"""

SEED = int(FROZEN[:8], 16)
"""Of the first scenes a, b and c; the others follow."""

FIRST_RANDOM = int(FROZEN[8:16], 16)
"""Of the first random scene; the others follow."""

PROMISED = (1e-2, 3e-3, 1e-3, 3e-4)
"""Target errors of which the promise is judged."""

LOOKS = 16
"""Hidden features are looked for by a grid of so many samples a side of the pixel."""

GRID, TARGET = "grid", "target error"

UNREFINED = "without a target"
"""A target above any error: the samples at the corners of pixels, what they say of each, and in clutter some checks."""

RANDOM = "random"
"""Begins the names of random scenes."""

ONE_SAMPLE = 1


@dataclass
class Curves:
    """One scene.

    Attributes
    ----------
    unsure : RMSE between the converged picture and one of at most half as many samples: the error of the coarser of
        the two, so more than that of the other
    checked : RMSE between the converged picture and a refined one
    rays : of one sample a pixel, of all kinds
    hidden : pixels that show their corners nothing of what is in them
    note : why POV-Ray is missing
    """

    title: str
    seed: int
    size: int
    unsure: float = float("nan")
    checked: float = float("nan")
    rays: int = 0
    hidden: int = 0
    points: list[Point] = field(default_factory=list)
    note: str = ""

    def of(self, way: str) -> list[Point]:
        """Return one curve."""
        return [point for point in self.points if point.way == way]


@dataclass(frozen=True)
class Kept:
    """How a target error was kept: the RMSE, and the rays over those of one sample a pixel; `unsure` as in `Curves`."""

    scene: str
    target: float
    rmse: float
    rays: float
    unsure: float


@dataclass
class Results:
    """All that was measured so far.

    Attributes
    ----------
    scenes : by letter
    redrawn : letters, and more scenes of these kinds, from the seeds that follow; no POV-Ray
    untimed : still more, of which no times are taken
    peers : scene a with one light and without mirrors, where `path` and `direct` converge to the same picture
    epsilon : RMSE of one sample a pixel with the textbook's constant, against one without
    shadows : points that it puts in the wrong light
    exact : RMSE of one sample a pixel in float32, against double precision, and its largest error; pixels off by more
        than 1e-3; pixels in all
    kept : target errors on all scenes
    povray : POV-Ray's version, or None where it is not installed
    seconds : that all took so far
    """

    scenes: dict[str, Curves] = field(default_factory=dict)
    redrawn: list[tuple[str, Curves]] = field(default_factory=list)
    untimed: list[tuple[str, Curves]] = field(default_factory=list)
    peers: Curves | None = None
    epsilon: list[Point] = field(default_factory=list)
    shadows: list[Wrong] = field(default_factory=list)
    exact: tuple[float, float, int, int] | None = None
    kept: list[Kept] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    povray: str | None = None
    seconds: float = 0.0
    complete: bool = False

    def drawn(self) -> list[tuple[str, Curves]]:
        """Return all scenes in the order in which they are drawn, each with its letter."""
        return [*self.scenes.items(), *self.redrawn, *self.untimed]

    def timed(self, kind: str) -> list[Curves]:
        """Return the scenes of a kind whose times are taken."""
        return [curves for letter, curves in (*self.scenes.items(), *self.redrawn) if letter == kind]

    def of(self, kind: str) -> list[Curves]:
        """Return all scenes of a kind."""
        return [curves for letter, curves in self.drawn() if letter == kind]


def run(schedule: Schedule, folder: Path, results: Results, told: Callable[[str], None]) -> Iterator[None]:
    """Measure, and return after each step; a variant with vectors must be set.

    Parameters
    ----------
    folder : for the scenes and their meshes
    results : filled step by step
    told : hears what is measured next
    """
    began = time.perf_counter()
    for _ in _steps(schedule, folder, results, told):
        results.seconds = time.perf_counter() - began
        yield
    results.complete = True


def _steps(schedule: Schedule, folder: Path, results: Results, told: Callable[[str], None]) -> Iterator[None]:
    results.povray = povray.version()
    for kind in schedule.kinds:
        file = scenes.write(kind, folder, SEED)
        curves = results.scenes[kind] = Curves(scenes.KINDS[kind].title, SEED, schedule.size)
        for _ in _curves(kind, file, curves, schedule, told, povray_too=True):
            _keep(results, f"scene {kind}", curves)
            yield
        if curves.note:
            results.notes.append(f"scene {kind}: {curves.note}")
    for number, kind in itertools.product(range(1, schedule.draws + schedule.untimed), schedule.kinds):
        curves = Curves(scenes.KINDS[kind].title, SEED + number, schedule.size)
        is_timed = number < schedule.draws
        (results.redrawn if is_timed else results.untimed).append((kind, curves))
        name = f"scene {kind}, seed {curves.seed}"
        for _ in _curves(name, scenes.write(kind, folder, curves.seed), curves, schedule, told, is_timed=is_timed):
            _keep(results, name, curves)
            yield
    results.peers = Curves("six balls on a floor, no mirror, one light", SEED, schedule.peers_size)
    yield from _peers(results.peers, schedule, folder, told)
    told("the textbook's epsilon")
    file = scenes.write("a", folder, SEED)
    _epsilons(file, results, schedule)
    results.shadows = shadows()
    yield
    for number in range(schedule.random):
        told(f"random scene {number}")
        try:
            _random(FIRST_RANDOM + number, folder, results, schedule)
        except (ValueError, RuntimeError) as error:
            results.notes.append(f"random scene {FIRST_RANDOM + number}: {' '.join(str(error).split())}")
        yield
    told("float32 against double precision")
    results.exact = _exact(file, schedule.exact_size)
    yield


def _curves(
    name: str,
    file: Path,
    curves: Curves,
    schedule: Schedule,
    told: Callable[[str], None],
    others: bool = True,
    povray_too: bool = False,
    is_timed: bool = True,
) -> Iterator[None]:
    """Measure our own two curves, if asked for those of other checks and of an oracle, and those of POV-Ray."""
    told(f"{name}: converged picture")
    drawing = Drawing(file, size=str(curves.size))
    truth, curves.unsure = _converged(drawing, schedule.converged if is_timed else schedule.converged_untimed)
    curves.checked = compare(pixels(drawing.to(schedule.refined)), truth).rmse
    hidden = drawing.hidden(LOOKS)
    curves.hidden = int(hidden.sum())
    one = Timed(drawing.grid(ONE_SAMPLE), curves.size) if is_timed else None
    curves.rays = drawing.rays_of_grid(ONE_SAMPLE)
    yield
    for n in schedule.grids:
        told(f"{name}: grid {n} x {n}")
        traced = drawing.rays_of_grid(n) / curves.rays
        curves.points.append(picture_point(GRID, n, drawing.grid(n), truth, schedule, one, traced, hidden))
        yield
    by_pixel = {}
    for target in (NO_TARGET, *schedule.targets):
        way = UNREFINED if target == NO_TARGET else TARGET
        told(f"{name}: {way}" + f" {target:g}" * (way == TARGET))
        by_pixel[target] = drawing.rays_by_pixel(target)
        traced = int(by_pixel[target].sum()) / curves.rays
        point = picture_point(way, target, drawing.to(target), truth, schedule, one, traced, hidden)
        if one is not None:
            bare = timed(drawing.bare(target), one, curves.size, schedule)
            point = replace(point, bare=bare, busy=busy(drawing.to(target), curves.size))
        curves.points.append(point)
        yield
    for (way, checks), target in itertools.product(CHECKS.items() if others else (), schedule.targets):
        told(f"{name}: target error {target:g}, {way}")
        traced = drawing.rays_to(target, checks) / curves.rays
        draw = drawing.to(target, checks)
        curves.points.append(picture_point(way, target, draw, truth, schedule, traced=traced, hidden=hidden))
        yield
    if others:
        told(f"{name}: an oracle")
        oracle = Oracle(truth, [pixels(drawing.to(target)) for target in by_pixel], list(by_pixel.values()))
        for point in curves.of(TARGET):
            picture, traced = oracle.choose(point.rmse)
            curves.points.append(compared(ORACLE, point.knob, picture, truth, None, traced / curves.rays, hidden))
            yield
    if not povray_too or one is None:
        return
    try:
        for point in by_povray(name, file, one, curves.rays, truth, hidden, schedule, told):
            curves.points.append(point)
            yield
    except (Failed, Unavailable) as error:
        curves.note = str(error)


def _converged(drawing: Drawing, samples: int) -> tuple[Image, float]:
    """Draw the converged picture; return how unsure it is as well, see `Curves`."""
    truth = drawing.converged(samples)
    return truth, compare(drawing.converged(samples // 2), truth).rmse


def _keep(results: Results, name: str, curves: Curves) -> None:
    """Enter what is new of the target errors that are promised."""
    known = {(kept.scene, kept.target) for kept in results.kept}
    for point in curves.of(TARGET):
        if point.knob in PROMISED and (name, point.knob) not in known:
            assert point.rays is not None
            results.kept.append(Kept(name, point.knob, point.rmse, point.rays, curves.unsure))


def _peers(curves: Curves, schedule: Schedule, folder: Path, told: Callable[[str], None]) -> Iterator[None]:
    """Measure ours and Mitsuba's integrators on the same scene."""
    file = scenes.write("a", folder, SEED, lights=1)
    yield from _curves("one light", for_peers(file, "independent"), curves, schedule, told, others=False)
    for sampler in schedule.samplers:
        drawing = Drawing(for_peers(file, sampler), size=str(curves.size))
        one = Timed(drawing.grid(ONE_SAMPLE), curves.size)
        truth = drawing.converged(schedule.converged)
        for name in PEERS:
            for spp in schedule.spp:
                told(f"one light: {name}, {sampler}, {spp} samples")
                draw = drawing.peer(name, spp)
                curves.points.append(picture_point(f"{name}, {sampler}", spp, draw, truth, schedule, one))
                yield


def _epsilons(file: Path, results: Results, schedule: Schedule) -> None:
    """Measure what the textbook's constant does to a picture, at equal sampling."""
    drawing = Drawing(file, size=str(schedule.size))
    truth = pixels(drawing.with_epsilon(None))
    for epsilon in schedule.epsilons:
        results.epsilon.append(picture_point("epsilon", epsilon, drawing.with_epsilon(epsilon), truth, schedule))


def _random(seed: int, folder: Path, results: Results, schedule: Schedule) -> None:
    """See whether target errors are kept in a scene of anything."""
    file, _ = random_scenes.write(folder, seed, *schedule.random_size)
    drawing = Drawing(file)
    truth, unsure = _converged(drawing, schedule.converged)
    one = drawing.rays_of_grid(ONE_SAMPLE)
    for target in PROMISED:
        rmse = compare(pixels(drawing.to(target)), truth).rmse
        results.kept.append(Kept(f"{RANDOM} {seed}", target, rmse, drawing.rays_to(target) / one, unsure))


def _exact(file: Path, size: int) -> tuple[float, float, int, int]:
    """Compare one sample a pixel with the reference's picture in double precision."""
    import whitted_reference
    from whitted_validation.validation import processes

    drawn = pixels(Drawing(file, size=str(size)).grid(ONE_SAMPLE))
    with processes() as workers:
        exact = whitted_reference.render(whitted_reference.load(file, {"size": str(size)}), executor=workers)
    found = compare(drawn.astype(np.float64), np.array(exact.rows).reshape(drawn.shape))
    return found.rmse, found.largest, found.above, found.error.size
