"""What is measured: one table of configurations, each a way to draw a scene.

A configuration prepares itself in a process of its own, so that it may replace any function of the plugin there.
Where the plugin has no such function, the configuration is unavailable, and says which one is missing.
"""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi

from whitted_validation.benchmark.floor import Floor
from whitted_validation.benchmark.limit import Limit
from whitted_validation.benchmark.speed_native import with_native_materials

Draw = Callable[[], Any]
"""Starts one picture; evaluating the result finishes it."""


class Unavailable(Exception):
    """Nothing in this version of the plugin that the configuration could switch off."""


@dataclass(frozen=True)
class Configuration:
    """A way to draw a scene.

    Attributes
    ----------
    family : what it is measured for, see `FAMILIES`
    words : what it draws, or what it leaves out
    prepare : from the scene's file and its size in pixels to the picture; runs in a process of its own. None for
        POV-Ray, which is one
    changes : replaces parts of the plugin before that
    variant : of Mitsuba; empty for none
    side : size of its picture where it is too slow for the asked one; times are compared per pixel
    in_kernel : whether its kernel is another one where it makes a difference
    """

    name: str
    family: str
    words: str
    prepare: Callable[[Path, int], Draw] | None
    changes: tuple[Callable[[], None], ...] = ()
    variant: str = "llvm_ad_rgb"
    side: int | None = None
    in_kernel: bool = True


FAMILIES = {
    "plugin": "The plugin and the bare rays",
    "control": "Controls: the harness itself",
    "skip": "What the plan leaves out, put back one by one",
    "remedy": "Remedies against rounding, taken out one by one",
    "peer": "Other ways to draw the same scene",
}


def load(file: Path, size: int) -> mi.Scene:
    """Load a scene of `scenes` at this size."""
    scene: mi.Scene = mi.load_file(str(file), optimize=False, size=str(size))
    return scene


def _whitted(file: Path, size: int) -> Draw:
    scene = load(file, size)
    integrator: Any = scene.integrator()
    return lambda: integrator.render(scene)


def _twice(file: Path, size: int) -> Draw:
    draw = _whitted(file, size)

    def both() -> Any:
        dr.eval(draw())
        return draw()

    return both


def _with_epsilon(file: Path, size: int) -> Draw:
    """Draw with the textbook's epsilon, in a scene some 10 wide."""
    scene = load(file, size)
    integrator: Any = scene.integrator()
    integrator.settings = dataclasses.replace(integrator.settings, epsilon=1e-4)
    return lambda: integrator.render(scene)


def _limit(file: Path, size: int) -> Draw:
    return Limit(file, size).draw


def _floor(file: Path, size: int) -> Draw:
    try:
        return Floor(file, size).draw
    except ValueError as error:
        raise Unavailable(str(error)) from None


def _native(integrator: dict[str, Any], native_materials: bool) -> Callable[[Path, int], Draw]:
    def prepare(file: Path, size: int) -> Draw:
        scene = load(with_native_materials(file) if native_materials else file, size)
        drawn_by = mi.load_dict(integrator)
        return lambda: mi.render(scene, integrator=drawn_by, spp=1)

    return prepare


def _reference(file: Path, size: int) -> Draw:
    import whitted_reference
    from whitted_validation.validation import Here

    scene = whitted_reference.load(file, {"size": str(size)})
    return lambda: whitted_reference.render(scene, executor=Here())


def _replace(module: str, path: str, make: Callable[[Any], Any]) -> Callable[[], None]:
    """Make the change that puts ``make(old)`` in the place of an attribute of the plugin, or of its class."""

    def change() -> None:
        try:
            owner: Any = importlib.import_module(f"mitsuba_whitted.{module}")
            *classes, name = path.split(".")
            for each in classes:
                owner = getattr(owner, each)
            old = getattr(owner, name)
        except (ModuleNotFoundError, AttributeError):
            raise Unavailable(f"this version of the plugin has no {module}.{path}") from None
        setattr(owner, name, make(old))

    return change


