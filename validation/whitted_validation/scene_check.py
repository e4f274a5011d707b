"""A look at a scene file before Mitsuba sees it: what would crash it, load silently or reach too far.

Mitsuba's reader recurses into nested elements until the stack ends, and takes `nan` for a number. This one
streams, forgets what it has seen, and keeps only the place and name of each object for later messages. All
else that can be wrong is left to Mitsuba, which says it well.
"""

from __future__ import annotations

import math
import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from whitted_validation.refusal import Refusal

MAX_DEPTH = 64  # of elements: scenes need about ten; Mitsuba's recursion ends the process at some thousands
MAX_INCLUDES = 15  # one inside another, as in Mitsuba
MAX_TEXT = 1 << 20  # characters of one attribute after $substitution: ten nested tenfold ones would make 1e10
MAX_PIXELS = 1 << 28  # of a film: 16384 x 16384; picture and film take 28 bytes a pixel, 7 GiB
MAX_SAMPLES = 64 * 64  # of a pixel: by then an edge is right to 1/64 of a pixel in both directions
AXIS_ERROR = 2.0**-22  # of its length: the three components of a unit axis, each rounded to float32, stay below

_NUMBERS = {
    "float": ["value"],
    "integer": ["value"],
    "rgb": ["value"],
    "spectrum": ["value"],
    "point": ["value", "x", "y", "z"],
    "vector": ["value", "x", "y", "z"],
    "translate": ["value", "x", "y", "z"],
    "scale": ["value", "x", "y", "z"],
    "rotate": ["angle", "value", "x", "y", "z"],
    "lookat": ["origin", "target", "up"],
    "matrix": ["value"],
}
"""Element to those of its attributes that hold numbers; a <spectrum> also holds `wavelength:value` pairs."""

_RANGES: dict[tuple[str, str], tuple[str, Callable[[float], bool]]] = {
    ("shape", "radius"): ("must be above 0", lambda value: value > 0),
    ("emitter", "intensity"): ("must not be negative", lambda value: value >= 0),
    ("emitter", "irradiance"): ("must not be negative", lambda value: value >= 0),
    ("emitter", "radiance"): ("must not be negative", lambda value: value >= 0),
    ("sampler", "sample_count"): (f"must be 1..{MAX_SAMPLES}", lambda value: 1 <= value <= MAX_SAMPLES),
    ("film", "width"): (f"must be 1..{MAX_PIXELS}", lambda value: 1 <= value <= MAX_PIXELS),
    ("film", "height"): (f"must be 1..{MAX_PIXELS}", lambda value: 1 <= value <= MAX_PIXELS),
    ("film", "crop_width"): (f"must be 1..{MAX_PIXELS}", lambda value: 1 <= value <= MAX_PIXELS),
    ("film", "crop_height"): (f"must be 1..{MAX_PIXELS}", lambda value: 1 <= value <= MAX_PIXELS),
}
"""Parameters that Mitsuba takes beyond their range, by the element around them and their name."""


@dataclass
class Element:
    """An open or remembered element: its tag and attributes after substitution, and where it stands."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    column: int

    def __str__(self) -> str:
        """Show the element as it can be searched for: tag, type, name and id."""
        names = [f' {key}="{self.attributes[key]}"' for key in ("type", "name", "id") if key in self.attributes]
        return f"<{self.tag}{''.join(names)}>"

    def refuse(self, complaint: str) -> NoReturn:
        """Raise a `Refusal` that names file, line and element."""
        raise Refusal(f"{self.file}:{self.line}: {self}: {complaint}")


@dataclass
class Scene:
    """What the look brought to light.

    Attributes
    ----------
    file
        The scene file.
    objects
        The elements with a `type`, by file, line and column (from 1) of their tag.
    warnings
        What is allowed but hardly meant, a line each.
    """

    file: Path
    warnings: list[str] = field(default_factory=list)
    objects: dict[tuple[str, int, int], Element] = field(default_factory=dict)

    def at(self, file: str, line: int, column: int) -> Element | None:
        """Find the object whose tag stands at a place that Mitsuba names."""
        return self.objects.get((file, line, column))

    @property
    def integrator(self) -> str:
        """The scene's integrator in words, by the type that its file gives it."""
        types = (element.attributes["type"] for element in self.objects.values() if element.tag == "integrator")
        return next((f"the integrator `{name}`" for name in types), "no integrator")


def check(scene: Path, folders: Sequence[Path] = (), defines: Mapping[str, str] | None = None) -> Scene:
    """Look through a scene file and all that it includes.

    Parameters
    ----------
    scene
        The XML file.
    folders
        Where else than beside the scene files may lie.
    defines
        Values for ``$name``, ahead of the scene's own defaults.

    Raises
    ------
    Refusal
        At the first thing wrong.
    """
    reader = _Reader(Scene(scene), [scene.parent, *folders], dict(defines or {}))
    reader.read(scene)
    reader.find_files()
    return reader.scene


