"""The colours derived by hand in each scene's comment, against the picture.

Rounding model, u = 2^-24. Between the camera and a hit's share of the colour lie at most 64 roundings in a
row: the direction (scale, matrix, normalisation) 12, the distance (quadratic or Cramer) 16, point and normal
8, l and h 10, the mirror direction 10, the product of a term and its sum 8. They do two things.

- They move the ray, by at most 64 u in direction. All scenes have tan(fov/2) >= 1/4, so a pixel is at least
  1/1024 wide and the ray moves by at most 2^-8 pixel. What a moved ray does to the colour, curved mirrors,
  grazing surfaces and high exponents included, is read off the picture: one pixel is worth the largest
  difference to the eight neighbours.
- They change the terms, by at most 64 u of their size. A cosine is a sum that cancels, so this is divided by
  the smallest n.l of the derivation. No term is negative: nothing cancels when the terms are summed.

A path of several hits makes them once for each. (The series of `hall_of_mirrors`: 30 products and 31 sums.)
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass

import mitsuba as mi
import numpy as np
import pytest

from whitted_validation import scene_files

U = 2.0**-24
ROUNDINGS = 64
PIXELS_PER_ROUNDING = 1024 * U

_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_PROBE = re.compile(rf"probe: (\d+) (\d+) ({_NUMBER}) ({_NUMBER}) ({_NUMBER})\s+mono: ({_NUMBER})\n")


@dataclass(frozen=True)
class Probe:
    """One pixel whose colour is known, in rgb and in mono, and what its derivation says of the path."""

    x: int
    y: int
    rgb: tuple[float, ...]
    mono: float
    hits: int
    smallest_cosine: float


def probes_of(scene: str) -> list[Probe]:
    """Read the probes from the comment of a scene."""
    text = scene_files.find(scene).read_text().split("-->")[0]
    found, start = [], 0
    for match in _PROBE.finditer(text):
        derivation, start = text[start : match.start()], match.end()
        cosines = [float(value) for value in re.findall(rf"n\.l = ({_NUMBER})", derivation)]
        x, y, *colour = match.groups()
        *rgb, mono = map(float, colour)
        hits = max(1, len(re.findall(r"\bat\s+t\s+=", derivation)))
        found.append(Probe(int(x), int(y), tuple(rgb), mono, hits, min(cosines, default=1.0)))
    assert len(found) == text.count("probe:"), f"{scene}: a probe that is not of the form `probe: x y r g b`"
    return found


def bound(probe: Probe, window: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Bound the rounding error of a probe by the model above; window : (3, 3, channels) around it."""
    slope = np.abs(window - colour).max(axis=(0, 1))
    moved = PIXELS_PER_ROUNDING * slope
    changed = U * colour / probe.smallest_cosine
    return probe.hits * ROUNDINGS * (moved + changed)


def expected(probe: Probe) -> np.ndarray:
    """Give the derived colour in the channels of the current variant."""
    return np.array([probe.mono] if "mono" in mi.variant() else probe.rgb)


class Picture:
    """A scene seen through windows of 3 x 3 pixels: cut from one picture, in scalar variants drawn alone."""

    def __init__(self, scene: str) -> None:
        self.scene = mi.load_file(str(scene_files.find(scene)), optimize=False)
        self.film = mi.traverse(self.scene.sensors()[0].film())
        self.width, self.height = self.film["size"]
        self.whole = None if mi.variant().startswith("scalar") else self._draw()

    def window(self, x: int, y: int) -> tuple[np.ndarray, np.ndarray]:
        """Give the 3 x 3 pixels around a pixel (moved inside the film at its border), and the pixel."""
        left, top = min(max(x - 1, 0), self.width - 3), min(max(y - 1, 0), self.height - 3)
        if self.whole is not None:
            window = self.whole[top : top + 3, left : left + 3]
        else:
            self.film["crop_size"] = (3, 3)
            self.film["crop_offset"] = (left, top)
            self.film.update()
            window = self._draw()
        return window, window[y - top, x - left]

    def _draw(self) -> np.ndarray:
        return np.array(mi.render(self.scene, spp=1), dtype=np.float64)


@functools.cache
def picture(_variant: str, scene: str) -> Picture:
    """Draw each scene once a variant, for all its probes."""
    return Picture(scene)


@pytest.fixture(scope="module", autouse=True)
def scenes_end_with_these_tests() -> Iterator[None]:
    """Drop the scenes: where later tests call a method of a shape, Dr.Jit compiles it for all shapes that are alive."""
    yield
    picture.cache_clear()


SCENES = [scene.stem for scene in scene_files.shipped()]


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_has_three_probes_of_which_no_two_are_alike(scene: str) -> None:
    assert len({(probe.x, probe.y) for probe in probes_of(scene)}) >= 3


@pytest.mark.parametrize("scene", SCENES)
def test_probes_are_what_was_derived(any_variant: str, scene: str) -> None:
    drawn = picture(any_variant, scene)
    wrong, worst = [], 0.0
    for probe in probes_of(scene):
        window, colour = drawn.window(probe.x, probe.y)
        error, limit = np.abs(colour - expected(probe)), bound(probe, window, expected(probe))
        worst = max(worst, float(np.divide(error, limit, out=np.zeros_like(error), where=error > 0).max()))
        if not (error <= limit).all():
            wrong.append(f"{probe}: got {colour}, error {error}, bound {limit}")
    print(f"\n{scene}, {any_variant}: largest error {worst:.3f} of its bound")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("scene", SCENES)
def test_a_probe_off_by_one_in_a_thousand_would_fail(llvm_ad_rgb: str, scene: str) -> None:
    drawn = picture(llvm_ad_rgb, scene)
    for probe in probes_of(scene):
        window, colour = drawn.window(probe.x, probe.y)
        lit = colour > 0
        assert (bound(probe, window, colour)[lit] < 1e-3 * colour[lit]).all(), probe
