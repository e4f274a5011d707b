"""Names from files, as they can be shown to people without harm."""

from __future__ import annotations

LONGEST_NAME = 40
_HARMLESS = "\N{NO-BREAK SPACE}\N{ZERO WIDTH JOINER}\N{ZERO WIDTH NON-JOINER}"  # within tables, emoji, Persian words


def printable(text: object) -> str:
    r"""Spell out what a terminal would obey, what turns the direction of writing, and what cannot be shown.

    An escape becomes ``\x1b``, a line feed ``\n``, half a surrogate pair (a file name that is not UTF-8) ``\udce9``.
    """
    return "".join(c if c.isprintable() or c in _HARMLESS else c.encode("unicode_escape").decode() for c in str(text))


def named(name: str | None) -> str:
    """Quote an id from a file for people: no quotes within, and cut where it is too long."""
    if name is None:
        return "nothing"
    text = printable(name).replace("`", "'")
    return f"`{text if len(text) <= LONGEST_NAME else text[: LONGEST_NAME - 3] + '...'}`"
