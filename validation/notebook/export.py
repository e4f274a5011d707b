"""Run the notebook beside this file, and write it with what it shows, and as a page of HTML: `python export.py`.

A notebook is JSON (nbformat 4.5). To run one takes a namespace and the value of each cell's last line; that is
less than a kernel, its messages and its sockets, and needs nothing but Python. Jupyter opens the same file.
"""

from __future__ import annotations

import ast
import html
import json
import os
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

HERE = Path(__file__).resolve().parent
NAME = "textbook"

STYLE = """
:root { color-scheme: light dark; --paper: #fdfdfb; --panel: #f3f3ef; --ink: #1d1f21; --quiet: #62666b }
@media (prefers-color-scheme: dark) {
  :root { --paper: #15171a; --panel: #1f2226; --ink: #e6e7e8; --quiet: #9aa0a6 }
}
body { margin: 0 auto; max-width: 50rem; padding: 1.5rem 1.25rem 4rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif }
h1 { font-size: 1.7rem } h2 { font-size: 1.25rem; margin-top: 2.5rem }
pre, code { font-family: ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; font-size: .85rem }
pre { padding: .7rem .9rem; overflow-x: auto; margin: .6rem 0; border-radius: .3rem }
pre.code { background: var(--panel) } pre.shown { color: var(--quiet); padding-top: 0; white-space: pre-wrap }
figure { margin: .6rem 0 } figure img { width: 100%; max-width: 40rem; height: auto; image-rendering: pixelated;
  display: block }
"""


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """Return the notebook with the outputs of its cells, run one after the other in one namespace."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    cells, count = [], 0
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            count += 1
            cell = {**cell, "execution_count": count, "outputs": _run("".join(cell["source"]), namespace, count)}
        cells.append(cell)
    return {**notebook, "cells": cells}


def _run(source: str, namespace: dict[str, Any], count: int) -> list[dict[str, Any]]:
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = StringIO(), None
    with redirect_stdout(printed):
        exec(compile(tree, f"cell {count}", "exec"), namespace)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"cell {count}", "eval"), namespace)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": _lines(printed.getvalue())})
    if value is not None:
        data = {"text/plain": _lines(repr(value))}
        if hasattr(value, "_repr_html_"):
            data = {"text/html": _lines(value._repr_html_()), "text/plain": [f"<{type(value).__name__}>"]}
        outputs.append({"output_type": "execute_result", "execution_count": count, "metadata": {}, "data": data})
    return outputs


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def page(notebook: dict[str, Any]) -> str:
    """Return an executed notebook as a page that needs nothing but a browser."""
    title = html.escape("".join(notebook["cells"][0]["source"]).splitlines()[0].lstrip("# "))
    body = "\n".join(part for cell in notebook["cells"] for part in _shown(cell))
    return (
        f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{title}</title>\n'
        f"<style>{STYLE}</style></head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def _shown(cell: dict[str, Any]) -> list[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return [MarkdownIt().render(source)]
    parts = [f'<pre class="code"><code>{html.escape(source)}</code></pre>']
    for output in cell["outputs"]:
        data = output.get("data", {"text/plain": output.get("text", [])})
        if "text/html" in data:
            parts.append("".join(data["text/html"]))
        else:
            parts.append(f'<pre class="shown">{html.escape("".join(data["text/plain"]))}</pre>')
    return parts


def main(folder: Path) -> None:
    """Write the notebook with its outputs, and the page, to a folder."""
    notebook = json.loads((HERE / f"{NAME}.ipynb").read_text(encoding="utf-8"))
    os.chdir(HERE)  # as Jupyter does
    notebook = executed(notebook)
    text = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
    (folder / f"{NAME}.ipynb").write_text(text, encoding="utf-8")
    (folder / f"{NAME}.html").write_text(page(notebook), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else HERE)
