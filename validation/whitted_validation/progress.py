"""A bar on the terminal while rows of a picture are done."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def shown(name: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar on a terminal, until the work is done; elsewhere nobody is watching."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape(name))
        yield lambda done, rows: bar.update(task, completed=done, total=rows)
