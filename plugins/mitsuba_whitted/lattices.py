"""Where the samples of an average lie: lattices in a cell, for each number of samples the one that edges fit best.

Sample k of n is at (k + 1/2) / n across and s + k g (modulo 1) down, then moved towards the centre for the corners,
which count too (`of_corners`).
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted.tables import fetch, index_column

BEST = (
    (0.4500, 0.2750), (0.3717, 0.4417), (0.3719, 0.4031), (0.3566, 0.7518), (0.3772, 0.4027), (0.3854, 0.3800),
    (0.2855, 0.7870), (0.3956, 0.3451), (0.3826, 0.7479), (0.3947, 0.3504), (0.3957, 0.3452), (0.2806, 0.2732),
    (0.4149, 0.3140), (0.3774, 0.4049), (0.3870, 0.3885), (0.2872, 0.6118), (0.2784, 0.2893), (0.2863, 0.4898),
    (0.2830, 0.2654), (0.4211, 0.2883), (0.4181, 0.4290), (0.4271, 0.2494), (0.4278, 0.3745), (0.4206, 0.8244),
    (0.4284, 0.3642), (0.3789, 0.3378), (0.4207, 0.4067), (0.3804, 0.3248), (0.4205, 0.6712), (0.3789, 0.3394),
    (0.2958, 0.4783), (0.3796, 0.3864),
)  # fmt: skip
"""Steps g and starts s of the lattices of 2, 4, 6 ... samples: the best that a search at random has found.

Over all straight lines that meet the cell and part it in two colours, the mean square of an average's error is a
quarter of an energy of its samples and corners as they are weighted: twice their mean distance from all points of the
cell, less their mean distance from one another and less that of any two points of the cell; for what parts two points
is as likely as they are far apart (Crofton 1868, Szekely and Rizzo 2013). Lattices were sought that have the least of
it, among those that two halves tell equally well of: the error of the mean is 0.27 to 0.33 of how much the means of the
halves differ. It is 0.92 times that of lattices by the golden ratio, in the geometric mean (a test compares them).
"""

GOLDEN = (5**0.5 - 1) / 2
"""Step of lattices of more samples: evenly spread for any number (Niederreiter 1992, chapter 3)."""


_ROWS = np.rint(np.array((*BEST, (GOLDEN, GOLDEN / 2))) * 2.0**32)
"""All of these in units of 2^-32: of floats k g would lose its fraction where k is large."""


def point(k: Any, count: Any) -> Any:
    """Find sample `k`, from 0, of `count`, which is even: a point, in sides of the cell."""
    row = dr.minimum(count // 2 - 1, len(BEST))
    step, start = fetch(mi.Vector2u, index_column(_ROWS), row)
    down = k * step + start  # modulo 1
    n = mi.Float(count)
    at = mi.Point2f((mi.Float(k) + 0.5) / n, mi.Float(down >> 8) * 2.0**-24)
    return dr.lerp(at, mi.Point2f(0.5), of_corners(n))


def of_corners(count: Any) -> Any:
    """Tell the share w of the corners, which are known already, in an average of so many samples.

    Each of them counts as half a sample where these are many, and less where they are few; fitted. The samples move
    towards the centre by the same share: the mean square of their distance from it, corners and all, then stays that
    of the cell but for a part 3 w^2 - w^3, so that what is quadratic keeps its mean. With both, the error of random
    edges is 0.8 times that of the samples alone if there are 6, 0.9 times if 16.
    """
    return 2 * dr.rcp(count + 4)
