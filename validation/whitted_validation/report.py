"""Verdicts on disk: results.json, and report.html as a view of it.

results.json, schema 1
    schema      1
    command     the arguments of the command
    versions    of mitsuba-whitted, mitsuba, drjit, numpy, python; `platform`
    exit        0 if every pixel of every scene is equal or explained, 1 if not, 2 if a scene was not judged
    complete    false while scenes are still missing, and after an interruption
    scenes      one object a scene:
        name, file, variant, against, grid, width, height, seconds
        pixels      equal, explained, unexplained: numbers of pixels
        certified   by whose bound: propagated, sampled, chaotic (numbers of pixels); `loose` of them have a
                    bound above what a coefficient off by 1e-3 changes
        error       median, largest: of |A - B| over all pixels, worst channel
        bound       median, largest (null: infinite)
        differences the pixels that are not equal, unexplained ones first, the largest error first, at most
                    MOST_LISTED: x, y, status, error, bound (null: infinite), reasons, alternatives, complete
    not_judged  one object a scene: scene, why
"""

from __future__ import annotations

import base64
import html
import importlib.metadata
import json
import math
import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_reference.png import encode_png
from whitted_validation.validation import Verdict
from whitted_validation.verdict import Status

SCHEMA = 1
MOST_LISTED = 1000
COLOURS = {Status.EQUAL: (225, 232, 225), Status.EXPLAINED: (60, 110, 220), Status.UNEXPLAINED: (220, 30, 30)}

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; padding: 0 1rem; color: #222 }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums }
th, td { text-align: right; padding: .2rem .6rem; border-bottom: 1px solid #ddd } th:first-child, td:first-child
{ text-align: left } .bad { color: #b00; font-weight: bold } figure { display: inline-block; margin: .5rem }
figcaption { font-size: .85rem; color: #555 } img { image-rendering: pixelated; width: 15rem; display: block }
"""


def results(command: Sequence[str], verdicts: Sequence[Verdict], refused: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Return what results.json holds, but for `complete`."""
    names = ("mitsuba-whitted", "mitsuba", "drjit", "numpy")
    return {
        "schema": SCHEMA,
        "command": list(command),
        "versions": {name: importlib.metadata.version(name) for name in names}
        | {"python": platform.python_version(), "platform": platform.platform()},
        "exit": exit_code(verdicts, refused),
        "scenes": [_scene(verdict) for verdict in verdicts],
        "not_judged": [{"scene": scene, "why": why} for scene, why in refused],
    }


def exit_code(verdicts: Sequence[Verdict], refused: Sequence[tuple[str, str]]) -> int:
    """Return 1 if a pixel is unexplained, else 2 if a scene was refused, else 0."""
    return 1 if not all(verdict.good for verdict in verdicts) else 2 if refused else 0


def _scene(verdict: Verdict) -> dict[str, Any]:
    judgement = verdict.judgement
    bounds = judgement.bounds
    error = _error(verdict)
    bound = bounds.bound.max(axis=2)
    height, width = judgement.status.shape
    sampled, chaotic = int(bounds.sampled.sum()), int(bounds.chaotic.sum())
    return {
        "name": verdict.scene.stem,
        "file": str(verdict.scene),
        "variant": verdict.variant,
        "against": verdict.against,
        "grid": verdict.grid,
        "width": width,
        "height": height,
        "seconds": round(verdict.seconds, 2),
        "pixels": {status.name.lower(): judgement.count(status) for status in Status},
        "certified": {
            "propagated": width * height - sampled - chaotic,
            "sampled": sampled,
            "chaotic": chaotic,
            "loose": int(bounds.loose.sum()),
        },
        "error": {"median": _number(np.median(error)), "largest": _number(error.max())},
        "bound": {"median": _number(np.median(bound)), "largest": _number(bound.max())},
        "differences": [
            {
                "x": d.x,
                "y": d.y,
                "status": d.status.name.lower(),
                "error": _number(d.error),
                "bound": _number(d.bound),
                "reasons": list(d.reasons),
                "alternatives": d.alternatives,
                "complete": d.complete,
            }
            for d in judgement.differences[:MOST_LISTED]
        ],
    }


def _number(x: Any) -> float | None:
    return float(x) if math.isfinite(x) else None


def _error(verdict: Verdict) -> NDArray[np.float64]:
    error = np.abs(verdict.judgement.picture - verdict.judgement.bounds.colour).max(axis=2)
    return np.where(np.isfinite(error), error, np.inf)


def write(folder: Path, facts: dict[str, Any], verdicts: Sequence[Verdict], complete: bool) -> None:
    """Write results.json, then report.html; each complete or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    facts = facts | {"complete": complete}
    _replace(folder / "results.json", json.dumps(facts, indent=1) + "\n")
    _replace(folder / "report.html", page(facts, verdicts))


def _replace(path: Path, text: str) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, path)


def page(facts: dict[str, Any], verdicts: Sequence[Verdict]) -> str:
    """Return the whole page: summary, table and pictures, scenes with most unexplained pixels first."""
    scenes = sorted(
        zip(facts["scenes"], verdicts, strict=True),
        key=lambda pair: [-pair[0]["pixels"][name] for name in ("unexplained", "explained")],
    )
    rows = "".join(_row(scene) for scene, _ in scenes)
    refused = "".join(f"<p>{html.escape(item['why'])}</p>" for item in facts["not_judged"])
    shown = "".join(
        f"<h2>{html.escape(verdict.scene.stem)}</h2>{pictures(verdict)}{_list(scene)}" for scene, verdict in scenes
    )
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>whitted validate</title><style>{STYLE}</style>
<h1>whitted validate</h1>
<p>{html.escape(sentence(facts))}</p>
{refused}
<table><tr><th>scene</th><th>size</th><th>unexplained</th><th>explained</th><th>equal</th><th>median error</th>
<th>largest error</th><th>median bound</th><th>largest bound</th><th>loose</th></tr>{rows}</table>
{shown}
<p><small>{html.escape(", ".join(f"{k} {v}" for k, v in facts["versions"].items()))}</small></p></html>
"""


def sentence(facts: dict[str, Any]) -> str:
    """Say in one sentence what came out."""
    totals = {name: sum(s["pixels"][name] for s in facts["scenes"]) for name in ("equal", "explained", "unexplained")}
    pixels = sum(totals.values())
    whole = "" if facts["complete"] else " (not all scenes: interrupted)"
    left = f"; {len(facts['not_judged'])} scene(s) not judged" if facts["not_judged"] else ""
    return (
        f"{totals['unexplained']} of {pixels} pixels in {len(facts['scenes'])} scene(s) are unexplained, "
        f"{totals['explained']} explained, {totals['equal']} equal{left}{whole}."
    )


def _row(scene: dict[str, Any]) -> str:
    pixels, bad = scene["pixels"], ' class="bad"' if scene["pixels"]["unexplained"] else ""
    numbers = [scene["error"]["median"], scene["error"]["largest"], scene["bound"]["median"], scene["bound"]["largest"]]
    cells = "".join(f"<td>{'inf' if x is None else f'{x:.1e}'}</td>" for x in numbers)
    return (
        f"<tr><td>{html.escape(scene['name'])}</td><td>{scene['width']} x {scene['height']}</td>"
        f"<td{bad}>{pixels['unexplained']}</td><td>{pixels['explained']}</td><td>{pixels['equal']}</td>{cells}"
        f"<td>{scene['certified']['loose']}</td></tr>"
    )


def _list(scene: dict[str, Any]) -> str:
    lines = "".join(
        f"<li>({d['x']}, {d['y']}) {d['status']}: error {_short(d['error'])}, bound {_short(d['bound'])}"
        f"{html.escape(': ' + '; '.join(d['reasons']) if d['reasons'] else '')}</li>"
        for d in scene["differences"][:20]
    )
    return f"<ul>{lines}</ul>" if lines else ""


def _short(x: float | None) -> str:
    return "inf" if x is None else f"{x:.1e}"


def pictures(verdict: Verdict) -> str:
    """Return A, B, the error (black 1e-8 to white 1) and the verdict as HTML."""
    judgement = verdict.judgement
    with np.errstate(divide="ignore"):
        error = np.clip(1.0 + np.log10(_error(verdict)) / 8.0, 0.0, 1.0)
    status = np.zeros((*judgement.status.shape, 3), np.uint8)
    for value, colour in COLOURS.items():
        status[judgement.status == value] = colour
    grey = np.repeat((255.0 * error + 0.5).astype(np.uint8)[:, :, None], 3, axis=2)
    shown = (
        (_srgb(judgement.picture), f"A: {verdict.against or 'plugin, ' + verdict.variant}"),
        (_srgb(judgement.bounds.colour), "B: reference"),
        (grey, "|A - B|, logarithmic: black 1e-8, white 1"),
        (status, "equal grey, explained blue, unexplained red"),
    )
    return "".join(
        f'<figure><img alt="" src="{_uri(data)}"><figcaption>{html.escape(text)}</figcaption></figure>'
        for data, text in shown
    )


def _uri(data: NDArray[np.uint8]) -> str:
    height, width, _ = data.shape
    return "data:image/png;base64," + base64.b64encode(encode_png(width, height, data.tobytes())).decode()


def _srgb(picture: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Encode as 8-bit sRGB (IEC 61966-2-1); what is not finite shows as magenta."""
    linear = np.clip(np.nan_to_num(picture, posinf=1.0, neginf=0.0), 0.0, 1.0)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    coded[~np.isfinite(picture).all(axis=2)] = (1.0, 0.0, 1.0)
    return (255.0 * coded + 0.5).astype(np.uint8)


def command_line() -> list[str]:
    """Return the arguments that this process was started with."""
    return sys.argv[1:]
