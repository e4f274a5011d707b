"""The notebook runs, and what is kept of it, with its page, is what it shows."""

from __future__ import annotations

import base64
import importlib.util
import json
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import mitsuba_whitted  # isort: skip  # before Mitsuba, whose libLLVM it chooses
import mitsuba as mi
import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "validation" / "notebook"
PICTURE = re.compile(r'src="data:image/png;base64,([^"]+)"')
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]\d+)?")


def notebook(folder: Path) -> dict[str, Any]:
    """Read the notebook of a folder."""
    read: dict[str, Any] = json.loads((folder / "textbook.ipynb").read_text(encoding="utf-8"))
    return read


@pytest.fixture(scope="module")
def again(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run the notebook once more, and write it to another folder."""
    if mitsuba_whitted.LIBLLVM.refusal:
        pytest.skip(mitsuba_whitted.LIBLLVM.refusal)
    folder = tmp_path_factory.mktemp("notebook")
    command = [sys.executable, FOLDER / "export.py", folder]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_cells_are_those_that_were_run(again: Path) -> None:
    kept, made = (
        [(cell["id"], cell["cell_type"], cell["source"], cell.get("execution_count")) for cell in read["cells"]]
        for read in (notebook(FOLDER), notebook(again))
    )
    assert kept == made


def test_words_and_code_that_cells_print_are_the_same_again(again: Path) -> None:
    """Figures aside: another processor may round the last digit elsewhere."""
    kept, made = (
        [NUMBER.sub("#", "".join(output["text"])) for output in outputs(read) if "text" in output]
        for read in (notebook(FOLDER), notebook(again))
    )
    assert [re.sub(" +", " ", text) for text in kept] == [re.sub(" +", " ", text) for text in made]
    assert sum("Why this colour?" in text for text in kept) == 5


def test_the_pictures_are_the_same_again(again: Path) -> None:
    """A colour that another processor rounds otherwise may fall on the other side of a step of 1/255."""
    mi.set_variant("scalar_rgb")
    kept, made = (
        [decoded(data) for output in outputs(read) for data in PICTURE.findall("".join(shown(output)))]
        for read in (notebook(FOLDER), notebook(again))
    )
    assert len(kept) == len(made) == 5
    for one, other in zip(kept, made, strict=True):
        assert np.abs(one - other).max() <= 1
    for one, other in pairwise(kept):
        assert (one != other).any()  # each term shows


def outputs(read: dict[str, Any]) -> list[dict[str, Any]]:
    """List the outputs of all cells."""
    return [output for cell in read["cells"] for output in cell.get("outputs", [])]


def shown(output: dict[str, Any]) -> list[str]:
    """Return the HTML of an output."""
    html: list[str] = output.get("data", {}).get("text/html", [])
    return html


def decoded(data: str) -> np.ndarray:
    """Read a PNG."""
    stream = mi.MemoryStream()
    stream.write(base64.b64decode(data))
    stream.seek(0)
    return np.array(mi.Bitmap(stream)).astype(int)


def test_the_page_is_that_of_the_notebook() -> None:
    spec = importlib.util.spec_from_file_location("export", FOLDER / "export.py")
    assert spec is not None
    assert spec.loader is not None
    export = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(export)
    page = (FOLDER / "textbook.html").read_text(encoding="utf-8")
    assert page == export.page(notebook(FOLDER))
    assert not re.findall(r"<script|https?://|<link", page)


def test_the_notebook_ends_with_a_pixel_explained_by_both_programs(again: Path) -> None:
    last = "".join(shown(outputs(notebook(again))[-1]))
    assert '<div class="explain">' in last
    assert last.count("<svg") == 2
    assert "mirror_ball" in last


def test_the_readme_leads_to_the_page() -> None:
    assert "validation/notebook/textbook.html" in (FOLDER.parents[1] / "README.md").read_text(encoding="utf-8")
