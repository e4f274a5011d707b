"""A scene made larger or smaller, turned and moved, as a scene file: the same picture, told in other numbers.

All that stands in world units goes along: every to_world, lights, the textbook's epsilon, the camera's clip planes.
Intensities of point and spot lights grow with the square of the scale, where they fall off with the square of the
distance. Both tracers read the same new text, so that nothing is rounded on one side only.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from whitted_validation.stress.geometry import affine, triple

Array = NDArray[np.float64]

NEAR, FAR = 1e-2, 1e4  # Mitsuba's clip planes where a camera says nothing


def placed(text: str, scale: float = 1.0, linear: Array | None = None, translation: Array | None = None) -> str:
    """Return the text of a scene, scaled, then rotated by `linear`, then moved by `translation`.

    Raises
    ------
    ValueError
        If the scene holds what cannot be moved so: instances' groups stay, but an orthographic camera or an image
        of the surroundings does not keep its picture.
    """
    root = ElementTree.fromstring(text)
    turn = np.eye(3) if linear is None else linear
    shift = np.zeros(3) if translation is None else translation
    move = affine(scale * turn, shift)
    falls_off = True
    for integrator in root.iter("integrator"):
        falls_off = _value(integrator, "falloff", "inverse_square") == "inverse_square"
        _scale_number(integrator, "epsilon", scale)
    for shape in root.findall("shape"):
        if shape.get("type") != "shapegroup":
            _then(_to_world(shape), move)
    for sensor in root.findall("sensor"):
        if sensor.get("type") != "perspective":
            raise ValueError(f"a sensor of type {sensor.get('type')} cannot be scaled")
        # A camera must not scale: the inverse goes first.
        to_world = _to_world(sensor)
        to_world.insert(0, Element("scale", {"value": repr(1 / scale)}))
        _then(to_world, move)
        for name, usual in (("near_clip", NEAR), ("far_clip", FAR)):
            _set(sensor, name, repr(scale * float(_value(sensor, name, repr(usual)))))
    for emitter in root.findall("emitter"):
        _move_light(emitter, scale, turn, move, falls_off)
    return ElementTree.tostring(root, encoding="unicode")


def _move_light(emitter: Element, scale: float, turn: Array, move: str, falls_off: bool) -> None:
    kind = emitter.get("type")
    if kind == "constant":
        return
    if kind == "directional":
        direction = next((child for child in emitter if child.get("name") == "direction"), None)
        if direction is None:
            _then(_to_world(emitter), affine(turn))
        else:
            direction.set("value", triple(turn @ _triple(direction)))
        return
    if kind == "point":
        position = next((child for child in emitter if child.get("name") == "position"), None)
        if position is not None:
            emitter.remove(position)
            _to_world(emitter).append(Element("translate", {"value": triple(_triple(position))}))
        _then(_to_world(emitter), move)
    elif kind == "spot":
        to_world = _to_world(emitter)
        to_world.insert(0, Element("scale", {"value": repr(1 / scale)}))
        _then(to_world, move)
    else:
        raise ValueError(f"an emitter of type {kind} cannot be moved")
    if falls_off:
        colours = [child for child in emitter if child.get("name") == "intensity"]
        if not colours:
            _set(emitter, "intensity", repr(scale**2))
        for colour in colours:
            values = (colour.get("value") or "").replace(",", " ").split()
            colour.set("value", ", ".join(repr(float(value) * scale**2) for value in values))


def _triple(element: Element) -> Array:
    """Read a point or vector, written as one value or as x, y and z."""
    if "value" in element.attrib:
        return np.array([float(x) for x in element.attrib["value"].replace(",", " ").split()])
    return np.array([float(element.get(axis, "0")) for axis in "xyz"])


def _to_world(element: Element) -> Element:
    """Return the transform of an object; a new one if it has none."""
    for child in element.findall("transform"):
        if child.get("name") == "to_world":
            return child
    return ElementTree.SubElement(element, "transform", {"name": "to_world"})


def _then(transform: Element, step: str) -> None:
    transform.append(ElementTree.fromstring(step))


def _value(element: Element, name: str, usual: str) -> str:
    return next((child.get("value", usual) for child in element if child.get("name") == name), usual)


def _set(element: Element, name: str, value: str) -> None:
    for child in element:
        if child.get("name") == name:
            child.set("value", value)
            return
    ElementTree.SubElement(element, "float", {"name": name, "value": value})


def _scale_number(element: Element, name: str, scale: float) -> None:
    for child in element:
        if child.get("name") == name:
            child.set("value", repr(float(child.get("value", "0")) * scale))
