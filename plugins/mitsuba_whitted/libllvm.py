"""The libLLVM that Dr.Jit compiles with: chosen before Dr.Jit is imported, judged after.

Dr.Jit reads ``DRJIT_LIBLLVM_PATH`` once, while it is being imported, and never looks again. Whoever wants a
say has to be there first; whoever comes later can only check.
"""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

VARIABLE = "DRJIT_LIBLLVM_PATH"
WHEEL = "karellen-llvm-core"

# Dr.Jit 1.5 emits `llvm.minimum` and `llvm.maximum`, which the x86 back-ends of LLVM 15 and 16 cannot select:
# they call abort() at the first such kernel. Dr.Jit itself turns away everything before 15.
OLDEST_ON_X86 = 17

REMEDY = (
    f"set {VARIABLE} to a libLLVM {OLDEST_ON_X86} or newer before Python starts, "
    f"or unset it and run `pip install '{WHEEL}>=23,<24'` (Linux x86-64), "
    "or use the variant scalar_rgb"
)


@dataclass(frozen=True)
class Choice:
    """What Dr.Jit was given and what it made of it.

    Attributes
    ----------
    version
        Major, minor, patch as Dr.Jit reports them; (-1, -1, -1) where it could use none.
    path
        The file that was loaded or asked for; None where Dr.Jit searched by itself and it cannot be told.
    reason
        Why this one, as half a sentence.
    """

    version: tuple[int, int, int]
    path: str | None
    reason: str

    @property
    def refusal(self) -> str | None:
        """One line that says why no LLVM variant may run and what to do; None where all is well."""
        where = f"{self.path}, {self.reason}" if self.path else self.reason
        if self.version[0] < 0:
            return f"no usable libLLVM ({where}): {REMEDY}"
        if platform.machine() in ("x86_64", "AMD64") and self.version[0] < OLDEST_ON_X86:
            number = ".".join(map(str, self.version))
            return f"libLLVM {number} would abort the process ({where}): {REMEDY}"
        return None


@functools.cache
def choose() -> Choice:
    """Import Dr.Jit with the libLLVM that suits it best, unless the user or an earlier import has chosen.

    The environment is put back afterwards, so that a child process makes its own choice.

    Returns
    -------
    Choice
        The same object at every call.
    """
    path = os.environ.get(VARIABLE)
    reason = "found by Dr.Jit's own search"
    if path:
        reason = f"set by {VARIABLE}"
    elif "drjit" in sys.modules:
        reason = "chosen by Dr.Jit, which was imported before mitsuba_whitted"
    elif path := _in_wheel():
        reason = f"from the package {WHEEL}"
        os.environ[VARIABLE] = path
        try:
            import drjit
        finally:
            del os.environ[VARIABLE]
    import drjit

    return Choice(_version(drjit), _in_memory() or path, reason)


def _version(drjit: ModuleType) -> tuple[int, int, int]:
    """Ask Dr.Jit which libLLVM it has loaded, once its thread that loads it is done.

    ``drjit.detail.llvm_version`` waits for that thread while it holds Python's interpreter lock, which the thread
    needs to complain of a library that is too old: now and then both wait for ever. A call through ctypes gives
    the lock away.
    """
    try:
        core = ctypes.CDLL(str(Path(str(drjit.__file__)).with_name("libdrjit-core.so")))
        ask = core["_Z16jit_llvm_versionPiS_S_"]  # a C++ function of three int *
    except (OSError, AttributeError):  # no Linux, or another Dr.Jit
        version: tuple[int, int, int] = drjit.detail.llvm_version()
        return version
    numbers = [ctypes.c_int(), ctypes.c_int(), ctypes.c_int()]
    ask(*(ctypes.byref(number) for number in numbers))
    major, minor, patch = (number.value for number in numbers)
    return major, minor, patch


def _in_wheel() -> str | None:
    """Look for the library among the files that pip recorded (PEP 376); the wheel decides where it lies, not we.

    ``importlib.metadata`` would say the same, but a program that draws a small picture would start slower by it.
    """
    for folder in sys.path:
        for record in Path(folder).glob(f"{WHEEL.replace('-', '_')}-*.dist-info/RECORD"):
            for file in re.findall(r"^(.*libLLVM\.so\.[\d.]+),", record.read_text(encoding="utf-8"), re.MULTILINE):
                path = record.parent.parent.joinpath(file).resolve()
                if path.is_file():
                    return str(path)
    return None


def _in_memory() -> str | None:
    """Read from Linux which libLLVM this process holds; None elsewhere, or where it is not to be told."""
    try:
        maps = Path("/proc/self/maps").read_text()
    except OSError:
        return None
    loaded = set(re.findall(r"(/.*/libLLVM[^/\n]*)$", maps, re.MULTILINE))
    return loaded.pop() if len(loaded) == 1 else None
