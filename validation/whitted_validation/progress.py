"""Bars on the terminal: rows of a picture, or steps of a long work."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress


@contextmanager
def shown(name: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar on a terminal, until the work is done; elsewhere nobody is watching."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.markup import escape

    with _bar() as bar:
        task = bar.add_task(escape(name))
        yield lambda done, rows: bar.update(task, completed=done, total=rows)


@contextmanager
def steps(name: str, count: int) -> Iterator[tuple[Callable[[str], None], Callable[[], None]]]:
    """Show a bar for so many steps: to be told what comes next, and that a step is done."""
    if not sys.stderr.isatty():
        yield lambda _: None, lambda: None
        return
    with _bar() as bar:
        task = bar.add_task(name, total=count)
        yield lambda what: bar.update(task, description=what), lambda: bar.advance(task)


def _bar() -> Progress:
    from rich.console import Console
    from rich.progress import Progress

    return Progress(console=Console(stderr=True), transient=True)
