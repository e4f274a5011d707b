"""An explanation as a piece of HTML for the report, a notebook, or a page of its own; no script in it."""

from __future__ import annotations

import html as markup
from typing import TYPE_CHECKING

import numpy as np

from whitted_validation.explanation.comparison import Pair
from whitted_validation.explanation.terminal import exact, ulps
from whitted_validation.explanation.tree import Branch

if TYPE_CHECKING:
    from mitsuba_whitted.seen import Numbers
    from whitted_validation.explanation.explanation import Explanation

STYLE = """
.explain {
  --paper: #fdfdfb; --panel: #f3f3ef; --ink: #1d1f21; --quiet: #62666b; --line: #d9dad4; --accent: #1f5fbf;
  --sun: #b07800; --shade: #8a8f96;
  background: var(--paper); color: var(--ink); font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto,
  "Helvetica Neue", Arial, sans-serif; max-width: 60rem;
}
@media screen and (prefers-color-scheme: dark) {
  .explain {
    --paper: #15171a; --panel: #1f2226; --ink: #e6e7e8; --quiet: #9aa0a6; --line: #363a40; --accent: #7fb0ff;
    --sun: #ffc14d; --shade: #7b828a;
  }
}
.explain h3 { font-size: 1.05rem; font-weight: 600; margin: 0 0 .75rem; overflow-wrap: anywhere }
.explain h4 { font-size: .95rem; font-weight: 600; margin: 1.1rem 0 .2rem; color: var(--quiet) }
.explain p { margin: .15rem 0; overflow-wrap: anywhere; max-width: 46rem }
.explain code { font: .9em ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; color: inherit;
  background: var(--panel); padding: 0 .25em; border-radius: .2em; overflow-wrap: anywhere }
.explain .sight { display: flex; flex-wrap: wrap; gap: .5rem 1.25rem; margin: .75rem 0 }
.explain figure { margin: 0; flex: 1 1 19rem; max-width: 30rem }
.explain figcaption { color: var(--quiet); font-size: .85rem }
.explain svg { display: block; width: 100%; height: auto; background: var(--panel); border-radius: .4rem }
.explain svg text { font: 11px system-ui, sans-serif; fill: var(--ink); paint-order: stroke; stroke: var(--panel);
  stroke-width: 3px; stroke-linejoin: round }
.explain svg text.light { fill: var(--sun) } .explain svg text.quiet { fill: var(--quiet) }
.explain .shape, .explain .touched, .explain .blocker { fill: none; stroke: var(--line); stroke-width: 1;
  stroke-linejoin: round; fill-rule: evenodd }
.explain .touched { fill: var(--accent); fill-opacity: .1; stroke: var(--accent); stroke-width: 1.25 }
.explain .blocker { fill: var(--shade); fill-opacity: .22; stroke: var(--shade); stroke-width: 1.25 }
.explain line.ray { stroke: var(--ink); stroke-width: 1.6 } .explain polygon.ray { fill: var(--ink) }
.explain .later { opacity: .35 } .explain line.later { stroke-width: .7 }
.explain line.normal { stroke: var(--accent); stroke-width: 1.2 } .explain polygon.normal { fill: var(--accent) }
.explain line.shadow { stroke-width: 1.3; stroke-dasharray: 5 4 }
.explain .lit { stroke: var(--sun) } .explain .blocked { stroke: var(--shade) }
.explain .sun { fill: var(--sun); stroke-width: 1.4 } .explain .sun.blocked { fill: none }
.explain .hit, .explain .eye { fill: var(--ink); stroke: var(--panel); stroke-width: 1 }
.explain table { border-collapse: collapse; font-size: .85rem; font-variant-numeric: tabular-nums; width: 100% }
.explain table.colours { width: auto; font-size: 1rem }
.explain .wide { overflow-x: auto }
.explain th { text-align: center; font-weight: 500; color: var(--quiet); padding: .15rem .9rem .15rem 0 }
.explain td { padding: .1rem .9rem .1rem 0; border: 0; text-align: left; white-space: pre; vertical-align: top;
  background: none }
.explain td.number { text-align: right; font-family: ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace }
.explain tr { background: none }
.explain tr.head td, .explain tr.light td, .explain tr.dark td { white-space: normal; padding-top: .55rem }
.explain tr.head td { font-weight: 600; border-top: 1px solid var(--line) }
.explain tr.light td { color: var(--sun); font-weight: 600 }
.explain tr.dark td, .explain tr.remark td { color: var(--quiet) }
.explain tr.remark td { white-space: normal; font-style: italic }
.explain details { margin-top: 1rem } .explain summary { cursor: pointer; font-weight: 600 }
"""


def html(explanation: Explanation) -> str:
    """Return the answers, the drawing and the ray trees; every name from a file is escaped."""
    parts = [f"<h3>{_text(explanation.title)}</h3>", _colour(explanation.colour)]
    for heading, sentences in explanation.answers:
        parts.append(f"<h4>{_text(heading)}</h4>" + "".join(f"<p>{_text(sentence)}</p>" for sentence in sentences))
    parts.append(explanation.drawing())
    parts += [_tree(heading, branches) for heading, branches in explanation.trees]
    return f'<div class="explain">{"".join(parts)}</div>'


def _text(words: str) -> str:
    """Escape words, and set what stands in backquotes as code."""
    pieces = markup.escape(words).split("`")
    return "".join(f"<code>{piece}</code>" if i % 2 else piece for i, piece in enumerate(pieces))


def _colour(pair: Pair) -> str:
    rows = "".join(f'<tr><td>{name}</td><td class="number">{exact(value)}</td></tr>' for name, value in pair.sides)
    return f'<div class="wide"><table class="colours"><tbody>{rows}</tbody></table></div>'


def _tree(heading: str, branches: list[Branch]) -> str:
    head = "<tr><th></th><th>plugin</th><th>reference</th><th>apart</th></tr>"
    rows = "".join(_rows(branch, "head") for branch in branches)
    return (
        f"<details open><summary>{_text(heading)}</summary>"
        f'<div class="wide"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div></details>'
    )


def _rows(branch: Branch, kind: str) -> str:
    rows = [f'<tr class="{kind}"><td colspan="4">{_text(branch.title)}</td></tr>']
    for item in branch.items:
        if isinstance(item, Branch):
            rows.append(_rows(item, item.tone))
        elif isinstance(item, Pair):
            apart = ulps(item) if len(item.sides) == 2 else ""
            rows.append(
                f'<tr><td>{_text(item.label)}</td><td class="number">{_digits(item.plugin)}</td>'
                f'<td class="number">{_digits(item.reference)}</td><td class="number">{apart}</td></tr>'
            )
        else:
            rows.append(f'<tr class="remark"><td colspan="4">{_text(item)}</td></tr>')
    return "".join(rows)


def _digits(value: Numbers | None) -> str:
    return " ".join(f"{np.float32(number):>12.7g}" for number in value or ())
