"""One scene, drawn in all ways that are compared: its own grids, to a target error, and by Mitsuba's integrators."""

from __future__ import annotations

import dataclasses
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba_whitted  # noqa: F401  # isort: skip  # before Mitsuba
import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from whitted_validation.benchmark.error_bare import bare
from whitted_validation.benchmark.error_checks import checks_times
from whitted_validation.benchmark.speed_worker import Facts, Sample

Image = NDArray[np.float32]

Draw = Callable[[], Any]
"""Starts one picture; evaluating the result finishes it."""

PEERS: dict[str, dict[str, Any]] = {
    "path": {"type": "path", "max_depth": 2},
    "direct": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
}
"""Mitsuba's integrators, cut down to what Whitted's picture of a scene without mirrors holds: light from the lamp."""


AT_ONCE = 16
"""Samples of a pixel that are taken in one launch for a converged picture."""


class Drawing:
    """A scene in the current variant, which must have vectors."""

    def __init__(self, file: Path, **defines: Any) -> None:
        self._scene: Any = mi.load_file(str(file), optimize=False, **defines)
        # Of its own, so that the plain pictures it is timed against change no setting.
        self._aimed: Any = mi.load_file(str(file), optimize=False, **defines)

    def grid(self, n: int) -> Draw:
        """Draw n x n samples a pixel."""
        return lambda: self._scene.integrator().render(self._scene, spp=n * n)

    def converged(self, samples: int) -> Image:
        """Average the points of a Fibonacci lattice in each pixel, about so many.

        No two of them share a row or a column of the pixel: where edges run along the pixels a grid of 64 x 64 is off
        by up to 1/128 of a pixel, and those of fewer samples are no better, and off the same way (Sloan and Joe 1994).
        """
        from mitsuba_whitted.trace import trace  # its names need a variant

        before, count = 1, 1
        while before + count <= samples:
            before, count = count, before + count
        integrator, sensor = self._scene.integrator(), self._scene.sensors()[0]
        stage, camera, plan = integrator._prepare(self._scene, sensor)
        width, height = (int(size) for size in sensor.film().crop_size())
        lane = dr.arange(mi.UInt32, width * height * AT_ONCE)
        pixel, k = lane // AT_ONCE, lane % AT_ONCE
        total = np.zeros((dr.size_v(mi.Spectrum), width * height))
        for begin in range(0, count, AT_ONCE):
            number = k + dr.opaque(mi.UInt32, begin)
            x = (mi.Float(number) + 0.5) / count
            y = (mi.Float(number * before % count) + 0.5) / count
            inside = number < count
            colour = trace(stage, plan, camera.rays(mi.Float(pixel % width) + x, mi.Float(pixel // width) + y), inside)
            found = [dr.select(inside, channel, 0) for channel in colour.colour]
            dr.eval(found)  # else each of the sums would trace anew
            total += np.array([np.array(dr.block_sum(channel, AT_ONCE)) for channel in found])
        picture: Image = (total / count).T.reshape(height, width, -1).astype(np.float32)
        return picture

    def to(self, error: float, checks: float = 1.0) -> Draw:
        """Draw to a target error, with so many times the checks: see `error_checks`."""
        self._set(target_error=error)

        def draw() -> Any:
            with checks_times(checks):
                return self._aimed.integrator().render(self._aimed)

        return draw

    def bare(self, error: float) -> Draw:
        """Trace the samples that a target error takes, and nothing else."""
        self._set(target_error=error)
        return bare(self._aimed)

    def with_epsilon(self, epsilon: float | None) -> Draw:
        """Draw one sample a pixel with the textbook's epsilon, or without."""
        self._set(epsilon=epsilon, target_error=0.0)
        return lambda: self._aimed.integrator().render(self._aimed, spp=1)

    def peer(self, name: str, spp: int) -> Draw:
        """Draw with one of `PEERS` and the scene's own sampler."""
        integrator = mi.load_dict(PEERS[name])
        return lambda: mi.render(self._scene, integrator=integrator, spp=spp)

    def _set(self, **settings: Any) -> None:
        integrator = self._aimed.integrator()
        integrator.settings = dataclasses.replace(integrator.settings, **settings)

    def rays_of_grid(self, n: int) -> int:
        """Count the rays of a grid, of all kinds."""
        return _rays(self._scene.integrator().count_rays(self._scene, spp=n * n))

    def rays_to(self, error: float, checks: float = 1.0) -> int:
        """Count the rays to a target error, as `to` draws it."""
        self._set(target_error=error)
        with checks_times(checks):
            return _rays(self._aimed.integrator().count_rays(self._aimed))

    def rays_by_pixel(self, error: float) -> NDArray[np.uint32]:
        """Count the rays of all kinds to a target error, (height, width), each with the pixel that its sample lies in.

        What lies on a side counts for the pixel right of it or below it, though the other may have asked for it; beyond
        the borders, for the nearest.
        """
        self._set(target_error=error)
        width, height = (int(size) for size in self._aimed.sensors()[0].film().crop_size())
        found = dr.zeros(mi.UInt32, width * height)

        def note(x: Any, y: Any, rays: Any, active: Any) -> None:
            column, row = (mi.UInt32(dr.clip(at, 0, last)) for at, last in ((x, width - 1), (y, height - 1)))
            dr.scatter_add(found, mi.UInt32(rays), row * width + column, active)

        self._aimed.integrator().count_rays(self._aimed, heard=note)
        by_pixel: NDArray[np.uint32] = np.array(found).reshape(height, width)
        return by_pixel

    def hidden(self, n: int) -> NDArray[np.bool_]:
        """Find pixels whose four corners have one path, and where a grid of n x n finds another.

        Returns
        -------
        (height, width) bool
            What is seen there is missed by whoever looks at the corners alone.
        """
        from mitsuba_whitted.trace import trace  # its names need a variant

        integrator, sensor = self._scene.integrator(), self._scene.sensors()[0]
        stage, camera, plan = integrator._prepare(self._scene, sensor)
        width, height = (int(size) for size in sensor.film().crop_size())

        def path(x: Any, y: Any) -> Any:
            return trace(stage, plan, camera.rays(x, y), True).path

        x, y = (dr.ravel(each) for each in dr.meshgrid(dr.arange(mi.Float, width + 1), dr.arange(mi.Float, height + 1)))
        corners = np.array(path(x, y)).reshape(height + 1, width + 1)
        first = corners[:-1, :-1]
        one = (first == corners[1:, :-1]) & (first == corners[:-1, 1:]) & (first == corners[1:, 1:])
        rows, columns = np.nonzero(one)
        found = np.zeros((height, width), bool)
        if not len(rows):
            return found
        x, y, known = mi.Float(columns.astype(np.float32)), mi.Float(rows.astype(np.float32)), mi.UInt32(first[one])
        differs = dr.full(mi.Bool, False, len(rows))
        for i in range(n):
            for j in range(n):
                at = mi.Point2f((i + 0.5) / n, (j + 0.5) / n)
                dr.make_opaque(at)  # one kernel for all places
                differs |= path(x + at.x, y + at.y) != known
                dr.eval(differs)
        found[one] = np.array(differs)
        return found


def _rays(counted: dict[str, int]) -> int:
    """Add up what was traced, not what was cut off."""
    return sum(counted[kind] for kind in ("camera", "mirror", "shadow"))


def pixels(draw: Draw) -> Image:
    """Draw one picture, (height, width, 3)."""
    return np.array(draw(), np.float32)


class Timed:
    """A way to draw, for `speed_pairs.compare`."""

    def __init__(self, draw: Draw, side: int) -> None:
        self._draw = draw
        for _ in range(2):  # compiled, then warm
            self._finish()
        nothing = float("nan")
        self.facts = Facts(side, (), 0, nothing, nothing, nothing, self.sample(1))

    def sample(self, pictures: int) -> Sample:
        """Draw so many and take the time of one."""
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(pictures):
            self._finish()
        return Sample((time.perf_counter() - wall) / pictures, (time.process_time() - cpu) / pictures)

    def _finish(self) -> None:
        dr.eval(self._draw())
        dr.sync_thread()


def for_peers(file: Path, sampler: str) -> Path:
    """Write a scene of `scenes` as `path` and `direct` draw it too: no mirrors, no ambient light, no sky.

    They have a light of their own for each of these; what is left is the light of lamps and its shadows.
    """
    tree = ET.parse(file)
    root = tree.getroot()
    for emitter in root.findall("emitter[@type='constant']"):
        root.remove(emitter)
    for parent in tree.iter():
        for e in [e for e in parent if e.get("name") in ("mirror_reflectance", "ambient")]:
            parent.remove(e)
    for each in tree.iter("sampler"):
        each.set("type", sampler)
    plain = file.with_name(f"{file.stem}_{sampler}.xml")
    tree.write(plain, encoding="utf-8")
    return plain
