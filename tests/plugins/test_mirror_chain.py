"""What one mirror gets wrong, sixty-four must not get wrong together."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted import precise


def test_a_normal_that_is_not_quite_a_unit_vector_turns_no_mirror_ray(llvm_ad_rgb: str) -> None:
    # d - 2 (d.n) n of an n too long by a factor 1 + s is turned by up to 2 s; here s = 2^-10.
    rng = np.random.default_rng(5)
    n, d = (rng.normal(size=(3, 4096)) for _ in range(2))
    n, d = (v / np.linalg.norm(v, axis=0) for v in (n, d))
    exact = d - 2 * (d * n).sum(axis=0) * n
    d_, n_ = mi.Vector3d(d), mi.Vector3d(n * (1 + 2.0**-10))
    r = precise.mirrored(d_, n_, dr.dot(d_, n_))
    # Roundings: of d.n and n.n 3 each, their quotient 2, doubled since they are in 2 (d.n) n; the sum; as many here.
    assert np.abs(np.array(r) - exact).max() <= 2 * 17 * 2.0**-53
