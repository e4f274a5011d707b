"""Scene files as trees of elements: parameters substituted, includes merged, ids collected.

No document type is allowed and so no entities; depth is bounded; files come from the scene's own folder
or from folders that are allowed by name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from whitted_reference.errors import SceneError

MAX_DEPTH = 64  # of nested elements and of includes: far beyond any scene, far below the recursion limit

OBJECTS = (
    *("scene", "integrator", "sensor", "film", "rfilter", "sampler"),
    *("shape", "bsdf", "texture", "emitter", "medium", "phase", "volume"),
)


@dataclass
class Element:
    """One XML element after substitution; `place` and `owner` are where it stands, for messages."""

    tag: str
    attributes: dict[str, str]
    place: str
    folder: Path
    children: list[Element] = field(default_factory=list)
    owner: str = ""

    @property
    def where(self) -> str:
        """Return `file:line <tag>`, and of what object."""
        return self.place + self.owner

    def attribute(self, name: str) -> str:
        """Return a required attribute."""
        if name not in self.attributes:
            raise SceneError(f"{self.where}: attribute `{name}` is missing")
        return self.attributes[name]

    def only(self, *allowed: str) -> None:
        """Refuse attributes other than the allowed."""
        for name in self.attributes:
            if name not in allowed:
                raise SceneError(f"{self.where}: attribute `{name}` is unknown; allowed: {', '.join(allowed)}")


class Files:
    """Where files may come from: the scene's folder and the allowed ones."""

    def __init__(self, home: Path, allow_dirs: Sequence[Path]) -> None:
        self.home = home.resolve()
        self.roots = [self.home, *(folder.resolve() for folder in allow_dirs)]
        self.used: list[Path] = []

    def find(self, name: str, element: Element) -> Path:
        """Resolve a file name relative to its own file's folder, then to each allowed folder."""
        for folder in (element.folder, *self.roots):
            path = (folder / name).resolve()
            if path.is_file():
                if not any(path.is_relative_to(root) for root in self.roots):
                    raise SceneError(
                        f"{element.where}: file `{name}` lies outside the scene's folder; allowed: files "
                        "in it or in folders allowed by name"
                    )
                self.used.append(path)
                return path
        raise SceneError(f"{element.where}: file `{name}` was not found")


def _raw_tree(path: Path) -> Element:
    """Parse one file into elements, without substitution."""
    parser = expat.ParserCreate()
    stack: list[Element] = []
    roots: list[Element] = []

    def fail(message: str) -> None:
        raise SceneError(f"{path.name}:{parser.CurrentLineNumber}: {message}")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, f"{path.name}:{parser.CurrentLineNumber} <{tag}>", path.parent)
        if len(stack) >= MAX_DEPTH:
            fail(f"more than {MAX_DEPTH} nested elements")
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def end(tag: str) -> None:
        stack.pop()

    def text(data: str) -> None:
        if data.strip():
            fail(f"text `{data.strip()[:40]}` between elements is not allowed")

    def doctype(*_: object) -> None:
        fail("a document type (DTD) is not allowed")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        raise SceneError(f"{path.name}:{error.lineno}: {expat.ErrorString(error.code)}") from None
    except OSError as error:
        raise SceneError(f"{path.name}: {error.strerror}") from None
    root = roots[0]
    if not re.fullmatch(r"3\.\d+\.\d+", root.attributes.get("version", "")):
        raise SceneError(f"{root.where}: version `{root.attributes.get('version')}`; allowed: 3.x.y")
    return root


class Document:
    """All elements of a scene: substitutes `$parameters`, merges includes, collects ids, in file order.

    `grey` says that every colour is to be read as its luminance (see `scene_xml.load`).
    """

    def __init__(self, path: Path, parameters: Mapping[str, str], files: Files, grey: bool = False) -> None:
        self.files = files
        self.grey = grey
        self.values = dict(parameters)
        self.unused = set(parameters)
        self.ids: dict[str, Element] = {}
        files.used.append(path)
        self.root = _raw_tree(path)
        if self.root.tag != "scene":
            raise SceneError(f"{self.root.where}: the outermost element must be <scene>")
        self._resolve(self.root, 0)
        if self.unused:
            raise SceneError(f"{path.name}: parameter `{min(self.unused)}` is given but never used")

    def _resolve(self, element: Element, includes: int) -> None:
        element.attributes = {name: self._substitute(text, element) for name, text in element.attributes.items()}
        tag = element.tag
        if tag in OBJECTS and "id" in element.attributes:
            self._name(element.attributes["id"], element)
        elif tag == "alias":
            element.only("id", "as")
            self._name(element.attribute("as"), self.target(element))
        elif tag == "default":
            element.only("name", "value")
            self.values.setdefault(element.attribute("name"), element.attribute("value"))
        elif tag == "include":
            self._include(element, includes + 1)
            return
        for child in element.children:
            self._resolve(child, includes)
        element.children = [
            grandchild
            for child in element.children
            for grandchild in (child.children if child.tag == "include" else [child])
        ]

    def _include(self, element: Element, includes: int) -> None:
        element.only("filename")
        if includes > MAX_DEPTH:
            raise SceneError(f"{element.where}: more than {MAX_DEPTH} nested includes")
        if element.children:
            raise SceneError(f"{element.where}: <include> has no children")
        root = _raw_tree(self.files.find(element.attribute("filename"), element))
        self._resolve(root, includes)
        element.children = root.children if root.tag == "scene" else [root]

    def _name(self, name: str, element: Element) -> None:
        if name in self.ids:
            raise SceneError(f"{element.where}: id `{name}` is used twice, first in {self.ids[name].where}")
        self.ids[name] = element

    def target(self, element: Element) -> Element:
        """Return the object that a <ref> or <alias> points to."""
        name = element.attribute("id")
        if name not in self.ids:
            raise SceneError(f"{element.where}: no object has the id `{name}`")
        return self.ids[name]

    def _substitute(self, text: str, element: Element) -> str:
        if "$" not in text:
            return text
        for name in sorted(self.values, key=len, reverse=True):
            pattern = r"(?<!\\)\$" + re.escape(name)
            value = self.values[name].replace("\\", r"\\")  # taken literally
            text, count = re.subn(pattern, value, text)
            if count:
                self.unused.discard(name)
        unknown = re.search(r"(?<!\\)\$(\w*)", text)
        if unknown:
            raise SceneError(f"{element.where}: parameter `${unknown[1]}` has no value")
        return text.replace("\\$", "$")
