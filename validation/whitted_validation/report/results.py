"""results.json: what every command writes, and numbers that JSON has no word for."""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import platform
import sys
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import numpy as np

SCHEMA = 2


def with_header(results: Mapping[str, Any]) -> dict[str, Any]:
    """Put before a command's own results what all of them hold, as plain JSON."""
    header = {"schema": SCHEMA, "command": sys.argv[1:], "environment": environment()}
    plain: dict[str, Any] = _plain(header | dict(results))
    return plain


def environment() -> dict[str, str]:
    """Return versions, and the machine, of this run."""
    names = ("mitsuba-whitted", "mitsuba", "drjit", "numpy")
    facts = {name: importlib.metadata.version(name) for name in names}
    plugins = sys.modules.get("mitsuba_whitted")
    if plugins is not None and plugins.LIBLLVM.version[0] >= 0:
        facts["libLLVM"] = ".".join(map(str, plugins.LIBLLVM.version))
    return facts | {
        "Python": platform.python_version(),
        "platform": platform.platform(),
        "processors": str(os.cpu_count()),
    }


def encoded(results: Mapping[str, Any]) -> str:
    """Write as JSON text."""
    return json.dumps(results, indent=1) + "\n"


def _plain(x: Any) -> Any:
    """Turn into what JSON knows: numpy's numbers, paths and what is not finite."""
    if isinstance(x, Mapping):
        return {str(key): _plain(value) for key, value in x.items()}
    if isinstance(x, (list, tuple)):
        return [_plain(value) for value in x]
    if isinstance(x, np.ndarray | np.generic):
        return _plain(x.tolist())
    if isinstance(x, float) and not math.isfinite(x):
        return "NaN" if math.isnan(x) else "Infinity" if x > 0 else "-Infinity"
    return str(x) if isinstance(x, PurePath) else x
