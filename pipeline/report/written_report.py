"""Self-contained HTML pages: sections with tables, plots and pictures, by the templates beside this file."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markdown_it import MarkdownIt
from markdown_it.token import Token

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_PARTS: Any = _TEMPLATES.get_template("parts.jinja").module
_MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")
_WITH_INTERVAL = re.compile(r"(-?[\d.e+-]+) \((-?[\d.e+-]+(?:–| to )-?[\d.e+-]+)\)")


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        title: Its heading.
        note: Plain text below the heading.
        body: HTML, inserted as it is.
        folded: Whether only the title shows until a click.
    """

    title: str
    note: str
    body: str
    folded: bool = False


def page(title: str, lead: str, facts: Mapping[str, str], sections: Sequence[Section]) -> str:
    """The whole page.

    Args:
        title: Plain text.
        lead: Plain text, the first paragraph.
        facts: A short list of settings, name to value, plain text.
        sections: In order.
    """
    return _TEMPLATES.get_template("page.jinja").render(title=title, lead=lead, facts=facts, sections=sections) + "\n"


def html_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of plain text; the interval of a cell like `0.53 (0.47–0.60)` is in small type below the number."""
    cells = [[(m[1], m[2]) if (m := _WITH_INTERVAL.fullmatch(cell)) else (cell, "") for cell in row] for row in rows]
    return str(_PARTS.table(header, cells))


def picture(data: bytes, caption: str, labels: Sequence[str] = ()) -> str:
    """A JPEG or WebP inside the page; labels: of its panels from left to right, of one width."""
    kind = "webp" if data[8:12] == b"WEBP" else "jpeg"
    return str(_PARTS.picture(f"data:image/{kind};base64,{base64.b64encode(data).decode()}", caption, labels))


def drawing(svg: str, caption: str) -> str:
    """An SVG inside the page."""
    return str(_PARTS.drawing(svg, caption))


def folded(title: str, text: str) -> str:
    """Preformatted plain text that opens on a click."""
    return str(_PARTS.folded(title, text))


def prose(markdown: str, link_base: str = "") -> str:
    """Markdown as HTML; relative links are taken from the folder `link_base`."""
    tokens = _MARKDOWN.parse(markdown)
    for token in (inner for block in tokens for inner in block.children or ()):
        _rebase(token, link_base)
    return str(_MARKDOWN.renderer.render(tokens, _MARKDOWN.options, {}))


def _rebase(token: Token, link_base: str) -> None:
    target = token.attrGet("href") if token.type == "link_open" else None
    if link_base and isinstance(target, str) and not re.match(r"[a-z]+:|[#/]", target):
        token.attrSet("href", f"{link_base}/{target}")


def prose_by_heading(file: Path, link_base: str = "") -> dict[str, str]:
    """The text of a Markdown file below each `## heading`, as HTML, by heading."""
    _, *parts = re.split(r"^## +(.+?)\s*$", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {title: prose(text, link_base) for title, text in zip(parts[::2], parts[1::2], strict=True)}
