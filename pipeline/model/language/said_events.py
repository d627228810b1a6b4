"""Events read back from the words of `<think>`, as `pipeline.model.language.completion` writes them."""

from __future__ import annotations

import re

from pipeline.clips.events import Event
from pipeline.errors import SceneError
from pipeline.model.language.completion import PHRASE_KINDS

_LINE = re.compile(rf"t=(\d+\.\d+)s: object ([1-9]\d*)({'|'.join(map(re.escape, PHRASE_KINDS))})([1-9]\d*)?\.")


def said_events(think: str) -> list[Event]:
    """The events that `<think>` says, in its order.

    Args:
        think: The words between the tags (`Completion.think`): a line with the objects, then a line for each event.

    Returns:
        Objects are numbered from 0, as the answer lists them. Times, s, have two decimals, as they are written.

    Raises:
        SceneError: A line after the first is no event that an answer can have.
    """
    return [_event(line) for line in think.splitlines()[1:]]


def _event(line: str) -> Event:
    match = _LINE.fullmatch(line)
    kind = None if match is None else PHRASE_KINDS[match[3]]
    if match is None or (kind == "hits_object") != (match[4] is not None):
        phrases = ", ".join(f"`{phrase.strip()}`" for phrase in PHRASE_KINDS)
        raise SceneError(f"think: {line!r} is no event; valid: `t=0.13s: object 1 …`, with one of {phrases}")
    second = None if match[4] is None else int(match[4]) - 1
    return Event(float(match[1]), PHRASE_KINDS[match[3]], int(match[2]) - 1, second)
