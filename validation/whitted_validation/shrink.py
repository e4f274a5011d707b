"""The smallest scene in which something still goes wrong (Zeller and Hildebrandt 2002, by single deletions)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator

# Without these the picture has another size or point of view, and takes minutes.
KEPT = ("sensor", "film")

Path = tuple[int, ...]  # which child of which child of the scene


def shrunk(text: str, fails: Callable[[str], bool], better: Callable[[str], None] | None = None) -> str:
    """Delete elements of a scene, the largest first, as long as it fails without them.

    Parameters
    ----------
    text : the scene, which fails
    fails : tells whether a scene shows the fault; one that cannot be read does not
    better : told each smaller scene that fails, so that an interruption loses nothing

    Returns
    -------
    A scene that fails, and no longer does if any one element is taken out of it.
    """
    root = ET.fromstring(text)
    deleted = True
    while deleted:
        deleted = False
        paths = sorted(_paths(root), key=lambda path: (-_size(root, path), path))
        for path in paths:
            smaller = ET.fromstring(ET.tostring(root))
            parent = _at(smaller, path[:-1])
            parent.remove(parent[path[-1]])
            if fails(written(smaller)):
                root, deleted = smaller, True
                if better is not None:
                    better(written(root))
                break  # the paths are others now
    return written(root)


def written(root: ET.Element) -> str:
    """Return the text of a scene, an element a line."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _paths(element: ET.Element, path: Path = ()) -> Iterator[Path]:
    """Yield the places of all elements that may be deleted."""
    for i, child in enumerate(element):
        if child.tag not in KEPT:
            yield (*path, i)
        if child.tag != "film":
            yield from _paths(child, (*path, i))


def _at(element: ET.Element, path: Path) -> ET.Element:
    for i in path:
        element = element[i]
    return element


def _size(root: ET.Element, path: Path) -> int:
    return sum(1 for _ in _at(root, path).iter())