class _Reader:
    def __init__(self, scene: Scene, allowed: list[Path], parameters: dict[str, str]) -> None:
        self.scene = scene
        self.allowed = allowed
        self.parameters = parameters
        self.search = list(allowed)  # `path` elements put more in front
        self.open: list[Element] = []
        self.film: dict[str, float] = {}  # numbers of the film that is open
        self.files: list[Path] = []  # being read, each included by the one before
        self.wanted: list[tuple[Element, str, list[Path]]] = []

    def read(self, file: Path) -> None:
        if len(self.files) > MAX_INCLUDES:
            raise Refusal(f"{self.files[0]}: includes go deeper than {MAX_INCLUDES}; the last is {file}")
        self.files.append(file)
        parser = expat.ParserCreate()
        parser.StartElementHandler = lambda tag, attributes: self.start(
            Element(tag, attributes, file, parser.CurrentLineNumber, parser.CurrentColumnNumber + 2)
        )
        parser.EndElementHandler = lambda _tag: self.end()

        def no_doctype(*_: object) -> NoReturn:
            line = parser.CurrentLineNumber
            raise Refusal(f"{file}:{line}: <!DOCTYPE>: not allowed in a scene, nor are entities")

        parser.StartDoctypeDeclHandler = no_doctype
        try:
            with file.open("rb") as stream:
                parser.ParseFile(stream)
        except OSError as error:
            raise Refusal(f"{file}: {error.strerror or error}") from None
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise Refusal(f"{file}:{error.lineno}: broken XML: {reason}") from None
        self.files.pop()

    def start(self, element: Element) -> None:
        if len(self.open) >= MAX_DEPTH:
            element.refuse(f"nested deeper than {MAX_DEPTH} elements")
        if not self.open and element.tag != "scene":
            element.refuse("the outermost element must be <scene>")
        for key, value in element.attributes.items():
            if "$" in value:
                element.attributes[key] = self.substitute(element, value)
        parent = self.open[-1] if self.open else None
        self.open.append(element)
        if "type" in element.attributes or element.tag == "scene":
            self.scene.objects[str(element.file), element.line, element.column] = element
        else:
            self.check_numbers(element, parent)
            self.check_axis(element)
            self.follow(element)

    def end(self) -> None:
        element = self.open.pop()
        if element.tag == "film":
            width, height = (self.film.get(side, 1) for side in ("width", "height"))
            self.film.clear()
            if width * height > MAX_PIXELS:
                element.refuse(f"{width:.0f} x {height:.0f} pixels; at most {MAX_PIXELS} are allowed")

    def substitute(self, element: Element, text: str) -> str:
        """Replace each ``$name``, the longest names first, as Mitsuba does."""
        names = sorted(self.parameters, key=len, reverse=True)
        known = "|".join(re.escape(name) for name in names)
        size = 0

        def value(match: re.Match[str]) -> str:
            nonlocal size
            if match[1] is None:
                element.refuse(f"undefined parameter {match[0]}; give it with -D or a <default>")
            size += len(self.parameters[match[1]])
            if size > MAX_TEXT:
                element.refuse(f"a value grows beyond {MAX_TEXT} characters by substitution")
            return self.parameters[match[1]]

        return re.sub(rf"(?<!\\)\$(?:({known or '(?!)'})|\w*)", value, text).replace(r"\$", "$")

    def check_numbers(self, element: Element, parent: Element | None) -> None:
        name = element.attributes.get("name", "")
        for key in _NUMBERS.get(element.tag, ()):
            for number in _numbers(element, key):
                meaning, holds = _RANGES.get((parent.tag, name) if parent else ("", ""), ("", None))
                if holds and not holds(number):
                    element.refuse(f"{element.attributes[key]} {meaning}")
                if parent and parent.tag == "film":
                    self.film[name] = number

    def check_axis(self, element: Element) -> None:
        """Mitsuba turns about an axis as it stands: one that is not of length 1 also scales and shears."""
        if element.tag != "rotate":
            return
        axis = list(_numbers(element, "value"))
        if len(axis) == 1:
            axis *= 3  # one number stands for all three
        length = math.hypot(*axis, *(number for key in "xyz" for number in _numbers(element, key)))
        if abs(length - 1) > AXIS_ERROR:
            place = f"{element.file}:{element.line}: {element}"
            self.scene.warnings.append(
                f"{place}: the axis has length {length:.7g}; Mitsuba expects 1 and else distorts"
            )

    def follow(self, element: Element) -> None:
        """Note the file that an element names; read an included one at once, as Mitsuba does."""
        here = element.file.parent
        match element.tag, element.attributes:
            case "default", {"name": name, "value": value}:
                self.parameters.setdefault(name, value)
            case "path", {"value": value}:
                if len(self.files) == 1:
                    self.search.insert(0, self.inside(element, value, [here, *self.search], os.path.isdir))
            case "include", {"filename": name}:
                self.read(self.inside(element, name, [here, *self.search]))
            case "spectrum", {"filename": name}:
                self.inside(element, name, [here, *self.search])
            case "string", {"name": "filename", "value": name}:
                self.wanted.append((element, name, self.search))

    def find_files(self) -> None:
        """Look for all named files; only now, since a later `path` element counts for earlier names too."""
        for element, name, folders in self.wanted:
            self.inside(element, name, folders)

    def inside(
        self,
        element: Element,
        name: str,
        folders: list[Path],
        exists: Callable[[Path], bool] = os.path.isfile,
    ) -> Path:
        """Find a file or folder as Mitsuba does and see that it is where a scene may reach."""
        for folder in folders:
            path = folder / name  # an absolute name stands for itself
            if exists(path):
                real = path.resolve()
                if not any(real.is_relative_to(folder.resolve()) for folder in self.allowed):
                    element.refuse(f"{name} lies outside the scene's folder; allow its folder with -a")
                return path
        element.refuse(f"no such file: {name}, looked for beside the scene and under -a")


def _numbers(element: Element, key: str) -> Iterator[float]:
    """Read the numbers of an attribute; each must be finite as float32, in which the picture is drawn."""
    for text in re.split(r"[\s,:]+", element.attributes.get(key, "").strip()):
        try:
            (number,) = struct.unpack("f", struct.pack("f", float(text)))  # native: what is too large is inf
        except ValueError:
            if text:
                element.refuse(f'{key}="{element.attributes[key]}": {text} is not a number')
            continue
        if not abs(number) < float("inf"):
            element.refuse(f'{key}="{element.attributes[key]}": every number must be finite (float32)')
        yield number