def _plan(**parts: Any) -> Callable[[], None]:
    """Make the change that sets parts of every plan."""

    def replaced(plan_of: Any) -> Any:
        def plan(*arguments: Any) -> Any:
            found = plan_of(*arguments)
            missing = [name for name in parts if not hasattr(found, name)]
            if missing:
                raise Unavailable(f"this version's plan has no {', '.join(missing)}")
            return dataclasses.replace(found, **parts)

        return plan

    return _replace("integrator", "plan_of", replaced)


def _after_init(attribute: str, value: Any) -> Callable[[Any], Any]:
    """Make the constructor that sets an attribute at its end."""

    def make(init: Any) -> Any:
        def initialise(self: Any, *arguments: Any, **named: Any) -> None:
            init(self, *arguments, **named)
            if not hasattr(self, attribute):
                raise Unavailable(f"this version of the plugin has no {type(self).__name__}.{attribute}")
            setattr(self, attribute, value)

        return initialise

    return make


def _otherwise_coherent() -> None:
    """Tell Embree the opposite of whether rays are alike."""
    for name in ("ray_intersect_preliminary", "ray_test"):
        asked = getattr(mi.Scene, name)

        def ask(self: Any, ray: Any, *, coherent: bool, active: Any, _asked: Any = asked) -> Any:
            return _asked(self, ray, coherent=not coherent, active=active)

        setattr(mi.Scene, name, ask)


def _not_robust() -> None:
    """Make Embree's scenes without the flag that closes the edges of meshes."""
    load_dict: Any = mi.load_dict

    def load_fast(parts: Any, *arguments: Any, **named: Any) -> Any:
        return load_dict(
            {k: v for k, v in parts.items() if k != "embree_use_robust_intersections"}, *arguments, **named
        )

    setattr(mi, "load_dict", load_fast)  # noqa: B010  # its type is not that of a function in Python


def _single() -> None:
    """Put single precision where the plugin asks for double."""
    for double in ("Vector3d", "Vector4d", "Point3d", "Normal3d"):
        setattr(mi, double, getattr(mi, f"{double[:-1]}f"))
    setattr(mi, "Float64", mi.Float)  # noqa: B010  # as it is a type, mypy would not have it assigned


def _always(_old: Any) -> Any:
    """Ask for every light, whichever side of the horizon it is on."""
    return lambda self, ray, _active, *rest: _old(self, ray, mi.Bool(True), *rest)


def _no_branch(_old: Any) -> Any:
    """Follow both ways of a branch, and choose afterwards."""

    def both(arguments: Any, condition: Any, true: Any, false: Any, **_: Any) -> Any:
        return tuple(dr.select(condition, x, y) for x, y in zip(true(*arguments), false(*arguments), strict=True))

    return both


_THE_LOOP = _plan(mirrors=True)
_HIGHLIGHT = _plan(specular=True)
_BACKS = _replace("materials", "has_backs", lambda _: lambda _sides: True)
_TEXTURED = _plan(textured=True)
_COORDINATES = _replace("stage", "Stage._find_textured", lambda _: lambda self: None)
_EMISSION = _plan(emission=True)
_EMBREE_ALONE = _replace("surfaces", "few_of", lambda _: lambda *_: [])
_ROW_BY_ROW = _replace("film", "TILE", lambda _: 1)
_BRANCHLESS = _replace("trace", "dr.if_stmt", _no_branch)
_ASK_ALL = _replace("surfaces", "Surfaces.blocked", _always)
_INSIDE = _plan(inside=True)
_TABLES = _replace("tables", "FEW_ROWS", lambda _: 0)
_NORMALS = _replace("surfaces", "FEW_PLANES", lambda _: 0)
_EMBREE_FOR_BALLS = _replace("few", "MOST_ALONE", lambda _: 0)
_ALL_CAST = _replace("stage", "casters", lambda _: lambda _graph, _rows, few, *_rest: set(few))

_PLAIN_POWER = _replace(
    "precise", "specular_power", lambda _: lambda n, h, p: dr.power(dr.maximum(dr.dot(n, h), 1e-20), p)
)
_RAY_TEST = _replace("accel", "Accel.__init__", _after_init("_round", False))

_WITHOUT_FEW = (_EMBREE_ALONE, _ALL_CAST)
_GENERAL = (_THE_LOOP, _HIGHLIGHT, _BACKS, _TEXTURED, _COORDINATES, _EMISSION, _TABLES, _NORMALS, *_WITHOUT_FEW)

