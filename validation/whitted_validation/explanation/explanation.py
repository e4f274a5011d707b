"""Why has this pixel this colour, and why do the two programs differ here? See `explain`."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import whitted_reference
from mitsuba_whitted.seen import Numbers, PixelSeen, SampleSeen
from whitted_reference.image import DEEPEST, resized
from whitted_reference.scene import Scene
from whitted_validation.bounds import Bounds, measure
from whitted_validation.explanation.closeness import Closeness
from whitted_validation.explanation.comparison import Pair, growth, paired, partings, values
from whitted_validation.explanation.reference_side import in_grey, seen_by_reference
from whitted_validation.explanation.story import story
from whitted_validation.explanation.tree import Branch, alike, tree_of
from whitted_validation.refusal import Refusal, no_such_sensor
from whitted_validation.report.words import why
from whitted_validation.request import Request
from whitted_validation.rounding import Follower
from whitted_validation.validation import Here
from whitted_validation.verdict import Judgement, Status, judge

if TYPE_CHECKING:
    from whitted_validation.load import Loaded

MOST_TREES = 4
"""Samples that go different ways are shown so many times."""

MOST_CALLS = 3
"""So many of the closest decisions are named at the top."""


@dataclass
class Explanation:
    """One pixel in both programs; printing it, or leaving it in a notebook, shows all of it.

    Attributes
    ----------
    file, grid : the scene file; samples per pixel are grid x grid
    x, y : pixel of the crop window, from its upper left corner
    scene, sensor : the reference's description of the scene
    plugin, reference : what the two programs did
    judgement : the verdict on this pixel, as a picture of its own
    closeness : measures how nearly decisions fell
    """

    file: Path
    grid: int
    x: int
    y: int
    scene: Scene
    sensor: int
    plugin: PixelSeen
    reference: PixelSeen
    judgement: Judgement
    closeness: Closeness

    @property
    def title(self) -> str:
        """Which pixel of which picture."""
        film = self.scene.sensors[self.sensor].film
        grid = "" if self.grid == 1 else f", mean of {self.grid} x {self.grid} samples"
        return f"{self.file.stem}, pixel ({self.x}, {self.y}) of {film.crop_width} x {film.crop_height}{grid}"

    @property
    def colour(self) -> Pair:
        """The pixel's colour in both programs."""
        return Pair("colour", self.plugin.colour, self.reference.colour)

    @property
    def samples(self) -> list[tuple[SampleSeen, SampleSeen]]:
        """The samples of both programs, row by row."""
        return list(zip(self.plugin.samples, self.reference.samples, strict=True))

    @property
    def status(self) -> Status:
        """The verdict on this pixel."""
        return Status(int(self.judgement.status[0, 0]))

    @cached_property
    def groups(self) -> list[list[int]]:
        """Samples that go the same way."""
        return alike(self.samples)

    @cached_property
    def answers(self) -> list[tuple[str, list[str]]]:
        """A student's questions, and the answers."""
        black = not any(self.reference.colour)
        return [
            ("Why is this pixel black?" if black else "Why this colour?", self._why()),
            ("Do the two programs agree?", self._agreement()),
            ("How close was it?", self._close_calls()),
        ]

    @cached_property
    def trees(self) -> list[tuple[str, list[Branch]]]:
        """The ray trees, one for each way that samples go."""
        found = []
        for group in self.groups[:MOST_TREES]:
            ours, theirs = self.samples[group[0]]
            heading = "The ray tree" if len(self.groups) == 1 and self.grid == 1 else self._which(group)
            found.append((heading, tree_of(ours, theirs, self.closeness)))
        return found

    def __str__(self) -> str:
        from whitted_validation.explanation.terminal import as_text

        return as_text(self)

    def _repr_html_(self) -> str:
        from whitted_validation.explanation.page import STYLE, html

        return f"<style>{STYLE}</style>{html(self)}"

    def html(self) -> str:
        """Return the explanation as HTML with its drawing, to be put on a page that has `page.STYLE`."""
        from whitted_validation.explanation.page import html

        return html(self)

    def drawing(self) -> str:
        """Return the scene from above and from the side with the rays of the pixel, as SVG.

        They are the reference's, and where the programs part the plugin's as well.
        """
        from whitted_validation.explanation.drawing import drawing

        ways = []
        for group in self.groups[:MOST_TREES]:
            ours, theirs = self.samples[group[0]]
            ways.append(theirs.rays)
            if any(partings(paired(ours, theirs))):
                ways.append(ours.rays)
        return drawing(self.scene, self.sensor, ways)

    def _which(self, group: Sequence[int]) -> str:
        place = f"sample ({group[0] % self.grid}, {group[0] // self.grid})"
        others = f" and {len(group) - 1} more like it" if len(group) > 1 else ""
        return f"{place[0].upper()}{place[1:]} of {self.grid} x {self.grid}{others}"

    def _why(self) -> list[str]:
        if self.grid == 1:
            return story(self.reference.samples[0], self.scene.settings)
        told = []
        for group in self.groups[:MOST_TREES]:
            first = " ".join(story(self.reference.samples[group[0]], self.scene.settings))
            told.append(f"{self._which(group)}: {first}")
        more = len(self.groups) - MOST_TREES
        return [*told, f"{more} more ways of single samples are not shown."] if more > 0 else told

    def _agreement(self) -> list[str]:
        error = float(np.abs(np.array(self.plugin.colour) - np.array(self.reference.colour)).max())
        status, bounds = self.status, self.judgement.bounds
        apart = f"They differ by {error:.2g}, {self.colour.ulps:.2g} ulp; "
        apart += f"rounding alone may make up to {bounds.bound.max():.2g}."
        if status == Status.EQUAL:
            told = [f"Yes. {apart}" if error else "Yes, to the last bit of float32."]
        else:
            told = [f"No. {apart}", f"{why(self.judgement.differences[0])} A is the plugin, B the reference."]
        parted = [words for ours, theirs in self.samples for words in partings(paired(ours, theirs))]
        if parted:
            return [*told, f"They part at {parted[0]}."]
        apart_by = [value for pair in self.samples for value in values(paired(*pair))]
        # Half an ulp is what writing a double as a float32 costs.
        first = next((value for value in apart_by if value[1] > 0.5), None)
        if first:
            told.append(f"The first value that is not the same: {first[0]}, by {first[1]:.2g} ulp.")
        if first and status != Status.EQUAL:
            told.append(f"Rays, sides and shadows are the same in both. {growth(apart_by)}")
        return told

    def _close_calls(self) -> list[str]:
        calls = [
            (call.by, f"Ray {ray.k}: {call.words}.")
            for group in self.groups[:MOST_TREES]
            for ray in self.reference.samples[group[0]].rays
            for call in [
                *self.closeness.of_hit(ray),
                *(call for light in ray.lights for call in self.closeness.of_light(ray, light)),
            ]
        ]
        return [words for _, words in sorted(calls)[:MOST_CALLS]] or ["Nothing is near."]


