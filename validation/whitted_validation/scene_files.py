"""The scenes that come with the package, and how a name on the command line becomes a file."""

from __future__ import annotations

import shutil
from pathlib import Path
from xml.parsers import expat

from whitted_validation.refusal import Refusal

_HERE = Path(__file__).resolve()
_INSTALLED = _HERE.parent / "scenes"
SCENES = _INSTALLED if _INSTALLED.is_dir() else _HERE.parents[2] / "scenes"
"""The folder of shipped scenes: inside the wheel, or the checkout's."""


def shipped() -> list[Path]:
    """List the shipped scene files by name."""
    return sorted(SCENES.glob("*.xml"))


def find(scene: str) -> Path:
    """Turn what was typed into a scene file.

    Parameters
    ----------
    scene
        A path, or the bare name of a shipped scene. A file of that name comes first.

    Raises
    ------
    Refusal
        If there is neither.
    """
    path = Path(scene)
    if path.is_file():
        return path
    if path.is_dir():
        raise Refusal(f"{scene}: is a folder; a scene is an XML file")
    if path.name == scene and not path.suffix:
        named = SCENES / f"{scene}.xml"
        if named.is_file():
            return named
        names = ", ".join(file.stem for file in shipped())
        raise Refusal(f"{scene}: neither a file nor a shipped scene; shipped are {names}")
    raise Refusal(f"{scene}: no such file")


def purpose(scene: Path) -> str:
    """Read the first sentence or line of the comment at the top of a scene."""
    comments: list[str] = []
    parser = expat.ParserCreate()
    parser.CommentHandler = comments.append
    parser.Parse(scene.read_bytes(), True)
    text = comments[0].strip() if comments else ""
    return " ".join(text.split("\n\n")[0].split())


def copy_to(folder: Path) -> list[Path]:
    """Copy the shipped scenes and their meshes to a new or empty folder, to be edited there.

    Returns
    -------
    list of Path
        The copied scene files.

    Raises
    ------
    Refusal
        If the folder holds anything, for nothing is ever overwritten, or cannot be made.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise Refusal(f"{folder}: is not empty; name a new folder")
    try:
        shutil.copytree(SCENES, folder, dirs_exist_ok=True)
    except OSError as error:
        raise Refusal(f"{folder}: {error.strerror or error}") from None
    return [folder / file.name for file in shipped()]
