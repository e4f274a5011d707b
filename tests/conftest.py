"""The variants that tests run in."""

from __future__ import annotations

import os

import mitsuba_whitted  # isort: skip  # before Mitsuba, whose libLLVM it chooses
import mitsuba as mi
import pytest


def set_variant(name: str) -> str:
    """Set a variant; skip the test where this machine lacks it, fail where it must be there."""
    llvm = mitsuba_whitted.LIBLLVM
    if name.startswith("llvm") and llvm.refusal:
        (pytest.fail if "CI" in os.environ else pytest.skip)(llvm.refusal)
    mi.set_variant(name)
    mi.set_log_level(mi.LogLevel.Warn)
    return name


@pytest.fixture
def scalar_rgb() -> str:
    """Set the variant scalar_rgb."""
    return set_variant("scalar_rgb")


@pytest.fixture
def llvm_ad_rgb() -> str:
    """Set the variant llvm_ad_rgb."""
    return set_variant("llvm_ad_rgb")


@pytest.fixture
def llvm_ad_mono() -> str:
    """Set the variant llvm_ad_mono."""
    return set_variant("llvm_ad_mono")


@pytest.fixture(params=["scalar_rgb", "llvm_ad_rgb"])
def any_rgb(request: pytest.FixtureRequest) -> str:
    """Set both rgb variants, one after the other."""
    return set_variant(request.param)


@pytest.fixture(params=["scalar_rgb", "llvm_ad_rgb", "llvm_ad_mono"])
def any_variant(request: pytest.FixtureRequest) -> str:
    """Set every variant that the picture is drawn in on any machine, one after the other."""
    return set_variant(request.param)
