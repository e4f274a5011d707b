"""Which variant of Mitsuba draws, and whether this machine can run it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

from whitted_validation.refusal import Refusal


def choose(asked: str | None) -> tuple[str, str]:
    """Choose the variant, without setting it yet.

    A variant that was asked for is taken or refused. Else the first that works of cuda_ad_rgb, llvm_ad_rgb
    and scalar_rgb is taken.

    Returns
    -------
    (str, str)
        The variant, and a line that says why.

    Raises
    ------
    Refusal
        If it does not exist, cannot draw the picture, or would not survive on this machine.
    """
    with _silence():  # Dr.Jit writes straight to stderr about a libLLVM that it cannot use
        import mitsuba_whitted
    import drjit as dr
    import mitsuba as mi

    llvm = mitsuba_whitted.LIBLLVM
    number = ".".join(map(str, llvm.version))
    has_gpu = dr.has_backend(dr.JitBackend.CUDA)
    if asked is None:
        if has_gpu:
            return "cuda_ad_rgb", "variant cuda_ad_rgb, since a GPU answers; validated is llvm_ad_rgb"
        if llvm.refusal is None:
            return "llvm_ad_rgb", f"variant llvm_ad_rgb, libLLVM {number} {llvm.reason}"
        return "scalar_rgb", f"variant scalar_rgb, slow: {llvm.refusal}"
    if asked not in mi.variants():
        raise Refusal(f"-m {asked}: no such variant; this Mitsuba has {', '.join(_drawable())}")
    if asked not in _drawable():
        raise Refusal(f"-m {asked}: the picture is defined in rgb and mono; use {', '.join(_drawable())}")
    if asked.startswith("llvm") and llvm.refusal:
        raise Refusal(f"-m {asked}: {llvm.refusal}")
    if asked.startswith("cuda") and not has_gpu:
        raise Refusal(f"-m {asked}: no NVIDIA GPU answers; use llvm_ad_rgb or scalar_rgb")
    return asked, f"variant {asked}"


def _drawable() -> list[str]:
    import mitsuba as mi

    return [name for name in mi.variants() if name.endswith(("_rgb", "_mono"))]


@contextmanager
def _silence() -> Iterator[None]:
    """Keep what native code writes to stderr from showing."""
    with tempfile.TemporaryFile() as sink:
        stderr = os.dup(2)
        os.dup2(sink.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
