"""One case under one policy: scenes loaded, probed and drawn."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import whitted_reference
from whitted_validation.stress.policies import Policy

Array = NDArray[np.float64]

QUICK_SHARE = 20
"""With --quick a twentieth of the probes."""


@dataclass
class Trial:
    """What a case may ask for.

    Attributes
    ----------
    folder : for scene files; the shipped meshes and textures lie in it
    workers : where the reference traces rows
    cache : where traced pictures are kept, or None
    known : what a case has found out for all policies: see `once`
    """

    policy: Policy
    quick: bool
    folder: Path
    workers: Executor
    cache: Path | None = None
    known: dict[str, Any] = field(default_factory=dict)

    def count(self, probes: int) -> int:
        """Return how many probes to send of so many."""
        return probes // QUICK_SHARE if self.quick else probes

    def random(self) -> np.random.Generator:
        """Return a source of the same numbers for every policy."""
        return np.random.default_rng(1980)

    def once(self, make: Callable[[], Any]) -> Any:
        """Make what does not depend on the policy, the first time that this case asks."""
        if "made" not in self.known:
            self.known["made"] = make()
        return self.known["made"]

    def write(self, text: str) -> Path:
        """Write a scene file, of another name for every text."""
        file = self.folder / f"stress_{hashlib.sha256(text.encode()).hexdigest()[:16]}.xml"
        file.write_text(text, encoding="utf-8")
        return file

    def load(self, file: Path) -> Any:
        """Load a scene into Mitsuba, to be drawn by the policy."""
        import mitsuba as mi

        scene = mi.load_file(str(file), parallel=False, optimize=False)
        integrator = scene.integrator()
        if self.policy.epsilon is not None:
            integrator.settings = dataclasses.replace(integrator.settings, epsilon=self.policy.epsilon)
        return scene

    def pair(self, text: str) -> tuple[Any, whitted_reference.Scene]:
        """Write a scene; load it into Mitsuba and, as exact numbers, into the reference."""
        file = self.write(text)
        return self.load(file), whitted_reference.load(file)

    def look(self, scene: Any, o: Array, d: Array) -> Array:
        """Return the colours, (n, 3), that rays from `o` along `d`, (n, 3), bring back: one kernel for all."""
        import mitsuba as mi

        ray = mi.Ray3f(mi.Point3f(o.T.astype(np.float32)), mi.Vector3f(d.T.astype(np.float32)))
        colour, _, _ = scene.integrator().sample(scene, None, ray, None, True)
        colours: Array = np.array(colour, np.float64).T
        return colours

    def follow(self, scene: Any, o: Array, d: Array) -> tuple[list[Array], list[NDArray[np.bool_]]]:
        """Return where chains of mirrors meet surfaces: points (n, 3) and whether they are there, bounce by bounce."""
        import drjit as dr
        import mitsuba as mi

        from mitsuba_whitted.camera import any_ray
        from mitsuba_whitted.plan import plan_of
        from mitsuba_whitted.trace import trace

        stage = scene.integrator()._set(scene)
        centre = stage.surfaces.centre
        points: list[Array] = []
        found: list[NDArray[np.bool_]] = []

        def note(what: str, **values: Any) -> None:
            if what == "surface":
                points.append(np.array(values["p"], np.float64).T + centre)
                found.append(np.array(values["found"]))

        ray = mi.Ray3f(mi.Point3f(o.T.astype(np.float32)), mi.Vector3f(d.T.astype(np.float32)))
        with dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, False):
            trace(stage, plan_of(stage), any_ray(ray, stage.surfaces.origin), True, note)
        return points, found

    def draw(self, scene: Any) -> Array:
        """Draw a picture, one sample a pixel."""
        import mitsuba as mi

        return np.array(mi.render(scene, spp=1), np.float64)
