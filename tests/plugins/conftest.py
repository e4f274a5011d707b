"""Small scenes from strings, and the one way in which these tests compare a picture with a colour derived by hand.

Rounding model, u = 2^-24. Between the camera and a term of the colour at one hit lie at most 64 roundings in a
row: the direction (scale, matrix, normalisation) 12, the distance (quadratic or Cramer) 16, point and normal 8,
l and h 10, the mirror direction 10, the product of a term and its sum 8. They act in two ways.

- They turn the ray by at most 64 u. What that does to the colour is read off the derived colour itself, by a
  difference in two directions across the ray (`colour` is then a function of d).
- They change a term by 64 u of its size, times `condition`: at most 1 / (n.l) for the cosine, a sum that cancels;
  where a light at distance r is involved, 3 t / r more, since l and 1/r^2 feel an error of 64 u t along the ray.

A path of several hits makes them once for each. No term is negative, so nothing cancels in their sum, and black is
black exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]
Colour = Callable[[Array], Array]

ROUNDING = 64 * 2.0**-24
STEP = 2.0**-20
"""Length of the difference: about the cube root of float64's u, where truncation and cancellation balance."""

PERSPECTIVE = '<sensor type="perspective"><float name="fov" value="90"/>{film}</sensor>'


def _film(width: int, height: int, more: str) -> str:
    pixel_format = "luminance" if "mono" in mi.variant() else "rgb"
    return f"""<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
      <string name="component_format" value="float32"/><string name="pixel_format" value="{pixel_format}"/>
      {more or '<rfilter type="box"/>'}</film>"""


def _load(
    body: str, integrator: str = "", size: tuple[int, int] = (1, 1), sensor: str = PERSPECTIVE, film: str = ""
) -> Any:
    return mi.load_string(
        f"""<scene version="3.0.0"><integrator type="whitted" id="whitted">{integrator}</integrator>
        {sensor.format(film=_film(*size, film))}{body}</scene>""",
        parallel=False,  # else the log of one thread and the interpreter of another can wait for each other
        optimize=False,
    )


@pytest.fixture
def scene_of() -> Callable[..., Any]:
    """Load a scene: `scene_of(body, integrator, size, sensor, film)`.

    The sensor stands in the origin and looks along +z, with +x to the left and +y up; fov 90. Its film is one
    pixel, whose ray is the z axis, unless `size` = (width, height) says otherwise; `film` replaces the box filter.
    """
    return _load


@pytest.fixture
def see() -> Callable[..., Array]:
    """Load and draw a scene with one sample a pixel, or `spp`; (height, width, channels). Further as `scene_of`."""

    def draw(*args: Any, spp: int = 1, **kwargs: Any) -> Array:
        scene = _load(*args, **kwargs)
        return np.array(mi.render(scene, spp=spp), dtype=np.float64)

    return draw


@pytest.fixture
def directions() -> Callable[..., Array]:
    """Give the unit rays of the default sensor, from the model's formula: (height, width, 3)."""

    def make(width: int, height: int) -> Array:
        fx, fy = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
        return unit(np.stack([1 - 2 * fx, (1 - 2 * fy) * height / width, np.ones_like(fx)], axis=-1))

    return make


def unit(v: Array) -> Array:
    """Normalise vectors along the last axis."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _slope(colour: Colour, d: Array) -> Array:
    """Bound how fast the colour changes when the ray turns: the sum over two directions across it."""
    across = unit(np.cross(d, np.eye(3)[np.argmin(np.abs(d), axis=-1)]))
    steps = [STEP * across, STEP * np.cross(d, across)]
    return sum(np.abs(colour(unit(d + s)) - colour(unit(d - s))) for s in steps) / (2 * STEP)


@pytest.fixture
def agree() -> Callable[..., None]:
    """Compare a picture with the derived colour: `agree(picture, colour, d, condition, hits)`.

    `colour` is a function of the unit rays `d` : (..., 3), or, where the ray does not matter, the colour itself.
    """

    def compare(
        picture: Array,
        colour: Colour | Array | float,
        d: Array | None = None,
        condition: float | Array = 1.0,
        hits: int = 1,
    ) -> None:
        expected = colour(d) if callable(colour) else np.asarray(colour, float)
        slope = _slope(colour, d) if callable(colour) else 0.0
        limit = np.broadcast_to(hits * ROUNDING * (slope + condition * np.abs(expected)), picture.shape)
        expected = np.broadcast_to(expected, picture.shape)
        worst = np.unravel_index(np.argmax(np.abs(picture - expected) - limit), picture.shape)
        assert np.all(np.abs(picture - expected) <= limit), (
            f"at (row, column, channel) {tuple(map(int, worst))}: drawn {picture[worst]}, derived {expected[worst]}, "
            f"bound {limit[worst]:.2g}; {np.count_nonzero(np.abs(picture - expected) > limit)} values are off"
        )

    return compare
