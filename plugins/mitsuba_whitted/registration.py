"""The plugins, made known to each variant of Mitsuba that the user sets."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from mitsuba_whitted import libllvm

LIBLLVM = libllvm.choose()  # before Mitsuba, which imports Dr.Jit

import mitsuba as mi  # noqa: E402

_PLUGINS = {
    "whitted": ("integrator", "mitsuba_whitted.integrator"),
    "blinnphong": ("bsdf", "mitsuba_whitted.blinn_phong"),
    "polygon": ("shape", "mitsuba_whitted.polygon"),
}
"""Name of the plugin: what Mitsuba calls its kind, and the module whose ``define()`` makes it."""

_registered: set[str] = set()
"""Variants that have their plugins. One that comes back keeps them: scenes made before may still be drawn."""


def register() -> None:
    """Register `whitted`, `blinnphong` and `polygon` for the current variant, if one is set.

    Runs by itself at import and after each ``mi.set_variant``; calling it again is harmless.

    Raises
    ------
    ImportError
        If the variant compiles with LLVM and the libLLVM in use would abort the process.
    """
    variant = mi.variant()
    if variant is None or variant in _registered:
        return
    if variant.startswith("llvm") and LIBLLVM.refusal:
        raise ImportError(f"{variant}: {LIBLLVM.refusal}")

    for name, (kind, module) in _PLUGINS.items():
        # Spectra and polarisation are no part of the picture; mono is the same picture in grey.
        drawable = not ("spectral" in variant or "polarized" in variant)
        plugin = importlib.import_module(module).define() if drawable else _refusal(name, variant)
        getattr(mi, f"register_{kind}")(name, plugin)
    _registered.add(variant)


def _refusal(name: str, variant: str) -> Callable[[mi.Properties], Any]:
    """Make a plugin that says at once what would otherwise read as `plugin not found`."""

    def refuse(props: mi.Properties) -> Any:
        raise RuntimeError(f"{name} `{props.id()}`: draws in the rgb and mono variants, not in {variant}")

    return refuse


def follow_variants() -> None:
    """Register now and after each change of variant."""
    register()
    mi.detail.add_variant_callback(_changed)


def _changed(_old: str | None, _new: str) -> None:
    register()
