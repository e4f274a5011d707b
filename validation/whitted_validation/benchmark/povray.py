"""POV-Ray as a peer: the program is run on a scene, and its picture, its times and its counts are read."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whitted_reference import Scene
from whitted_validation.benchmark.povray_scene import source
from whitted_validation.benchmark.speed_configurations import Unavailable
from whitted_validation.benchmark.speed_worker import Facts, Failed, Sample
from whitted_validation.refusal import Refusal, one_line

PROGRAM = "povray"

PATIENCE = 600.0
"""Seconds after which a picture is given up."""

STEP = 1 / 65535
"""Between two values of its files, which end at 1."""

CLOCK = 1e-3
"""Seconds: so finely POV-Ray prints its times."""

Options = tuple[str, ...]

ONE_SAMPLE: Options = ("-A",)


class Drawn(NamedTuple):
    """One picture.

    Attributes
    ----------
    pixels : (height, width, 3), linear radiance
    exposure : that it was drawn with; a value is off by up to half a `STEP` of the file over this
    trace : seconds of the phase that traces, without start, parsing and writing
    parse : seconds of the phase that reads the scene
    whole : seconds until the program has ended
    rays : from the camera and from mirrors
    shadow_rays : towards lights
    """

    pixels: NDArray[np.float64]
    exposure: float
    trace: Sample
    parse: float
    whole: float
    rays: int
    shadow_rays: int


def version() -> str | None:
    """Ask POV-Ray for its version; None where it is not installed."""
    if shutil.which(PROGRAM) is None:
        return None
    said = _run(["--version"], Path(tempfile.gettempdir()))
    found = re.search(r"^POV-Ray (\S+)", said, re.MULTILINE)
    return found[1] if found else "unknown"


class PovRay:
    """A scene in POV-Ray.

    Parameters
    ----------
    description : what `whitted_reference.load` returns
    folder : an empty one is made in it
    brightest : value of the picture, so far as known: POV-Ray's files end at 1

    Raises
    ------
    Unavailable
        If POV-Ray is not installed, or cannot draw this scene; a `Failed` if it does not, while it should.
    """

    def __init__(self, description: Scene, folder: Path, brightest: float = 1.0) -> None:
        if shutil.which(PROGRAM) is None:
            raise Unavailable("POV-Ray is not installed")
        self._scene, self._folder = description, Path(tempfile.mkdtemp(prefix="povray_", dir=folder))
        try:
            self._exposed(2.0 ** -max(0, math.ceil(math.log2(brightest))) if brightest > 0 else 1.0)
        except Refusal as error:
            raise Unavailable(str(error)) from None
        film = description.sensors[0].film
        self.width, self.height = film.width, film.height

    def _exposed(self, exposure: float) -> None:
        self._exposure = exposure
        (self._folder / "scene.pov").write_text(source(self._scene, exposure), encoding="ascii")

    def draw(self, options: Options = ONE_SAMPLE) -> Drawn:
        """Draw a picture, darker until nothing in it reaches the file's end."""
        size = [f"+W{self.width}", f"+H{self.height}"]
        # Linear files of 16 bits; no window; no jitter; all processors; the default way to search, which is exact.
        fixed = ["+Iscene.pov", "+Opicture.ppm", "+FP16", "File_Gamma=1", "-D", "-V", "-J", "+BM1", "+Q9"]
        while True:
            began = time.perf_counter()
            said = _run([*fixed, *size, f"+WT{os.cpu_count()}", *options], self._folder)
            whole = time.perf_counter() - began
            pixels = _read_ppm(self._folder / "picture.ppm")
            if pixels.max(initial=0.0) < 1:
                break
            self._exposed(self._exposure / 2)
        trace, parse = _seconds("Trace", said), _seconds("Parse", said)
        rays, shadow_rays = (_count(name, said) for name in ("Rays", "Shadow Ray Tests"))
        return Drawn(pixels / self._exposure, self._exposure, trace, parse.wall, whole, rays, shadow_rays)


class Mode:
    """A way to have POV-Ray draw a scene, for `speed_pairs.compare`: by the time that it traces.

    Attributes
    ----------
    drawn : the first picture
    """

    def __init__(self, scene: PovRay, options: Options = ONE_SAMPLE) -> None:
        self._scene, self._options = scene, options
        self.drawn = scene.draw(options)
        nothing, one = math.nan, Sample(*(max(seconds, CLOCK) for seconds in self.drawn.trace))
        self.facts = Facts(scene.width, (), 0, nothing, nothing, nothing, one, CLOCK)

    def sample(self, pictures: int) -> Sample:
        """Draw so many and take the time of one."""
        taken = [self._scene.draw(self._options).trace for _ in range(pictures)]
        return Sample(*(sum(times) / pictures for times in zip(*taken, strict=True)))


def antialiased(method: int, threshold: float, depth: int) -> Options:
    """Return the options of antialiasing: method 1 or 2, up to depth x depth samples a pixel or (2^depth + 1)^2."""
    return f"+A{threshold:.6f}", f"+AM{method}", f"+R{depth}"


def _run(arguments: list[str], folder: Path) -> str:
    """Run POV-Ray in a folder, which it takes for the home of its settings too; return what it says."""
    environment = {name: value for name, value in os.environ.items() if name != "POVINI"} | {"HOME": str(folder)}
    try:
        done = subprocess.run(
            [PROGRAM, *arguments],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"POV-Ray: no picture in {PATIENCE:.0f} s") from None
    said = done.stdout.decode(errors="replace")
    if done.returncode:
        errors = [line for line in said.splitlines() if "rror" in line]
        raise Failed(one_line(f"POV-Ray ended with code {done.returncode}: {' '.join(errors)}"))
    return said


def _seconds(phase: str, said: str) -> Sample:
    found = re.search(rf"{phase} Time:.*?\(([\d.]+) seconds\)\s+using \d+ thread\(s\) with ([\d.]+) CPU", said)
    if found is None:
        raise Failed(f"POV-Ray does not say how long its phase `{phase}` took")
    return Sample(float(found[1]), float(found[2]))


def _count(name: str, said: str) -> int:
    """Read a number from the statistics, where zeros are left out."""
    found = re.search(rf"^{name}:\s+(\d+)", said, re.MULTILINE)
    return int(found[1]) if found else 0


def _read_ppm(file: Path) -> NDArray[np.float64]:
    """Read a PPM of 16 bits; its header may hold comments."""
    content = file.read_bytes() if file.exists() else b""
    head = re.match(rb"P6\s+(?:#[^\n]*\s+)*(\d+)\s+(\d+)\s+65535\s", content)
    if head is None:
        raise Failed("POV-Ray has written no PPM of 16 bits")
    width, height = int(head[1]), int(head[2])
    if len(content) != head.end() + 6 * width * height:
        raise Failed("POV-Ray's picture is cut off")
    return np.frombuffer(content, ">u2", offset=head.end()).reshape(height, width, 3) * STEP
