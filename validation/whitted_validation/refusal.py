"""What the command line says when it will not go on."""

from __future__ import annotations


class Refusal(Exception):
    """A scene, file or machine that cannot be used.

    The message is one line for the person who typed the command: which file and element, the value, and what
    is allowed. It ends the command with exit code 2.
    """