def cut_out(judgement: Judgement, x: int, y: int) -> Judgement:
    """Return what a judgement says of one pixel."""
    one = np.s_[y : y + 1, x : x + 1]
    bounds = replace(judgement.bounds, **{f.name: getattr(judgement.bounds, f.name)[one] for f in fields(Bounds)})
    differences = [d for d in judgement.differences if (d.x, d.y) == (x, y)]
    return Judgement(judgement.picture[one], bounds, judgement.status[one], differences)


class Explainer:
    """Explains pixels of one picture: both programs read the scene once.

    Raises
    ------
    Refusal
        If the scene is bad, or holds what the reference does not define.
    """

    def __init__(self, request: Request, sensor: int = 0, grid: int = 1, size: tuple[int, int] | None = None) -> None:
        self._request, self._sensor, self._grid, self._size = request, sensor, grid, size
        self._file = file = request.seen.file
        if request.variant is not None and not request.variant.endswith(("_rgb", "_mono")):
            raise Refusal(f"-m {request.variant}: pixels are explained in rgb and mono variants")
        self._grey = (request.variant or "").endswith("_mono")
        try:
            scene = whitted_reference.load(file, request.defines, request.folders, self._grey)
        except whitted_reference.SceneError as error:
            raise Refusal(str(error)) from None
        if not 0 <= sensor < len(scene.sensors):
            raise no_such_sensor(file, len(scene.sensors), sensor)
        self._scene = scene if size is None else resized(scene, *size)
        self._recorder = Follower(self._scene, sensor)
        self._closeness = Closeness(self._recorder)
        camera = self._scene.sensors[sensor]
        self._film = camera.film
        # The plugin counts distances of camera rays from the eye.
        self._eye = None if camera.x_fov is None else camera.to_world.column(3)

    @cached_property
    def _loaded(self) -> Loaded:
        loaded = self._request.load(self._sensor)

        from whitted_validation import render

        if self._size is not None:
            render.resize(loaded, self._size)
        return loaded

    def pixel(self, x: int, y: int, judgement: Judgement | None = None) -> Explanation:
        """Explain pixel (x, y) of the crop window, counted from its upper left corner.

        Parameters
        ----------
        judgement : on the whole picture, if there is one; else the pixel is judged here
        """
        film, n = self._film, self._grid
        if not (0 <= x < film.crop_width and 0 <= y < film.crop_height):
            raise Refusal(
                f"{self._file}: there is no pixel {x} {y} in a picture of {film.crop_width} x {film.crop_height}; "
                f"allowed are 0 0 to {film.crop_width - 1} {film.crop_height - 1}"
            )
        sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST))
        loaded = self._loaded
        plugin: PixelSeen = loaded.integrator.explain(loaded.scene, x, y, loaded.sensor, n * n)
        samples = [
            seen_by_reference(self._scene, self._recorder, self._recorder.record(x, y, i, j, n), self._eye)
            for j in range(n)
            for i in range(n)
        ]
        reference = PixelSeen(samples, self._recorder.pixel(x, y, n))
        if self._grey:
            reference = in_grey(reference)
        its_own = self._judged(x, y, plugin.colour) if judgement is None else cut_out(judgement, x, y)
        return Explanation(self._file, n, x, y, self._scene, self._sensor, plugin, reference, its_own, self._closeness)

    def _judged(self, x: int, y: int, colour: Numbers) -> Judgement:
        """Judge the pixel as a picture of its own, by a crop of the film."""
        film = self._film
        only = replace(film, crop_x=film.crop_x + x, crop_y=film.crop_y + y, crop_width=1, crop_height=1)
        sensors = list(self._scene.sensors)
        sensors[self._sensor] = replace(sensors[self._sensor], film=only)
        scene = replace(self._scene, sensors=tuple(sensors))
        bounds = measure(scene, Here(), self._grid, self._sensor)
        picture = np.broadcast_to(np.array(colour, float), (1, 1, 3))
        return judge(scene, bounds, picture, Here(), self._grid, self._sensor)


def explain(
    scene_file: str | Path,
    x: int,
    y: int,
    *,
    grid: int = 1,
    sensor: int = 0,
    variant: str | None = None,
    size: tuple[int, int] | None = None,
    defines: Mapping[str, str] | None = None,
    folders: Sequence[Path] = (),
) -> Explanation:
    """Explain one pixel: its ray tree in both programs, why it has its colour, and where the two differ.

    Parameters
    ----------
    scene_file : a file, or the bare name of a shipped scene
    x, y : pixel of the crop window, counted from its upper left corner
    grid : samples per pixel are grid x grid
    sensor, variant, size, defines, folders : as for `validate`

    Raises
    ------
    Refusal
        If the scene is bad, the pixel is outside, or the scene holds what the reference does not define.
    """
    request = Request(str(scene_file), variant, dict(defines or {}), list(folders), None, 0)
    return Explainer(request, sensor, grid, size).pixel(x, y)
