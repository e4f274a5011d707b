"""What a page is made of. Each section turns itself into HTML and escapes what it shows."""

from __future__ import annotations

import base64
import html
import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from whitted_reference.png import encode_png

Tone = Literal["", "good", "bad", "quiet"]


class Section(Protocol):
    """A part of a page."""

    def html(self) -> str:
        """Return it as HTML that is safe whatever the names in it."""


@dataclass(frozen=True)
class Sentence:
    """A paragraph; names in it stand in `backticks`."""

    text: str
    tone: Tone = ""

    def html(self) -> str:
        """Return a paragraph."""
        return f'<p class="sentence {self.tone}">{prose(self.text)}</p>'


@dataclass(frozen=True)
class Cell:
    """A cell that is more than a number or a text: with a tone, or leading to the `Group` of the title `to`."""

    value: str | float
    tone: Tone = ""
    to: str = ""


@dataclass(frozen=True)
class Table:
    """A table; its first column is text, numbers are aligned on the right."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str | float | Cell]]
    caption: str = ""

    def html(self) -> str:
        """Return a table that scrolls by itself where it is too wide."""
        numeric = [not isinstance(_as_cell(value).value, str) for value in (self.rows[0] if self.rows else ())]
        numeric += [False] * (len(self.columns) - len(numeric))
        head = "".join(
            f'<th scope="col" class="{"number" if number else ""}">{html.escape(column)}</th>'
            for column, number in zip(self.columns, numeric, strict=True)
        )
        body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in self.rows)
        caption = f"<caption>{html.escape(self.caption)}</caption>" if self.caption else ""
        return (
            f'<div class="wide" tabindex="0" role="region" aria-label="{html.escape(self.caption or "table")}">'
            f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        )


@dataclass(frozen=True)
class Picture:
    """A small picture.

    Attributes
    ----------
    pixels : (height, width, 3), linear radiance as floats or sRGB as uint8
    """

    pixels: NDArray[np.floating] | NDArray[np.uint8]
    caption: str

    def html(self) -> str:
        """Return a figure with a PNG in it; what is not finite shows as magenta."""
        coded = self.pixels if self.pixels.dtype == np.uint8 else _srgb(np.asarray(self.pixels, np.float64))
        height, width, _ = coded.shape
        data = base64.b64encode(encode_png(width, height, coded.tobytes())).decode()
        caption = html.escape(self.caption)
        return (
            f'<figure><img alt="{caption}" width="{width}" height="{height}" src="data:image/png;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>"
        )


@dataclass(frozen=True)
class Markup:
    """HTML or SVG that its author has made safe."""

    markup: str

    def html(self) -> str:
        """Return it as it is."""
        return self.markup


@dataclass(frozen=True)
class Group:
    """A heading with its sections. Titles are unique on a page if cells lead to them."""

    title: str
    sections: Sequence[Section] = field(default_factory=tuple)
    note: str = ""

    def html(self) -> str:
        """Return a section with an anchor."""
        note = f'<p class="quiet">{prose(self.note)}</p>' if self.note else ""
        inner = "".join(section.html() for section in self.sections)
        return f'<section id="{_anchor(self.title)}"><h2>{html.escape(self.title)}</h2>{note}{inner}</section>'


def prose(text: str) -> str:
    """Escape a text, and set what stands in `backticks` as a name."""
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", html.escape(text))


def short(x: float) -> str:
    """Write a number in a table: integers whole, others with two digits behind the first."""
    if isinstance(x, (int, np.integer)):
        return f"{x:,}"
    if not math.isfinite(x):
        return "not a number" if math.isnan(x) else "infinite" if x > 0 else "-infinite"
    return f"{x:.3g}" if x == 0 or 1e-3 <= abs(x) < 1e4 else f"{x:.2e}"


def _as_cell(value: str | float | Cell) -> Cell:
    return value if isinstance(value, Cell) else Cell(value)


def _cell(value: str | float | Cell) -> str:
    cell = _as_cell(value)
    number = not isinstance(cell.value, str)
    text = html.escape(cell.value if isinstance(cell.value, str) else short(cell.value))
    if cell.to:
        text = f'<a href="#{_anchor(cell.to)}">{text}</a>'
    return f'<td class="{"number " if number else ""}{cell.tone}">{text}</td>'


def _anchor(title: str) -> str:
    """Name a place on the page by what no title can break out of."""
    return f"at-{zlib.crc32(title.encode('utf-8', 'replace')):08x}"


def _srgb(picture: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Encode as 8-bit sRGB (IEC 61966-2-1)."""
    linear = np.clip(np.nan_to_num(picture, posinf=1.0, neginf=0.0), 0.0, 1.0)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    coded[~np.isfinite(picture).all(axis=2)] = (1.0, 0.0, 1.0)
    return (255.0 * coded + 0.5).astype(np.uint8)
