"""The oracle of the benchmark of error, and the rays of each pixel that it chooses by."""

from __future__ import annotations

import itertools
from pathlib import Path

from mitsuba_whitted import LIBLLVM  # isort: skip  # before Mitsuba
import numpy as np
import pytest
from numpy.typing import NDArray

from whitted_validation.benchmark.error_oracle import OCTAVES, STEPS, Oracle

needs_llvm = pytest.mark.skipif(bool(LIBLLVM.refusal), reason=str(LIBLLVM.refusal))

U = 2.0**-53


@pytest.mark.parametrize("seed", range(4))
def test_the_oracle_takes_as_many_rays_as_its_error_needs_and_no_more_than_the_one_asked_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = rng.random((2, 2, 3), np.float32)
    pictures = truth + rng.normal(size=(4, 2, 2, 3)).astype(np.float32) * 2.0 ** -np.arange(4)[:, None, None, None]
    rays = np.cumsum(rng.integers(1, 9, (4, 2, 2)), axis=0).astype(np.uint32)
    oracle = Oracle(truth, list(pictures), list(rays))

    def rmse(picture: NDArray[np.float32]) -> float:
        return float(np.sqrt(np.mean((picture.astype(float) - truth) ** 2)))

    pixels = [(i, j) for i in range(2) for j in range(2)]
    ways = []
    for which in itertools.product(range(4), repeat=4):
        mixed = np.array([pictures[k][at] for k, at in zip(which, pixels, strict=True)]).reshape(2, 2, 3)
        ways.append((rmse(mixed), sum(int(rays[k][at]) for k, at in zip(which, pixels, strict=True))))
    largest = max(float(np.mean((picture - truth.astype(float)) ** 2, axis=2).max()) for picture in pictures)
    prices = [largest * 2.0 ** (-step / STEPS) for step in range(STEPS * OCTAVES)]
    tried = {min(ways, key=lambda way, price=price: 4 * way[0] ** 2 + price * way[1]) for price in prices}
    assert len(tried) > 3
    for bound in (0.0, *(rmse(picture) for picture in pictures)):
        chosen, taken = oracle.choose(bound)
        reached = rmse(chosen)
        assert (reached, taken) in ways
        assert not any(fewer < taken and error <= reached for error, fewer in ways)
        # Rounding: a mean of twelve squares here, one of four of three there.
        assert all(error > bound * (1 - 64 * U) for error, fewer in tried if fewer < taken)
        if bound:
            assert reached <= bound * (1 + 64 * U)
        else:
            assert reached == min(error for error, _ in ways)


LONELY = """<scene version="3.0.0">
<integrator type="whitted"/><emitter type="constant"/>{}
<sensor type="perspective"><float name="fov" value="90"/>
<transform name="to_world"><lookat origin="0,0,0" target="0,0,1" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="120"/><integer name="height" value="99"/><rfilter type="box"/></film>
</sensor></scene>"""


@needs_llvm
def test_rays_belong_to_the_pixels_that_their_samples_lie_in(tmp_path: Path, llvm_ad_rgb: None) -> None:
    from whitted_validation.benchmark.error_drawing import Drawing, pixels

    sky, body = tmp_path / "sky.xml", tmp_path / "body.xml"
    sky.write_text(LONELY.format(""))
    ball = '<shape type="sphere"><point name="center" x="0.5" y="0.3" z="1"/><float name="radius" value="0.1"/></shape>'
    body.write_text(LONELY.format(ball))
    corners = np.ones((99, 120), int)
    corners[:, -1] += 1
    corners[-1] *= 2
    assert np.array_equal(Drawing(sky).rays_by_pixel(0.03), corners)
    drawing = Drawing(body)
    found = drawing.rays_by_pixel(0.03)
    assert found.sum() == drawing.rays_to(0.03)
    edge = np.ptp([pixels(drawing.grid(n))[..., 0] for n in (1, 16)], axis=0) > 0  # seen in part
    # Colours are compared over four corners in a row.
    near = sum(np.roll(edge, (i, j), (0, 1)) for i in range(-3, 4) for j in range(-3, 4)) > 0
    assert np.any(found[edge] > 1)
    assert np.array_equal(found[~near], corners[~near])
