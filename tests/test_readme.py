"""The README's code runs, and its commands are those that there are."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def _blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("number", range(2))
def test_the_python_runs(tmp_path: Path, number: int) -> None:
    snippets = _blocks("python")
    assert len(snippets) == 2
    shutil.copy(ROOT / "scenes" / "lambert.xml", tmp_path / "scene.xml")
    script = snippets[number] + "\nassert image.shape[2] == 3\n"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_the_two_commands_are_the_agreed_ones() -> None:
    # A clone of its own for each would take minutes: the wheel is tested by test_packaging, the second is this run.
    assert [block.strip() for block in _blocks("sh")] == [
        "python3 -m venv .venv && .venv/bin/pip install -q . && "
        ".venv/bin/whitted render whitted_1980 -o whitted_1980.png",
        "python3 -m venv .venv && .venv/bin/pip install -q -e '.[test]' && .venv/bin/pytest",
    ]


def _help(*command: str) -> str:
    run = [sys.executable, "-c", "from whitted_validation.cli import main; main()", *command, "--help"]
    return subprocess.run(run, capture_output=True, text=True, timeout=60, check=True).stdout


def test_every_command_and_option_named_exists() -> None:
    commands = set(re.findall(r"`(?:\.venv/bin/)?whitted ([a-z]+)", README))
    listed = set(re.findall(r"^  ([a-z]+)  ", _help(), re.MULTILINE))
    assert commands <= listed
    lines = [line for line in README.splitlines() if re.search(r"`(?:\.venv/bin/)?whitted ", line)]
    options = {option for line in lines for option in re.findall(r"--[a-z-]+", line)}
    known = {option for command in listed for option in re.findall(r"--[a-z-]+", _help(command))}
    assert options - known == set()


def test_every_parameter_in_the_tables_is_in_the_manual_pages(llvm_ad_rgb: str) -> None:
    from mitsuba_whitted import blinn_phong, integrator, polygon

    for heading, module in (("`whitted`", integrator), ("`blinnphong`", blinn_phong), ("`polygon`", polygon)):
        section = README.split(f" {heading}\n", 1)[1].split("\n##", 1)[0]
        rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
        names = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
        assert names
        page = module.define().__doc__
        assert page is not None
        assert [name for name in names if name not in page] == []
