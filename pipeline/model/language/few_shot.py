"""The instructions for a model that was not fine-tuned, before its worked examples: the text of few_shot.jinja."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, StrictUndefined

from pipeline.model.language.completion import EVENT_PHRASES, MAX_OBJECTS

TEMPLATE = Path(__file__).with_name("few_shot.jinja")
PICTURES = ("channels", "wheel", "rgb")  # kinds of flow pictures, and the frames themselves


def instructions(
    pictures: str, reasoning: bool, frames: int, seconds: float, fps: int, max_px: float, width: int
) -> str:
    """The text for clips of `seconds` of which `frames` are shown, as one of PICTURES; max_px: the longest flow that
    the pictures tell apart, px at a width of `width`."""
    assert pictures in PICTURES
    template = Environment(undefined=StrictUndefined).from_string(TEMPLATE.read_text(encoding="utf-8"))
    return template.render(
        pictures=pictures,
        reasoning=reasoning,
        frames=frames,
        seconds=f"{seconds:g}",
        fps=fps,
        max_px=f"{max_px:g}",
        width=width,
        most_objects=MAX_OBJECTS,
        phrases=tuple(EVENT_PHRASES.values()),
    )
