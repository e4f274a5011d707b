"""The parameters of one object of a scene file, taken one by one; what is left over is an error."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from whitted_reference import float32, transforms
from whitted_reference.elements import OBJECTS, Document, Element
from whitted_reference.errors import NotDefined, SceneError
from whitted_reference.transforms import Affine, Row3

_VALUES = ("float", "integer", "boolean", "string", "point", "vector", "rgb", "spectrum", "transform")
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_INTEGER = re.compile(r"\s*-?\d+\s*")

# The squared length of a rotation axis may differ from 1 by what an axis written to six decimals leaves:
# three components, each off by 5e-7 and at most 1, twice that in the square.
UNIT_AXIS = 3e-6


def _numbers(text: str, where: str, counts: Sequence[int]) -> list[float]:
    tokens = [token for token in re.split(r"[,\s]+", text) if token]
    if len(tokens) not in counts:
        raise SceneError(f"{where}: `{text}` holds {len(tokens)} numbers; allowed: {' or '.join(map(str, counts))}")
    return [parse_number(token, where) for token in tokens]


def parse_number(text: str, where: str) -> float:
    """Parse a decimal number that single precision can hold."""
    if not _NUMBER.fullmatch(text):
        raise SceneError(f"{where}: `{text.strip()}` is not a finite decimal number")
    value = float(text)
    if not math.isfinite(float32.nearest(value)):
        raise SceneError(f"{where}: `{text.strip()}` is beyond single precision")
    return value


class Properties:
    """The parameters and nested objects of one object element, to be taken one by one."""

    def __init__(self, document: Document, element: Element) -> None:
        element.only("type", "id", "name", *(["version"] if element.tag == "scene" else []))
        self.document = document
        self.element = element
        self.where = element.where
        self.type = "scene" if element.tag == "scene" else element.attribute("type")
        self.values: dict[str, Element] = {}
        self.objects: list[tuple[str, Element]] = []
        for child in element.children:
            if child.tag in ("default", "alias"):
                continue
            target = document.target(child) if child.tag == "ref" else child
            if child.tag == "ref":
                child.only("id", "name")
            if target.tag in OBJECTS:
                self.objects.append((child.attributes.get("name", ""), target))
            elif child.tag in _VALUES:
                name = child.attribute("name")
                if name in self.values:
                    raise SceneError(f"{child.where}: parameter `{name}` is given twice")
                self.values[name] = child
                for element in (child, *child.children):
                    element.owner = f" of `{self.type}`{self._named()}"
            else:
                raise SceneError(f"{child.where}: element <{child.tag}> is unknown here")

    def refuse(self, message: str) -> SceneError:
        """Return an error about this object."""
        return SceneError(f"{self.where} type `{self.type}`{self._named()}: {message}")

    def not_defined(self, feature: str | None = None) -> NotDefined:
        """Return the error for a feature that the picture does not define."""
        feature = feature or f"{self.element.tag} {self.type}"
        return NotDefined(feature, self.element.attributes.get("id", self.type), self.where)

    def _named(self) -> str:
        name = self.element.attributes.get("id")
        return f" `{name}`" if name else ""

    def done(self) -> None:
        """Refuse every parameter and object that was not taken."""
        for name, element in self.values.items():
            raise SceneError(f"{element.where}: parameter `{name}` is unknown")
        for name, element in self.objects:
            title = f"<{element.tag}>" + (f" `{name}`" if name else "")
            raise SceneError(f"{element.where}: {title} is not expected in `{self.type}`{self._named()}")

    def has(self, name: str) -> bool:
        """Tell whether a parameter or a named object is still to be taken."""
        return name in self.values or any(name == title for title, _ in self.objects)

    def _take(self, name: str, *tags: str) -> Element | None:
        element = self.values.get(name)
        if element is None:
            return None
        if element.tag == "spectrum":
            raise NotDefined("spectrum", name, element.where)
        if element.tag not in tags:
            raise SceneError(
                f"{element.where}: parameter `{name}` must be given as {' or '.join(f'<{t}>' for t in tags)}"
            )
        if element.tag in ("point", "vector"):
            element.only("name", "value", "x", "y", "z")
        elif element.tag == "transform":
            element.only("name")
        else:
            element.only("name", "value")
        if element.children and element.tag != "transform":
            raise SceneError(f"{element.where}: a parameter has no children")
        return self.values.pop(name)

    def single(self, name: str, default: float, low: float = -math.inf, high: float = math.inf) -> float:
        """Take a number, rounded to binary32, in [low, high]."""
        return float32.nearest(self.double(name, default, low, high))

    def double(self, name: str, default: float, low: float = -math.inf, high: float = math.inf) -> float:
        """Take a number in double precision."""
        element = self._take(name, "float", "integer")
        if element is None:
            return default
        value = parse_number(element.attribute("value"), f"{element.where} `{name}`")
        if not low <= value <= high:
            raise SceneError(f"{element.where}: `{name}` is {value:g}; allowed: {low:g} to {high:g}")
        return value

    def integer(self, name: str, default: int, low: int, high: int = 2**31 - 1) -> int:
        """Take a whole number in [low, high]."""
        element = self._take(name, "integer")
        if element is None:
            return default
        text = element.attribute("value")
        if not _INTEGER.fullmatch(text) or not low <= int(text) <= high:
            raise SceneError(f"{element.where}: `{name}` is `{text.strip()}`; allowed: whole numbers {low} to {high}")
        return int(text)

    def boolean(self, name: str, default: bool) -> bool:
        """Take true or false."""
        element = self._take(name, "boolean")
        if element is None:
            return default
        text = element.attribute("value").lower()
        if text not in ("true", "false"):
            raise SceneError(f"{element.where}: `{name}` is `{text}`; allowed: true, false")
        return text == "true"

    def string(self, name: str, default: str | None, allowed: Sequence[str] = ()) -> str:
        """Take a word; without a default it is required."""
        element = self._take(name, "string")
        if element is None:
            if default is None:
                raise self.refuse(f"parameter `{name}` is missing")
            return default
        text = element.attribute("value")
        if allowed and text not in allowed:
            raise SceneError(f"{element.where}: `{name}` is `{text}`; allowed: {', '.join(allowed)}")
        return text

    def vec(self, name: str, default: Row3) -> Row3:
        """Take a point or vector, rounded to binary32."""
        element = self._take(name, "point", "vector")
        if element is None:
            return default
        return float32.nearest_vec(_xyz(element, None))

    def colour(self, name: str, default: float | Row3, high: float = math.inf) -> Row3:
        """Take a colour with components in [0, high], or its luminance in a grey scene, rounded to binary32."""
        element = self._take(name, "rgb", "float", "integer")
        if element is None:
            grey = default if isinstance(default, tuple) else (default, default, default)
            return float32.nearest_vec(grey)
        numbers = _numbers(
            element.attribute("value"), f"{element.where} `{name}`", (1, 3) if element.tag == "rgb" else (1,)
        )
        for value in numbers:
            if not 0.0 <= value <= high:
                raise SceneError(f"{element.where}: `{name}` holds {value:g}; allowed: 0 to {high:g}")
        r, g, b = numbers * (3 // len(numbers))
        if self.document.grey and element.tag == "rgb":
            r = g = b = float32.luminance((r, g, b))
        return float32.nearest_vec((r, g, b))

    def transform(self, name: str = "to_world") -> Affine:
        """Take a transform, rounded to binary32; a singular one is refused."""
        element = self._take(name, "transform")
        composed = transforms.IDENTITY
        for child in element.children if element else ():
            composed = transforms.product(_elementary(child), composed)
        rounded = composed.rounded()
        if element and (not rounded.is_finite() or rounded.determinant() == 0):
            raise SceneError(f"{element.where}: `{name}` is singular or not finite")
        return rounded

    def take_objects(self, tag: str) -> list[Properties]:
        """Take all nested objects of one kind, named or not."""
        taken = [element for _, element in self.objects if element.tag == tag]
        self.objects = [(name, element) for name, element in self.objects if element.tag != tag]
        return [Properties(self.document, element) for element in taken]

    def take_named(self, name: str) -> Properties | None:
        """Take the nested object of that name."""
        for i, (title, element) in enumerate(self.objects):
            if title == name:
                del self.objects[i]
                return Properties(self.document, element)
        return None

    def file(self) -> Path:
        """Take `filename` and find the file."""
        element = self.values.get("filename", self.element)
        return self.document.files.find(self.string("filename", None), element)


def _xyz(element: Element, default: float | None) -> Row3:
    if "value" in element.attributes:
        if any(axis in element.attributes for axis in "xyz"):
            raise SceneError(f"{element.where}: give either `value` or x, y, z")
        numbers = _numbers(element.attributes["value"], element.where, (1, 3))
        x, y, z = numbers * (3 // len(numbers))
        return x, y, z
    x, y, z = (
        default
        if default is not None and axis not in element.attributes
        else parse_number(element.attribute(axis), element.where)
        for axis in "xyz"
    )
    return x, y, z


def _elementary(element: Element) -> Affine:
    """Turn one element of a <transform> into its transform, in double precision."""
    if element.children:
        raise SceneError(f"{element.where}: a transform element has no children")
    match element.tag:
        case "translate":
            element.only("value", "x", "y", "z")
            return transforms.translation(_xyz(element, 0.0))
        case "scale":
            element.only("value", "x", "y", "z")
            return transforms.scaling(_xyz(element, 1.0))
        case "rotate":
            element.only("value", "x", "y", "z", "angle")
            axis = _xyz(element, 0.0)
            squared = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]
            if abs(squared - 1.0) > UNIT_AXIS:
                raise SceneError(
                    f"{element.where}: rotation axis {axis} has length {math.sqrt(squared):.7g}; allowed: 1"
                )
            return transforms.rotation(axis, parse_number(element.attribute("angle"), element.where))
        case "lookat":
            element.only("origin", "target", "up")
            origin, target, up = (
                tuple(_numbers(element.attribute(name), element.where, (3,))) for name in ("origin", "target", "up")
            )
            result = transforms.look_at(origin, target, up)  # type: ignore[arg-type]
            if not result.is_finite():
                raise SceneError(f"{element.where}: target equals origin, or up is zero or parallel to the view")
            return result
        case "matrix":
            element.only("value")
            m = _numbers(element.attribute("value"), element.where, (9, 16))
            if len(m) == 9:
                m = [*m[0:3], 0.0, *m[3:6], 0.0, *m[6:9], 0.0, 0.0, 0.0, 0.0, 1.0]
            if m[12:] != [0.0, 0.0, 0.0, 1.0]:
                raise SceneError(f"{element.where}: the last row is {m[12:]}; allowed: 0 0 0 1")
            return transforms.from_matrix(((*m[0:4],), (*m[4:8],), (*m[8:12],)))  # type: ignore[arg-type]
    raise SceneError(f"{element.where}: element is unknown in <transform>")
