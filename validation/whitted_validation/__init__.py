"""The harness: the command line, the comparison of both tracers, and its reports.

from whitted_validation import compare, explain, validate
validate("whitted_1980")
compare("a.exr", "b.exr")
explain("whitted_1980", 300, 260)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from whitted_validation.comparison import Comparison, compare
    from whitted_validation.explanation.explanation import Explanation, explain
    from whitted_validation.validation import Verdict, validate

__all__ = ["Comparison", "Explanation", "Verdict", "compare", "explain", "validate"]

_HOME = {
    "Comparison": "comparison",
    "Explanation": "explanation.explanation",
    "Verdict": "validation",
    "compare": "comparison",
    "explain": "explanation.explanation",
    "validate": "validation",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for only then: the command line must not wait for numpy."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