PLANNED, POVRAY = "planned", "povray"

CONFIGURATIONS = (
    Configuration(PLANNED, "plugin", "the plugin as it is", _whitted),
    Configuration("limit", "plugin", "Embree's answers to the same rays and nothing else", _limit),
    Configuration("floor", "plugin", "balls on a floor by hand: rays, hits, light and film, and no plan", _floor),
    Configuration(
        "general",
        "plugin",
        "Embree alone, and the loop, highlights, backs, textures, emission and tables in every kernel",
        _whitted,
        _GENERAL,
    ),
    Configuration("same", "control", "the plugin as it is, once more: the ratio is 1", _whitted, in_kernel=False),
    Configuration("twice", "control", "each picture drawn twice: the ratio is 2", _twice, in_kernel=False),
    Configuration("embree", "skip", "Embree searches among few shapes too", _whitted, _WITHOUT_FEW),
    Configuration("hybrid", "skip", "few balls through Embree, few rectangles not", _whitted, (_EMBREE_FOR_BALLS,)),
    Configuration("tables", "skip", "tables, where few shapes are constants", _whitted, (_TABLES,)),
    Configuration("casters", "skip", "shadow rays try what can throw no shadow", _whitted, (_ALL_CAST,)),
    Configuration("loop", "skip", "the loop over mirror bounces, without mirrors", _whitted, (_THE_LOOP,)),
    Configuration("backs", "skip", "the back of surfaces, though none is two-sided", _whitted, (_BACKS,)),
    Configuration("emission", "skip", "glowing surfaces, though none glows", _whitted, (_EMISSION,)),
    Configuration("inside", "skip", "rays that might begin inside a ball", _whitted, (_INSIDE,)),
    Configuration("branch", "skip", "lights below the horizon are shaded, then dropped", _whitted, (_BRANCHLESS,)),
    Configuration("horizon", "skip", "and shadow rays are sent there", _whitted, (_BRANCHLESS, _ASK_ALL)),
    Configuration("rows", "skip", "pixels row by row, not in tiles", _whitted, (_ROW_BY_ROW,)),
    Configuration(
        "coherence", "skip", "Embree is told the opposite of whether rays are alike", _whitted, (_otherwise_coherent,)
    ),
    Configuration("single", "remedy", "hits, normals and mirrors in single precision too", _whitted, (_single,)),
    Configuration("power", "remedy", "(n.h)^p from the rounded cosine", _whitted, (_PLAIN_POWER,)),
    Configuration("epsilon", "remedy", "the textbook's epsilon, 1e-4, on all rays", _with_epsilon),
    Configuration("ray_test", "remedy", "shadow rays of balls by Mitsuba's `ray_test`", _whitted, (_RAY_TEST,)),
    Configuration("fast_flag", "remedy", "Embree without its robust flag", _whitted, (_not_robust,), in_kernel=False),
    Configuration(
        "no_remedy",
        "remedy",
        "none of the remedies",
        _with_epsilon,
        (_single, _PLAIN_POWER, _not_robust),
    ),
    Configuration(
        "path",
        "peer",
        "Mitsuba's `path`, the same materials",
        _native({"type": "path", "max_depth": 10}, native_materials=False),
    ),
    Configuration(
        "direct", "peer", "Mitsuba's `direct`, the same materials", _native({"type": "direct"}, native_materials=False)
    ),
    Configuration(
        "path_native",
        "peer",
        "Mitsuba's `path`, its own diffuse and conductor",
        _native({"type": "path", "max_depth": 10}, native_materials=True),
    ),
    Configuration(
        "direct_native",
        "peer",
        "Mitsuba's `direct`, its own diffuse and conductor",
        _native({"type": "direct"}, native_materials=True),
    ),
    Configuration(POVRAY, "peer", "POV-Ray: the time that it traces", None),
    Configuration("scalar", "peer", "the plugin in scalar_rgb", _whitted, variant="scalar_rgb", side=32),
    Configuration("reference", "peer", "the reference tracer in plain Python", _reference, variant="", side=32),
)

BY_NAME = {configuration.name: configuration for configuration in CONFIGURATIONS}
