"""What the command line says when it will not go on."""

from __future__ import annotations

from pathlib import Path


class Refusal(Exception):
    """A scene, file or machine that cannot be used.

    The message is one line for the person who typed the command: which file and element, the value, and what
    is allowed. It ends the command with exit code 2.
    """


def no_such_sensor(file: Path, count: int, asked: int) -> Refusal:
    """Say which numbers -s takes."""
    there = {0: "it has no sensor", 1: "its only sensor is 0"}.get(count, f"its sensors are 0 to {count - 1}")
    return Refusal(f"{file}: there is no -s {asked}; {there}")
