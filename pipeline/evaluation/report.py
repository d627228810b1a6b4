"""`reports/index.html`: one self-contained page with the tables, the curves and some clips."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; color: #222; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2em; border-bottom: 1px solid #ddd; }
table { border-collapse: collapse; font-size: 13px; }
th, td { padding: 3px 8px; text-align: left; white-space: nowrap; }
th { border-bottom: 2px solid #888; } tr:nth-child(even) td { background: #f6f6f6; }
.scroll { overflow-x: auto; } .note { color: #555; }
pre { background: #f6f6f6; padding: 8px; font-size: 12px; overflow-x: auto; }
figure { margin: 1em 0; } figcaption { color: #555; font-size: 13px; } img, svg { max-width: 100%; height: auto; }
.row { display: flex; flex-wrap: wrap; gap: 1.5em; }
"""


@dataclass(frozen=True)
class Section:
    """A heading, a sentence or two, and ready-made HTML."""

    title: str
    note: str
    body: str


def html_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{html.escape(h)}</th>" for h in header)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><tr>{head}</tr>{body}</table></div>'


def picture(data: bytes, caption: str) -> str:
    """A JPEG, inside the page."""
    encoded = base64.b64encode(data).decode()
    return (
        f'<figure><img src="data:image/jpeg;base64,{encoded}"><figcaption>{html.escape(caption)}</figcaption></figure>'
    )


def drawing(svg: str, caption: str) -> str:
    """An SVG, inside the page."""
    return f"<figure>{svg}<figcaption>{html.escape(caption)}</figcaption></figure>"


def folded(title: str, text: str) -> str:
    """Text that opens on a click."""
    return f"<details><summary>{html.escape(title)}</summary><pre>{html.escape(text)}</pre></details>"


def page(title: str, lead: str, facts: Mapping[str, str], sections: Sequence[Section]) -> str:
    """The whole page. lead: plain text; facts: a short list of settings."""
    listed = html_table(["setting", "value"], list(facts.items()))
    blocks = "".join(
        f'<h2>{html.escape(s.title)}</h2><p class="note">{html.escape(s.note)}</p>{s.body}' for s in sections
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{STYLE}</style></head><body><h1>{html.escape(title)}</h1><p>{html.escape(lead)}</p>{listed}{blocks}</body></html>\n"
    )
