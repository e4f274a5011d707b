"""What was asked for on the command line about a scene: which file, and how to read it."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import click

from whitted_validation import scene_check, scene_files

if TYPE_CHECKING:
    from whitted_validation.load import Loaded


@dataclass(frozen=True)
class Request:
    """A scene and the options that go with it, as they were typed.

    Attributes
    ----------
    scene
        A path, or the bare name of a shipped scene.
    variant
        Of Mitsuba; None for the best that works here.
    defines
        Values for ``$name`` in the scene.
    folders
        Where else than beside the scene its files may lie.
    threads
        None for all.
    verbosity
        How often `-v` was given.
    """

    scene: str
    variant: str | None
    defines: dict[str, str]
    folders: list[Path]
    threads: int | None
    verbosity: int

    @cached_property
    def seen(self) -> scene_check.Scene:
        """The scene file, found and looked over; raises `Refusal`. Needs no Mitsuba."""
        return scene_check.check(scene_files.find(self.scene), self.folders, self.defines)

    def load(self, sensor: int = 0) -> Loaded:
        """Choose and set the variant, and load the scene; nothing is said until all is known to be well.

        Raises
        ------
        Refusal
            If the scene, the sensor or the variant cannot be used.
        """
        seen = self.seen  # before anything slow
        with _modules_alone():
            why = self._set_variant()
            from whitted_validation.load import load
            from whitted_validation.messages import Messages

        messages = Messages(self.verbosity)
        loaded = load(seen, self.folders, self.defines, sensor)
        for remark in (None if self.variant else why, loaded.remark, *seen.warnings):
            if remark:
                click.echo(f"whitted: {remark}", err=True)
        messages.show()
        return loaded

    def _set_variant(self) -> str:
        """Choose and set the variant, and say why."""
        from whitted_validation import variants

        variant, why = variants.choose(self.variant)

        import drjit as dr
        import mitsuba as mi

        mi.set_variant(variant)
        if self.threads is not None:
            dr.set_thread_count(self.threads)
        return why


@contextmanager
def _modules_alone() -> Iterator[None]:
    """Keep the first import of Mitsuba from being searched for garbage, of which it leaves none.

    Modules stay to the end: neither while they are imported nor at exit are they, or what else lives then, looked at.
    """
    if "mitsuba" in sys.modules or not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
