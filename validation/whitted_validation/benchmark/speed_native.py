"""A scene of `scenes` in Mitsuba's own materials, drawn by its own `path`: it loads without our plugins."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path


def with_native_materials(file: Path) -> Path:
    """Write the scene beside `file` with every `blinnphong` as `diffuse`, or as `conductor` if it is a mirror.

    A `diffuse` of reflectance rho is k_d = rho / pi, so that rho = pi k_d, cut at 1; highlights are lost, and a
    mirror's own colour is.
    """
    tree = ET.parse(file)
    for integrator in tree.iter("integrator"):
        integrator.set("type", "path")
        for e in [e for e in integrator if e.get("name") != "max_depth"]:
            integrator.remove(e)
    for bsdf in tree.iter("bsdf"):
        if bsdf.get("type") == "blinnphong":
            _translate(bsdf)
    native = file.with_name(f"{file.stem}_native.xml")
    tree.write(native, encoding="utf-8")
    return native


def _translate(bsdf: ET.Element) -> None:
    values = {str(e.get("name")): str(e.get("value")) for e in bsdf}
    for e in list(bsdf):
        bsdf.remove(e)
    k_m = float(values.get("mirror_reflectance", "0"))
    if k_m:
        bsdf.set("type", "conductor")
        ET.SubElement(bsdf, "string", name="material", value="none")
        ET.SubElement(bsdf, "rgb", name="specular_reflectance", value=f"{k_m:g}, {k_m:g}, {k_m:g}")
    else:
        bsdf.set("type", "diffuse")
        k_d = [float(value) for value in values["diffuse_reflectance"].split(",")]
        rho = ", ".join(f"{min(1.0, math.pi * value):.6g}" for value in k_d)
        ET.SubElement(bsdf, "rgb", name="reflectance", value=rho)
