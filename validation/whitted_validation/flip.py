"""FLIP, the difference that an eye sees (Andersson et al. 2020 and 2021), where `flip-evaluator` is installed.

It is computed in a process of its own: on some pictures, such as one whose larger half is black, that package
prints a line and ends the whole process.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MOST_PIXELS = 1 << 22  # 2048 x 2048: about 4 microseconds a pixel and two exposures, and some scenes take ten

_PROGRAM = """
import json, sys
import numpy as np
import flip_evaluator
reference, test = np.load("reference.npy"), np.load("test.npy")
_, mean, _ = flip_evaluator.evaluate(reference, test, sys.argv[1], inputsRGB=False, applyMagma=False)
print(json.dumps(mean))
"""


@dataclass(frozen=True)
class Flip:
    """The mean over all pixels, 0 (none seen) to 1, or None; and how it came about, or why it did not."""

    mean: float | None
    note: str

    def __str__(self) -> str:
        return self.note if self.mean is None else f"{self.mean:.6f} ({self.note})"


def flip(test: NDArray[np.floating], reference: NDArray[np.floating], stepped: bool) -> Flip:
    """Compute the mean FLIP of two linear pictures, for 67 pixels a degree, the package's own default.

    Parameters
    ----------
    test, reference : (height, width, 1 or 3), linear; what is negative counts as 0
    stepped : both were 8- or 16-bit, so that a screen shows them as they are (LDR-FLIP); else HDR-FLIP, whose
        exposures follow from the reference
    """
    if importlib.util.find_spec("flip_evaluator") is None:
        return Flip(None, "not installed; pip install 'mitsuba-whitted[flip]'")
    height, width, _ = test.shape
    if height * width > MOST_PIXELS:
        return Flip(None, f"not computed above {MOST_PIXELS} pixels")
    if not (np.isfinite(test).all() and np.isfinite(reference).all()):
        return Flip(None, "not computed: nan or infinity in a picture")
    kind = "LDR" if stepped else "HDR"
    with tempfile.TemporaryDirectory() as folder:
        for name, values in (("test", test), ("reference", reference)):
            with np.errstate(over="ignore"):
                single = np.maximum(values, 0).astype(np.float32)
            np.save(Path(folder) / name, np.ascontiguousarray(np.broadcast_to(single, (height, width, 3))))
        path = os.pathsep.join(filter(None, sys.path))  # there is no other code in the folder where it runs
        run = subprocess.run(
            [sys.executable, "-c", _PROGRAM, kind],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            errors="replace",
        )
    try:
        mean = float(json.loads(run.stdout))
    except ValueError:
        said = (run.stdout + run.stderr).strip().splitlines() or [f"exit code {run.returncode}"]
        return Flip(None, f"not computed: flip-evaluator says: {said[-1]}")
    return Flip(mean, f"{kind}, 67 pixels a degree")
