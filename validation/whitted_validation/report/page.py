"""The page: one file, no network, and nothing in it runs but what stands in this folder."""

from __future__ import annotations

import base64
import hashlib
import html
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from whitted_validation.refusal import Refusal
from whitted_validation.report.results import encoded, with_header
from whitted_validation.report.sections import Section, Table

_HERE = Path(__file__).parent


def write(folder: Path, results: Mapping[str, Any], title: str, sections: Sequence[Section], style: str = "") -> None:
    """Write results.json, then report.html; each complete or not at all.

    Parameters
    ----------
    folder : made if it is missing
    results : what the command found; schema, command and environment are put before it
    title : of the page
    sections : the page, from the top; the versions are added at the end
    style : more CSS, see the package's docstring

    Raises
    ------
    Refusal
        If the folder cannot be written to.
    """
    facts = with_header(results)
    text = page(title, sections, facts, style)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _replace(folder / "results.json", encoded(facts))
        _replace(folder / "report.html", text)
    except OSError as error:
        raise Refusal(f"--report {folder}: cannot be written: {error.strerror or error}") from None


def page(title: str, sections: Sequence[Section], facts: Mapping[str, Any], style: str = "") -> str:
    """Return the whole page."""
    script = "\n".join(_asset(f"{name}.js") for name in ("planes", "drawing", "telling", "viewer"))
    css = _asset("page.css") + _asset("viewer.css") + style
    policy = (
        f"default-src 'none'; script-src 'sha256-{_sha256(script)}'; style-src 'sha256-{_sha256(css)}'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    made = Table(["made by", "version"], list(facts["environment"].items())).html()
    command = html.escape(" ".join(["whitted", *facts["command"]]))
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{html.escape(title)}</title>
<style>{css}</style>
</head>
<body>
<header><h1>{html.escape(title)}</h1></header>
<main>
{"".join(section.html() for section in sections)}
<section id="environment"><h2>Environment</h2><p class="quiet"><code>{command}</code></p>{made}</section>
</main>
{_asset("viewer.html")}
<script>{script}</script>
</body>
</html>
"""


def _asset(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


def _sha256(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _replace(path: Path, text: str) -> None:
    """Write beside, then rename."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_bytes(text.encode("utf-8", "replace"))  # a file name need not be UTF-8
        os.replace(beside, path)
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
