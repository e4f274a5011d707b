"""Who may import whom: the witness copies nothing, and the plugins stay small enough to be read."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

ALLOWED = {
    "plugins/mitsuba_whitted": {"mitsuba_whitted", "mitsuba", "drjit", "numpy"},
    "validation/whitted_reference": {"whitted_reference"},
}
"""Folder to what its modules may import besides the standard library."""

SPECIAL = {"plugins/mitsuba_whitted/polygon.py": {"shapely"}}
"""What a single module may import on top of that."""


def imports(source: str) -> Iterator[str]:
    """Top-level names of all packages that a piece of source imports, wherever in it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports are not used here"
            assert node.module
            yield node.module.split(".")[0]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "__import__")):
            yield from (
                str(argument.value).split(".")[0] for argument in node.args if isinstance(argument, ast.Constant)
            )


def forbidden(source: str, allowed: set[str]) -> set[str]:
    """List imports that are neither allowed nor of the standard library."""
    return set(imports(source)) - allowed - sys.stdlib_module_names


def modules(folder: str) -> list[str]:
    """Paths of a package's modules, relative to the root."""
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize("module", [module for folder in ALLOWED for module in modules(folder)])
def test_a_module_imports_only_what_its_package_may(module: str) -> None:
    allowed = ALLOWED["/".join(module.split("/")[:2])] | SPECIAL.get(module, set())
    assert forbidden((ROOT / module).read_text(), allowed) == set()


@pytest.mark.parametrize("module", modules("plugins") + modules("validation"))
def test_no_module_imports_tests(module: str) -> None:
    assert not {"tests", "conftest", "pytest"} & set(imports((ROOT / module).read_text()))


@pytest.mark.parametrize(
    "source",
    [
        "import numpy",
        "import numpy.linalg as la",
        "from mitsuba_whitted import precise",
        "def f():\n    import drjit as dr",
        "import importlib\nimportlib.import_module('mitsuba_whitted.precise')",
        "__import__('shapely')",
    ],
)
def test_the_check_finds_a_forbidden_import(source: str) -> None:
    assert len(forbidden(source, ALLOWED["validation/whitted_reference"])) == 1


def loaded(code: str) -> set[str]:
    """Top-level names of the modules that are loaded after running a piece of Python on its own."""
    report = f"{code}\nimport sys\nprint(*{{name.split('.')[0] for name in sys.modules}})"
    result = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=True)
    return set(result.stdout.splitlines()[-1].split())


OURS_AND_THEIRS = {
    "mitsuba_whitted",
    "whitted_validation",
    "mitsuba",
    "drjit",
    "numpy",
    "shapely",
    "click",
    "rich",
}


def test_the_reference_runs_on_the_standard_library_alone() -> None:
    names = [module.removesuffix(".py").split("/", 1)[1] for module in modules("validation/whitted_reference")]
    imports_all = "\n".join(f"import {name.removesuffix('/__init__').replace('/', '.')}" for name in names)
    assert not loaded(imports_all) & OURS_AND_THEIRS


def test_the_same_look_finds_numpy_where_it_is_loaded() -> None:
    assert {"numpy", "mitsuba", "drjit"} <= loaded("import mitsuba_whitted, numpy")


@pytest.mark.parametrize("arguments", [["--help"], ["render", "--help"], ["scenes"], ["--version"]])
def test_light_commands_import_nothing_heavy(arguments: list[str]) -> None:
    heavy = OURS_AND_THEIRS - {"whitted_validation", "click", "rich"}
    assert not loaded(f"from whitted_validation.cli import run\nrun({arguments})") & heavy


def test_importing_the_plugins_does_not_import_shapely() -> None:
    code = "import mitsuba_whitted, mitsuba as mi\nmi.set_variant('scalar_rgb')"
    assert "shapely" not in loaded(code)
