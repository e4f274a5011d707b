"""A process that draws one configuration of one scene, on command."""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from whitted_validation.benchmark.speed_configurations import BY_NAME, Configuration, Unavailable

TICK = 1 / os.sysconf("SC_CLK_TCK")
"""Seconds: systems that count a process's CPU time in ticks count in these."""

PATIENCE = 300.0
"""Seconds without an answer after which a process is given up."""

WARM_UP = 2
"""Pictures drawn after the first, which compiles, and before the clock starts: caches and memory pools fill."""

LAUNCHES = 20

EDITED = ("diffuse_reflectance.value", "intensity.value", "irradiance.value", "camera.to_world", "ball_0.to_world")
"""Ends of the keys that `mi.traverse` gives to a value of each sort."""


class Sample(NamedTuple):
    """Seconds a picture, the mean of some drawn one after the other."""

    wall: float
    cpu: float
    """Of all threads of the process."""


@dataclass(frozen=True)
class Facts:
    """What a process knows of its configuration after the first picture.

    Attributes
    ----------
    side : size of the picture in pixels
    kernels : hashes of the compiled kernels of one picture
    operations : in them, by Dr.Jit's count
    loaded_mb, first_mb, peak_mb : most memory of the process before the first picture, after it, after several
    one : seconds for a picture
    tick : of the clock that times it, in seconds
    """

    side: int
    kernels: tuple[str, ...]
    operations: int
    loaded_mb: float
    first_mb: float
    peak_mb: float
    one: Sample
    tick: float = TICK


class Failed(Exception):
    """A process has ended, or does not answer."""


