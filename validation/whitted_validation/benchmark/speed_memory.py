"""The largest picture: how much memory a process takes that draws it to a file."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from whitted_validation.benchmark.speed_start import OURS
from whitted_validation.benchmark.speed_worker import Failed

SIDE = 16384

MOST_MB = 400.0

PERIOD = 0.02
"""Seconds between two looks at the process."""


@dataclass(frozen=True)
class Large:
    """Most memory of the process, in 10^6 bytes, and whether it was stopped for taking twice what is allowed."""

    side: int
    peak_mb: float
    stopped: bool


def draw_large(file: Path, folder: Path, side: int = SIDE, most_mb: float = MOST_MB) -> Large:
    """Draw a scene of `scenes` with `whitted render` to a file in the folder."""
    picture = folder / "large.npy"
    arguments = ["render", str(file), "-m", "llvm_ad_rgb", "-D", f"size={side}", "-o", str(picture)]
    peak = 0.0
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen([sys.executable, "-c", OURS, *arguments], stdout=said, stderr=said)
        try:
            while process.poll() is None:
                peak = max(peak, _resident_mb(process.pid))
                if peak > 2 * most_mb:
                    return Large(side, peak, True)
                time.sleep(PERIOD)
        finally:
            process.kill()
            process.wait()
        if process.returncode:
            said.seek(0)
            raise Failed(" ".join(said.read().decode(errors="replace").split()))
    picture.unlink()
    return Large(side, peak, False)


def _resident_mb(pid: int) -> float:
    """Read the memory of a process from where Linux keeps it; 0 where it has just ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return max((float(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("VmRSS:")), default=0.0)
