"""An explanation as text: for a terminal of 80 columns, or a file."""

from __future__ import annotations

import sys
from io import StringIO
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.text import Text
from rich.tree import Tree

from mitsuba_whitted.seen import Numbers
from whitted_validation.explanation.comparison import Pair
from whitted_validation.explanation.tree import Branch

if TYPE_CHECKING:
    from whitted_validation.explanation.explanation import Explanation

WIDTH = 80
LABEL = 18
LAST_DIGIT = 4
"""Half a unit of the sixth digit is at least 5e-7 of a number, an ulp at most 2^-23 of it: so many, at least."""
TONES = {"": "bold", "light": "yellow", "dark": "bright_black"}


def as_text(explanation: Explanation) -> str:
    """Return the explanation without colours."""
    console = Console(file=StringIO(), width=WIDTH, color_system=None, highlight=False)
    console.print(rendered(explanation))
    file = console.file
    assert isinstance(file, StringIO)
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


def show(explanation: Explanation) -> None:
    """Print the explanation: in colours and as wide as the terminal, or plainly, 80 columns wide, if piped."""
    if not sys.stdout.isatty():
        click.echo(as_text(explanation))
        return
    Console(highlight=False).print(rendered(explanation))


def rendered(explanation: Explanation) -> RenderableType:
    """Return the explanation for a console."""
    parts: list[RenderableType] = [Text(explanation.title, "bold")]
    parts += [Text.assemble(f"{name:<{LABEL}}", (exact(value), "bold")) for name, value in explanation.colour.sides]
    for heading, sentences in explanation.answers:
        parts += [Text(), Text(heading, "bold"), *(Padding(Text(sentence), (0, 0, 0, 2)) for sentence in sentences)]
    for heading, branches in explanation.trees:
        parts += [Text(), Text(heading, "bold")]
        parts += [
            _tree(branch, Tree(Text(branch.title, TONES[branch.tone]), guide_style="bright_black"))
            for branch in branches
        ]
    parts += [Text(), Text("Differences are in ulp of float32, at the vector's largest component.", "bright_black")]
    return Group(*parts)


def _tree(branch: Branch, tree: Tree) -> Tree:
    for item in branch.items:
        if isinstance(item, Branch):
            _tree(item, tree.add(Text(item.title, TONES[item.tone])))
        elif isinstance(item, Pair):
            tree.add(_value(item, f"{item.label:<{LABEL}}"))
        else:
            tree.add(Text(item, "italic"))
    return tree


def _value(pair: Pair, label: str) -> Text:
    """Show the plugin's value, and the reference's where its digits may differ, and how far apart they are."""
    shown = [(name, _digits(value)) for name, value in pair.sides]
    if len(shown) == 2 and pair.ulps <= LAST_DIGIT:
        return Text.assemble(label, shown[0][1], (f"  {ulps(pair)}", "bright_black"))
    lines = [f"{digits}  {name}" for name, digits in shown]
    apart = f", {ulps(pair)}" if len(shown) == 2 else " only"
    return Text.assemble(label, f"\n{' ' * LABEL}".join(lines), (apart, "bright_black"))


def _digits(value: Numbers) -> str:
    return " ".join(f"{np.float32(number):>11.6g}" for number in value)


def exact(value: Numbers) -> str:
    """Return as many digits as tell a float32 from its neighbours."""
    return " ".join(f"{number:>14.9g}" for number in value)


def ulps(pair: Pair) -> str:
    """How far apart the programs are, in units in the last place."""
    return f"{pair.ulps:.2g} ulp" if pair.ulps < 1000 else f"{pair.ulps:.1e} ulp"
