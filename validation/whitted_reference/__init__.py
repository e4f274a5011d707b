"""An independent plain-Python tracer of the picture that the plugins draw; standard library only.

    scene = load("scene.xml")
    picture = render(scene)
    save(picture, "scene.exr")

To understand the picture, start reading at `trace.Tracer.raycolor`.
"""

from whitted_reference.errors import NotDefined, SceneError
from whitted_reference.image import Picture, render
from whitted_reference.picture_files import save
from whitted_reference.scene import Scene
from whitted_reference.scene_xml import load
from whitted_reference.trace import Tracer

__all__ = ["NotDefined", "Picture", "Scene", "SceneError", "Tracer", "load", "render", "save"]
