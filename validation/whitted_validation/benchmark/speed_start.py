"""From the command line to the picture: whole processes, with a cold and with a warm cache of kernels."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from whitted_validation.benchmark.speed_native import with_native_materials
from whitted_validation.benchmark.speed_pairs import Interval, interval
from whitted_validation.benchmark.speed_worker import Failed, Sample

SIZE = 256

CACHE = "DRJIT_CACHE_DIR"
"""Names the folder where Dr.Jit keeps compiled kernels."""

BYTECODE = "PYTHONPYCACHEPREFIX"
"""Names the folder where Python keeps compiled modules; pip compiles those that it installs."""

OURS = "import sys; from whitted_validation.cli import main; main()"
"""What the command `whitted` is."""

BARE = f"""import sys
import drjit as dr
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = mi.load_file(sys.argv[1], size="{SIZE}")
dr.eval(mi.render(scene, spp=1))
dr.sync_thread()
"""


@dataclass(frozen=True)
class Start:
    """Time of `whitted render` over that of a bare script that draws the same scene with `path`.

    Attributes
    ----------
    cache : cold or warm
    ours, bare : all samples
    """

    cache: str
    wall: Interval
    cpu: Interval
    ours: list[Sample]
    bare: list[Sample]


def start(file: Path, folder: Path, cache: str, pairs: int, told: Callable[[], None] = lambda: None) -> Start:
    """Draw a scene of `scenes` in whole processes, ours and the bare script in turn.

    The script writes no picture; ours writes a .npy, which costs next to nothing.

    Parameters
    ----------
    folder : for the picture, and the private caches
    cache : cold: every process finds an empty folder for its kernels; warm: one that an earlier process has filled
    """
    scene = ["render", str(file), "-m", "llvm_ad_rgb", "-D", f"size={SIZE}", "-o", str(folder / "start.npy")]
    commands = {"ours": ["-c", OURS, *scene], "bare": ["-c", BARE, str(with_native_materials(file))]}
    with tempfile.TemporaryDirectory(dir=folder) as kept:
        for arguments in commands.values():
            timed(arguments, {CACHE: kept, BYTECODE: kept})
        taken: dict[str, list[Sample]] = {"ours": [], "bare": []}
        for number in range(pairs):
            for name in ("bare", "ours")[:: -1 if number % 2 else 1]:
                with tempfile.TemporaryDirectory(dir=folder) as empty:
                    used = kept if cache == "warm" else empty
                    taken[name].append(timed(commands[name], {CACHE: used, BYTECODE: kept}))
            told()
    pairs_taken = list(zip(taken["ours"], taken["bare"], strict=True))
    wall, cpu = (interval([getattr(x, c) / getattr(y, c) for x, y in pairs_taken]) for c in ("wall", "cpu"))
    return Start(cache, wall, cpu, taken["ours"], taken["bare"])


def timed(arguments: Sequence[str], environment: Mapping[str, str]) -> Sample:
    """Run Python to its end, with the libLLVM that the plugin has chosen."""
    import mitsuba_whitted

    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    chosen = {"DRJIT_LIBLLVM_PATH": str(mitsuba_whitted.LIBLLVM.path)} if mitsuba_whitted.LIBLLVM.path else {}
    with tempfile.TemporaryFile() as said:
        began = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, *arguments], env={**inherited, **chosen, **environment}, stdout=said, stderr=said
        )
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:
            process.kill()
            process.wait()
            raise
        wall = time.perf_counter() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            lines = said.read().decode(errors="replace").split("\n")
            raise Failed(f"ended with code {process.returncode}: {' '.join(lines[-3:])}")
    return Sample(wall, usage.ru_utime + usage.ru_stime)
