"""One self-contained HTML page: clips that play in step, the motion in 3D, the scene as text, and what was measured."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.viewer.page.film import Film

FOLDER = Path(__file__).parent
_TEMPLATES = Environment(
    loader=FileSystemLoader(FOLDER), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
)


@dataclass(frozen=True)
class Table:
    """A table of plain text.

    Attributes:
        title: Its heading.
        header: Of the columns; empty for none.
        rows: Cells.
        note: A sentence below the title, or nothing.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True)
class ResultPage:
    """What a page shows.

    Attributes:
        title: Plain text.
        grade: "good", "doubtful" or "poor"; empty for none.
        reason: Of the grade, or a first sentence.
        film: The clips.
        motion: From `motion_record`.
        scene: Its text.
        tables: In order.
        notes: Sentences.
    """

    title: str
    grade: str
    reason: str
    film: Film
    motion: dict[str, Any]
    scene: str
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()


def asset(name: str) -> str:
    """A script or style sheet of this package."""
    return (FOLDER / name).read_text(encoding="utf-8")


def html(page: ResultPage) -> str:
    """The whole page. It asks for nothing from any network, and its policy (CSP) forbids it."""
    data = {"film": page.film.record_with_video(), "motion": page.motion}
    made = _TEMPLATES.get_template("result.jinja").render(
        page=page,
        data=json_in_html(data),
        css=asset("page.css"),
        viewer=asset("viewer.js"),
        player=asset("player.js"),
    )
    return made + "\n"


def json_in_html(data: Any) -> str:
    """JSON that cannot end the script element around it."""
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")
