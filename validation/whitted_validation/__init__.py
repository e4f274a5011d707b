"""The harness: the command line, the comparison of both tracers, and its reports.

from whitted_validation import validate
validate("whitted_1980")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from whitted_validation.validation import Verdict, validate

__all__ = ["Verdict", "validate"]


def __getattr__(name: str) -> Any:
    """Import what is asked for only then: the command line must not wait for numpy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from whitted_validation import validation

    return getattr(validation, name)