class Worker:
    """The near end of the pipe; a context manager that ends the process."""

    def __init__(self, name: str, file: Path, size: int) -> None:
        self.name = name
        context = multiprocessing.get_context("spawn")
        self._pipe, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(far, name, file, size), daemon=True)
        self._process.start()
        far.close()
        self.facts: Facts
        try:
            self.facts = self._answer()
        except BaseException:
            self._end()
            raise

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, _type: type[BaseException] | None, _value: object, _where: TracebackType | None) -> None:
        self._end()

    def sample(self, pictures: int) -> Sample:
        """Draw so many pictures and take the time."""
        sample: Sample = self.ask("sample", pictures)
        return sample

    def ask(self, what: str, *arguments: Any) -> Any:
        """Have one of `_ANSWERS` called."""
        self._pipe.send((what, arguments))
        return self._answer()

    def _answer(self) -> Any:
        try:
            if not self._pipe.poll(PATIENCE):
                raise Failed(f"no answer in {PATIENCE:.0f} s")
            answer = self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join(1)
            raise Failed(f"the process ended with code {self._process.exitcode}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _end(self) -> None:
        self._process.terminate()
        self._process.join()
        self._pipe.close()


def _serve(pipe: Connection, name: str, file: Path, size: int) -> None:
    """Prepare, send the facts, and then answer until the pipe is closed. Ctrl-C is the other end's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        bench = _Bench(BY_NAME[name], file, size)
        pipe.send(bench.facts())
        while True:
            what, arguments = pipe.recv()
            pipe.send(_ANSWERS[what](bench, *arguments))
    except EOFError:
        return
    except Unavailable as error:
        pipe.send(error)
    except Exception as error:  # whatever a changed plugin or another program may raise is a finding
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, Unavailable):
            cause = cause.__cause__ or cause.__context__
        pipe.send(cause if isinstance(cause, Unavailable) else Failed(text))


class _Bench:
    """The far end: a prepared configuration."""

    def __init__(self, configuration: Configuration, file: Path, size: int) -> None:
        self.file = file
        self._jit = configuration.variant.startswith(("llvm", "cuda"))
        if configuration.variant:
            import mitsuba_whitted  # noqa: F401  # isort: skip  # before Mitsuba
            import mitsuba as mi

            mi.set_variant(configuration.variant)
            mi.set_log_level(mi.LogLevel.Error)
        if configuration.prepare is None:
            raise Unavailable(f"{configuration.name} is another program")
        for change in configuration.changes:
            change()
        self.side = min(size, configuration.side or size)
        self._draw = configuration.prepare(file, self.side)

    def facts(self) -> Facts:
        """Draw for the first time, and then until warm."""
        loaded = _peak_mb()
        self.picture()
        first = _peak_mb()
        kernels = self._kernels_of(self.picture)
        for _ in range(WARM_UP if self._jit else 0):
            self.picture()
        one = self.sample(1)
        hashes = tuple(sorted(str(kernel["hash"]) for kernel in kernels))
        operations = sum(int(kernel["operation_count"]) for kernel in kernels)
        return Facts(self.side, hashes, operations, loaded, first, _peak_mb(), one)

    def picture(self) -> Any:
        """Draw one, to its end."""
        picture = self._draw()
        if self._jit:
            import drjit as dr

            dr.eval(picture)
            dr.sync_thread()
        return picture

    def sample(self, pictures: int) -> Sample:
        """Draw so many and take the time of one."""
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(pictures):
            self.picture()
        return Sample((time.perf_counter() - wall) / pictures, (time.process_time() - cpu) / pictures)

    def pixels(self) -> Any:
        """Return the picture, (side, side, 3) float32."""
        return np.array(self.picture(), np.float32)

    def rays(self) -> dict[str, int]:
        """Count the rays of the plugin's picture by kind."""
        scene, integrator = self._scene()
        counted: dict[str, int] = integrator.count_rays(scene)
        return counted

    def plan(self) -> str:
        """Return the plan in words."""
        scene, integrator = self._scene()
        return str(integrator.plan(scene))

    def launch(self) -> float:
        """Return the seconds of this thread until a picture is started: the median of `LAUNCHES`."""
        import drjit as dr

        scene, integrator = self._scene()
        times = []
        for _ in range(1 + LAUNCHES):
            start = time.thread_time()
            picture = integrator.render(scene, evaluate=False)
            times.append(time.thread_time() - start)
            dr.sync_thread()
            del picture
        return statistics.median(times[1:])  # the first has read the scene

    def edits(self) -> dict[str, int]:
        """Edit a value of each sort, and count the kernels that were compiled for the next picture."""
        import mitsuba as mi

        scene, integrator = self._scene()
        integrator.render(scene)
        compiled = {}
        parameters: Any = mi.traverse(scene)
        keys = list(parameters.keys())
        for ending in EDITED:
            for key in [key for key in keys if key.endswith(ending)][:1]:
                value = parameters[key]
                moved = value @ mi.Transform4f().translate([0.125, 0, 0]) if "to_world" in key else value * 0.5
                parameters[key] = moved
                parameters.update()
                kernels = self._kernels_of(lambda: integrator.render(scene))
                compiled[key] = sum(not kernel["cache_hit"] for kernel in kernels)
        return compiled

    def _scene(self) -> tuple[Any, Any]:
        """Load the scene once more, with its integrator."""
        from whitted_validation.benchmark.speed_configurations import load

        scene = load(self.file, self.side)
        return scene, scene.integrator()

    def _kernels_of(self, draw: Callable[[], Any]) -> list[dict[str, Any]]:
        """Draw, and list the kernels that Dr.Jit has launched."""
        if not self._jit:
            return []
        import drjit as dr

        dr.kernel_history_clear()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            draw()
        return [kernel for kernel in dr.kernel_history() if kernel["type"] == dr.KernelType.JIT]


_ANSWERS: dict[str, Callable[..., Any]] = {
    "sample": _Bench.sample,
    "pixels": _Bench.pixels,
    "rays": _Bench.rays,
    "plan": _Bench.plan,
    "launch": _Bench.launch,
    "edits": _Bench.edits,
    "memory": lambda _bench: _peak_mb(),
}


def _peak_mb() -> float:
    """Return the most memory that this process has had, in 10^6 bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6  # in KiB on Linux
