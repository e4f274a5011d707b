"""Which libLLVM is chosen, and what becomes of one that would abort: each case in its own process."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

import mitsuba_whitted
from mitsuba_whitted.libllvm import VARIABLE, Choice

REQUIRED = os.environ.get("WHITTED_TEST_LIBLLVM", "").split()
"""Major versions that .ci/run has installed, and that must therefore be found."""


def installed(major: int) -> str:
    """Path of the system's libLLVM, or skip."""
    for folder in ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"):
        for name in (f"libLLVM-{major}.so.1", f"libLLVM.so.{major}.1"):
            if Path(folder, name).is_file():
                return f"{folder}/{name}"
    assert str(major) not in REQUIRED, f"libllvm{major} was installed but is not found"
    pytest.skip(f"no libLLVM {major} on this machine")


def python(code: str, **environment: str | None) -> subprocess.CompletedProcess[str]:
    """Run a piece of Python with a changed environment; None removes a variable."""
    merged: dict[str, str | None] = {**os.environ, VARIABLE: None, **environment}
    return subprocess.run(
        [sys.executable, "-c", code],
        env={key: value for key, value in merged.items() if value is not None},
        capture_output=True,
        text=True,
        timeout=120,
    )


KERNEL = """
import mitsuba_whitted
import mitsuba as mi, drjit as dr
mi.set_variant("llvm_ad_rgb")
print(mitsuba_whitted.LIBLLVM.version[0], dr.minimum(mi.Float([1, 2]), 1.5))
"""

x86_64 = pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"),
    reason="the wheel, and the abort of LLVM 15 and 16, are of Linux on x86-64",
)


@x86_64
@pytest.mark.parametrize("major", [15, 16])
def test_a_libllvm_that_aborts_does_abort_without_us(major: int) -> None:
    """The premise: if this fails, Dr.Jit or LLVM was mended and the refusal can go."""
    bare = KERNEL.replace("import mitsuba_whitted", "").replace("mitsuba_whitted.LIBLLVM.version[0],", "")
    assert python(bare, **{VARIABLE: installed(major)}).returncode == -6  # SIGABRT


@x86_64
@pytest.mark.parametrize("major", [14, 15, 16])
def test_a_libllvm_too_old_is_an_exception_before_any_kernel(major: int) -> None:
    result = python(KERNEL, **{VARIABLE: installed(major)})
    assert result.returncode == 1
    assert "ImportError" in result.stderr


@x86_64
@pytest.mark.parametrize("major", [15, 16])
def test_the_exception_names_the_library_and_three_ways_out(major: int) -> None:
    path = installed(major)
    line = python(KERNEL, **{VARIABLE: path}).stderr.splitlines()[-1]
    for part in (f"libLLVM {major}.", path, f"set {VARIABLE}", "pip install", "scalar_rgb"):
        assert part in line


@x86_64
@pytest.mark.parametrize("major", [14, 15, 16])
def test_scalar_variants_work_with_any_libllvm(major: int) -> None:
    code = KERNEL.replace("llvm_ad_rgb", "scalar_rgb").replace("mi.Float([1, 2])", "1.0")
    assert python(code, **{VARIABLE: installed(major)}).returncode == 0


@x86_64
def test_a_variant_set_before_the_import_is_refused_by_the_import() -> None:
    code = 'import mitsuba as mi\nmi.set_variant("llvm_ad_rgb")\nimport mitsuba_whitted'
    result = python(code, **{VARIABLE: installed(15)})
    assert result.returncode == 1
    assert "libLLVM 15." in result.stderr.splitlines()[-1]


def test_the_users_own_libllvm_is_never_overridden() -> None:
    result = python(KERNEL, **{VARIABLE: installed(19)})
    assert result.stdout.split()[0] == "19", result.stderr


def test_a_wrong_path_is_refused_and_not_replaced() -> None:
    code = "import mitsuba_whitted\nprint(mitsuba_whitted.LIBLLVM.refusal)"
    result = python(code, **{VARIABLE: "/no/such/libLLVM.so"})
    assert result.stdout.startswith("no usable libLLVM (/no/such/libLLVM.so, set by DRJIT_LIBLLVM_PATH)")


@x86_64
def test_the_wheels_libllvm_comes_before_the_systems() -> None:
    result = python(KERNEL)
    assert result.stdout.startswith("23 [1, 1.5]"), result.stderr


def test_the_environment_is_left_as_it_was() -> None:
    code = f"import os, mitsuba_whitted\nprint({VARIABLE!r} in os.environ)"
    assert python(code).stdout == "False\n"
    assert python(code, **{VARIABLE: "/no/such/libLLVM.so"}).stdout == "True\n"


def test_importing_mitsuba_first_leaves_the_choice_to_it_and_says_so() -> None:
    code = "import mitsuba, mitsuba_whitted\nprint(mitsuba_whitted.LIBLLVM.reason)"
    assert "imported before mitsuba_whitted" in python(code).stdout


@pytest.mark.parametrize(
    ("machine", "version", "fine"),
    [
        ("x86_64", (17, 0, 6), True),
        ("x86_64", (16, 0, 6), False),
        ("AMD64", (15, 0, 0), False),
        ("aarch64", (15, 0, 0), True),
        ("aarch64", (-1, -1, -1), False),
    ],
)
def test_the_oldest_libllvm_depends_on_the_machine(
    machine: str, version: tuple[int, int, int], fine: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    refusal = Choice(version, None, "found by Dr.Jit's own search").refusal
    assert (refusal is None) == fine
    assert "\n" not in (refusal or "")


def test_this_very_process_has_a_choice() -> None:
    assert mitsuba_whitted.LIBLLVM.reason
