"""What is left to decide in an answer, one decision after another, and where each stands.

Text that the grammar forces (keys, brackets, units) is never computed. A decision is a token: a shape, an event's kind
or body, whether another event follows; or a number, which is one token too, embedded by its value and answered in BINS.
`decisions` is the grammar as a generator; `answer_of` writes the tokens of a true answer with it, and the model's own
answers are decoded with it.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.clips.events import ANSWERED_KINDS
from pipeline.model.fields import FREE, NOTHING, OBJECT_FIELDS, SCENE_FIELDS, Field

KINDS = ANSWERED_KINDS
MOST_EVENTS = 12
PLACES = 8  # of bodies, in prompt and answer

# Tokens. The first are what the prompt says of itself.
PAD, FLOW, RGB, BODIES, FRAME, REASON, DIRECT, AT, ENOUGH, UNSEEN, VIDEO, END = range(12)
PLACE0 = END + 1
SHAPE0 = PLACE0 + PLACES
KIND0 = SHAPE0 + NOTHING + 1
FIELD0 = KIND0 + len(KINDS)
TIME = Field("time", 0.0, 1.0)  # share of the clip
FIELDS: tuple[Field, ...] = (TIME, *SCENE_FIELDS, *OBJECT_FIELDS)
TOKENS = FIELD0 + len(FIELDS)

# What is to be decided next (0: nothing); numbers: ASK_FIELD + index in FIELDS.
ASK_SHAPE, ASK_EVENT, ASK_WHO, ASK_KIND, ASK_WHOM, ASK_FIELD = range(1, 7)
ASKS = ASK_FIELD + len(FIELDS)

# Rotary positions. Each part of prompt and answer has its own, whatever the number of bodies, so that none is new
# where there are more bodies than in training.
TOKENS_OF_BODY = 16
ANSWER_AT = 2 + TOKENS_OF_BODY * PLACES
SHAPES_AT = ANSWER_AT + 1
EVENTS_AT = SHAPES_AT + PLACES
SCENE_AT = EVENTS_AT + 5 * MOST_EVENTS + 1
BODIES_AT = SCENE_AT + len(SCENE_FIELDS)
NUMBERS_OF_BODY = 1 + len(OBJECT_FIELDS)

LOW = np.array([f.low for f in FIELDS], np.float32)
HIGH = np.array([f.high for f in FIELDS], np.float32)
ZERO = np.array([f.zero for f in FIELDS])
WEIGHT = np.array([0.7, *(f.weight for f in FIELDS[1:])], np.float32)


@dataclass(frozen=True)
class Decision:
    """What is to be decided.

    Attributes:
        ask: One of ASK_*, or ASK_FIELD + index in FIELDS.
        position: Rotary position of the token that decides it.
        of: Token of the body's place that it is about, 0: none.
        allowed: Tokens to choose from; empty: a number.
    """

    ask: int
    position: int
    of: int = 0
    allowed: tuple[int, ...] = ()

    @property
    def field(self) -> int:
        """Index in FIELDS, -1 for a choice."""
        return self.ask - ASK_FIELD if not self.allowed else -1


@dataclass
class Said:
    """An answer.

    Attributes:
        shapes: Of each place asked, indices of basic shapes or NOTHING.
        events: (time as a share of the clip, kind, first, second or None), kinds as in KINDS, bodies by their index.
        scene: `SCENE_FIELDS`, on their scales.
        values: For each place `OBJECT_FIELDS`, on their scales.
    """

    shapes: list[int] = field(default_factory=list)
    events: list[tuple[float, int, int, int | None]] = field(default_factory=list)
    scene: list[float] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)


Taken = tuple[int, float]  # a token, and the number on its scale


def decisions(places: Sequence[int], reason: bool, frame: bool) -> Generator[Decision, Taken, Said]:
    """The grammar: yields what comes next and is sent what was taken.

    Args:
        places: Of the bodies, 0 to PLACES - 1, in the order of the prompt; of a frame all that may be named.
        reason: Whether `<think>` comes first.
        frame: Whether the first body that is NOTHING ends the list.
    """
    said = Said()
    shapes = tuple(range(SHAPE0, SHAPE0 + NOTHING + 1))
    tokens = [PLACE0 + p for p in places]

    def shape(i: int, position: int) -> Generator[Decision, Taken, bool]:
        last = i == (0 if frame else len(places) - 1)
        needed = last and all(s == NOTHING for s in said.shapes)  # an answer has a body
        token, _ = yield Decision(ASK_SHAPE, position, tokens[i], shapes[:NOTHING] if needed else shapes)
        said.shapes.append(token - SHAPE0)
        said.values.append([0.0] * len(OBJECT_FIELDS))
        return not (frame and token - SHAPE0 == NOTHING)

    if reason:
        for i, place in enumerate(places):
            if not (yield from shape(i, SHAPES_AT + place)):
                break
        real = [i for i, s in enumerate(said.shapes) if s != NOTHING]
        if real:
            yield from _events(said, tokens, real)
    for k in range(len(SCENE_FIELDS)):
        _, value = yield Decision(ASK_FIELD + 1 + k, SCENE_AT + k)
        said.scene.append(value)
    for i, place in enumerate(places):
        at = BODIES_AT + NUMBERS_OF_BODY * place
        if reason and i == len(said.shapes):
            break
        if not reason and not (yield from shape(i, at)):
            break
        if said.shapes[i] == NOTHING:
            continue
        for k in range(len(OBJECT_FIELDS)):
            if FREE[said.shapes[i], k]:
                _, value = yield Decision(ASK_FIELD + 1 + len(SCENE_FIELDS) + k, at + 1 + k, tokens[i])
                said.values[i][k] = value
    return said


def _events(said: Said, tokens: list[int], real: list[int]) -> Generator[Decision, Taken, None]:
    """Events of the bodies that are `real`."""
    at = EVENTS_AT
    kinds = tuple(range(KIND0 + (len(real) < 2), KIND0 + len(KINDS)))
    index = {tokens[i]: i for i in real}
    for _ in range(MOST_EVENTS):
        token, _ = yield Decision(ASK_EVENT, at, 0, (AT, ENOUGH))
        if token == ENOUGH:
            return
        _, time = yield Decision(ASK_FIELD, at + 1)
        who, _ = yield Decision(ASK_WHO, at + 2, 0, tuple(index))
        kind, _ = yield Decision(ASK_KIND, at + 3, 0, kinds)
        whom = None
        if kind == KIND0:
            whom, _ = yield Decision(ASK_WHOM, at + 4, 0, tuple(t for t in index if t != who))
        said.events.append((time, kind - KIND0, index[who], None if whom is None else index[whom]))
        at += 5


@dataclass(frozen=True)
class Answer:
    """An answer as arrays (L,), one entry a decision.

    Attributes:
        token: What was decided before (the first: REASON or DIRECT).
        share: Where that number lies in its range, -1 to 1; 0 for a choice.
        ask: What is to be decided.
        of: Token of the body that it is about, 0: none.
        position: Rotary position.
        choice: The token that is right; -1 for a number.
        field: Index in FIELDS of the number that is right; -1 for a choice.
        number: Where the right number lies in its range, -1 to 1.
    """

    token: np.ndarray
    share: np.ndarray
    ask: np.ndarray
    of: np.ndarray
    position: np.ndarray
    choice: np.ndarray
    field: np.ndarray
    number: np.ndarray


ANSWER_TYPES = {
    "token": np.int16,
    "share": np.float32,
    "ask": np.int16,
    "of": np.int16,
    "position": np.int16,
    "choice": np.int16,
    "field": np.int16,
    "number": np.float32,
}


#: What stands behind the end of an answer in a longer array, where it is not 0.
FILL = {"choice": -1, "field": -1}


def share_of(value: float, index: int) -> float:
    """Where a number lies in the range of its field, -1 to 1, a little beyond where it lies outside."""
    low, high = FIELDS[index].low, FIELDS[index].high
    return min(max(2 * (value - low) / (high - low) - 1, -1.2), 1.2)


def answer_of(places: Sequence[int], reason: bool, frame: bool, said: Said) -> Answer:
    """The decisions of a true answer. `said.shapes` has an entry for each place, in a frame one for each body."""
    steps = decisions(places, reason, frame)
    of_place = {PLACE0 + p: i for i, p in enumerate(places)}
    pending = [
        taken
        for time, kind, who, whom in said.events[:MOST_EVENTS]
        for taken in (AT, time, PLACE0 + places[who], KIND0 + kind, None if whom is None else PLACE0 + places[whom])
        if taken is not None
    ]
    told: Iterator[Any] = iter([*pending, *([ENOUGH] if len(said.events) < MOST_EVENTS else [])])
    rows: list[tuple] = []
    before: tuple[int, float] = (REASON if reason else DIRECT, 0.0)
    step = next(steps)
    scene_fields = 1 + len(SCENE_FIELDS)
    while True:
        value = 0.0
        if step.ask == ASK_SHAPE:
            i = of_place[step.of]
            token = SHAPE0 + (said.shapes[i] if i < len(said.shapes) else NOTHING)
        elif step.ask == ASK_FIELD:
            token, value = FIELD0, next(told)
        elif step.ask < ASK_FIELD:
            token = next(told)
        else:
            token = FIELD0 + step.field
            k = step.field
            value = said.scene[k - 1] if k < scene_fields else said.values[of_place[step.of]][k - scene_fields]
        share = 0.0 if step.allowed else share_of(value, step.field)
        rows.append((*before, step.ask, step.of, step.position, token if step.allowed else -1, step.field, share))
        before = (token, share)
        try:
            step = steps.send((token, value))
        except StopIteration:
            break
    columns = zip(*rows, strict=True)
    return Answer(*(np.array(c, kind) for c, kind in zip(columns, ANSWER_TYPES.values(), strict=True)))
