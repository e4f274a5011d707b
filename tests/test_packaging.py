"""What pip installs is whole: the wheel, built from the sdist, works without the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "mitsuba_whitted": "plugins",
    "whitted_reference": "validation",
    "whitted_validation": "validation",
}
SCENE_FILES = {
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "scenes").rglob("*")
    if path.is_file() and "__pycache__" not in path.parts
}


def run(*command: str | Path, cwd: Path, path: Path | None = None) -> str:
    """Run a command; `path` comes before everything that is installed."""
    environment = {**os.environ, "PYTHONPATH": str(path)} if path else os.environ
    result = subprocess.run(
        list(map(str, command)), cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the sdist from the checkout and the wheel from the sdist alone."""
    folder = tmp_path_factory.mktemp("build")
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder, cwd=ROOT)
    (sdist,) = folder.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    source = folder / sdist.name.removesuffix(".tar.gz")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=source)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel into a folder of its own; what it depends on is already there."""
    folder = tmp_path_factory.mktemp("installed")
    run(
        sys.executable,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
        "--target",
        folder,
        wheel,
        cwd=folder,
    )
    return folder


def test_the_wheel_holds_every_scene_module_page_and_licence(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    modules = {
        path.relative_to(ROOT / top).as_posix()
        for package, top in PACKAGES.items()
        for path in (ROOT / top / package).rglob("*")
        if path.suffix in (".py", ".js", ".css", ".html")
    }
    assert modules <= names
    assert {f"whitted_validation/{name}" for name in SCENE_FILES} <= names
    assert {f"{package}/py.typed" for package in PACKAGES} <= names
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


def test_the_wheel_holds_nothing_else(wheel: Path) -> None:
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(PACKAGES)


def test_the_installed_wheel_runs_from_another_folder(installed: Path, tmp_path: Path) -> None:
    for package in PACKAGES:
        where = f"import {package}\nprint({package}.__file__)"
        file = run(sys.executable, "-c", where, cwd=tmp_path, path=installed).strip()
        assert Path(file).is_relative_to(installed)
    run(installed / "bin" / "whitted", "render", "empty", "-o", "empty.npy", cwd=tmp_path, path=installed)
    assert [file.name for file in tmp_path.iterdir()] == ["empty.npy"]


def test_the_installed_scenes_are_those_of_the_checkout(installed: Path, tmp_path: Path) -> None:
    run(installed / "bin" / "whitted", "scenes", "--copy", "mine", cwd=tmp_path, path=installed)
    copied = {f"scenes/{path.relative_to(tmp_path / 'mine').as_posix()}": path for path in tmp_path.rglob("*.*")}
    for name in SCENE_FILES:
        assert copied[name].read_bytes() == (ROOT / name).read_bytes()


def test_the_package_under_test_runs_from_another_folder(tmp_path: Path) -> None:
    code = "from whitted_validation.cli import main\nmain()"
    listed = run(sys.executable, "-c", code, "scenes", cwd=tmp_path)
    assert {line.split()[0] for line in listed.splitlines()} == {path.stem for path in ROOT.glob("scenes/*.xml")}
