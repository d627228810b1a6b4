"""The grammar of an answer: what is decided, from which tokens, and where each decision stands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.model import decisions as d
from pipeline.model.fields import FREE, NOTHING, OBJECT_FIELDS, SCENE_FIELDS
from pipeline.model.language.completion import MAX_OBJECTS

SCENE_AND_TIME = 1 + len(SCENE_FIELDS)


@st.composite
def questions(draw: st.DrawFn) -> tuple[list[int], bool, bool, d.Said]:
    """Places, whether there is `<think>`, whether a frame is shown, and a true answer."""
    frame, reason = draw(st.booleans()), draw(st.booleans())
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if frame:
        places = list(range(MAX_OBJECTS))
        shapes = rng.integers(NOTHING, size=draw(st.integers(1, MAX_OBJECTS))).tolist()
    else:
        places = sorted(draw(st.sets(st.integers(0, d.PLACES - 1), min_size=1)))
        shapes = rng.integers(NOTHING + 1, size=len(places)).tolist()
        if all(s == NOTHING for s in shapes):
            shapes[rng.integers(len(shapes))] = int(rng.integers(NOTHING))
    return places, reason, frame, said(rng, shapes, draw(st.integers(0, d.MOST_EVENTS)))


def said(rng: np.random.Generator, shapes: list[int], events: int) -> d.Said:
    """An answer with numbers in their ranges and events of the bodies that are none of them NOTHING."""
    real = [i for i, s in enumerate(shapes) if s != NOTHING]
    told: list[tuple[float, int, int, int | None]] = []
    for time in np.sort(rng.random(events)):
        kind = int(rng.integers(0 if len(real) > 1 else 1, len(d.KINDS)))
        bodies = [int(b) for b in rng.permutation(real)[:2]]
        told.append((float(time), kind, bodies[0], bodies[1] if kind == 0 else None))
    scene = [float(rng.uniform(f.low, f.high)) for f in SCENE_FIELDS]
    values = [[float(rng.uniform(f.low, f.high)) for f in OBJECT_FIELDS] for _ in shapes]
    return d.Said(shapes, told, scene, values)


def sent(places: list[int], reason: bool, frame: bool, answer: d.Answer) -> tuple[d.Said, list[d.Decision]]:
    """What `decisions` returns where it is sent the decisions of an answer, and what it asked."""
    grammar = d.decisions(places, reason, frame)
    asked = [next(grammar)]
    for choice, field, number in zip(answer.choice, answer.field, answer.number, strict=True):
        token = int(choice) if choice >= 0 else d.FIELD0 + int(field)
        value = 0.0 if choice >= 0 else float(d.LOW[field] + (number + 1) / 2 * (d.HIGH[field] - d.LOW[field]))
        try:
            asked.append(grammar.send((token, value)))
        except StopIteration as end:
            assert len(asked) == len(answer.ask)
            return end.value, asked
    raise AssertionError("the grammar asks for more than the answer has")


LAWS = settings(max_examples=150, deadline=None)


@LAWS
@given(questions())
def test_an_answer_sent_through_the_grammar_is_read_back(question: tuple[list[int], bool, bool, d.Said]) -> None:
    places, reason, frame, true = question
    back, _ = sent(places, reason, frame, d.answer_of(places, reason, frame, true))
    ended = frame and len(true.shapes) < len(places)
    assert back.shapes == true.shapes + [NOTHING] * ended
    assert [e[1:] for e in back.events] == ([e[1:] for e in true.events] if reason else [])
    for got, wanted in zip(back.events, true.events, strict=False):
        assert got[0] == pytest.approx(wanted[0], abs=1e-6)
    assert back.scene == pytest.approx(true.scene, abs=1e-5)
    for i, shape in enumerate(true.shapes):
        free = FREE[shape] if shape != NOTHING else np.zeros(len(OBJECT_FIELDS), bool)
        assert back.values[i] == pytest.approx(np.where(free, true.values[i], 0.0).tolist(), abs=1e-5)


@LAWS
@given(questions())
def test_every_true_choice_is_among_the_allowed_tokens(question: tuple[list[int], bool, bool, d.Said]) -> None:
    places, reason, frame, true = question
    answer = d.answer_of(places, reason, frame, true)
    _, asked = sent(places, reason, frame, answer)
    for k, decision in enumerate(asked):
        assert (answer.ask[k], answer.of[k], answer.position[k]) == (decision.ask, decision.of, decision.position)
        assert answer.field[k] == decision.field
        assert (answer.choice[k] in decision.allowed) if decision.allowed else (answer.choice[k] == -1)


@LAWS
@given(questions())
def test_the_token_before_each_decision_is_the_decision_before_it(
    question: tuple[list[int], bool, bool, d.Said],
) -> None:
    places, reason, frame, true = question
    answer = d.answer_of(places, reason, frame, true)
    assert answer.token[0] == (d.REASON if reason else d.DIRECT)
    assert answer.share[0] == 0.0
    taken = np.where(answer.choice >= 0, answer.choice, d.FIELD0 + answer.field)
    assert np.array_equal(answer.token[1:], taken[:-1])
    assert np.array_equal(answer.share[1:], np.where(answer.choice < 0, answer.number, 0)[:-1])


def part_of(position: int) -> str:
    """The part of an answer in which a rotary position lies."""
    starts = {"shapes": d.SHAPES_AT, "events": d.EVENTS_AT, "scene": d.SCENE_AT, "bodies": d.BODIES_AT}
    return max((at, name) for name, at in starts.items() if at <= position)[1]


def expected_part(decision: d.Decision, reason: bool) -> str:
    if decision.ask == d.ASK_SHAPE:
        return "shapes" if reason else "bodies"
    if decision.ask <= d.ASK_FIELD:
        return "events"
    return "scene" if decision.field < SCENE_AND_TIME else "bodies"


@LAWS
@given(questions())
def test_rotary_positions_of_the_parts_never_collide_and_increase_within_the_answer(
    question: tuple[list[int], bool, bool, d.Said],
) -> None:
    places, reason, frame, true = question
    answer = d.answer_of(places, reason, frame, true)
    _, asked = sent(places, reason, frame, answer)
    assert (np.diff(answer.position) > 0).all()  # so that no two parts share a position either
    assert answer.position[0] >= d.ANSWER_AT
    assert [part_of(a.position) for a in asked] == [expected_part(a, reason) for a in asked]


def test_a_body_has_the_same_positions_whatever_other_places_are_taken() -> None:
    rng = np.random.default_rng(0)

    def positions(places: list[int], reason: bool) -> set[tuple[int, int]]:
        shapes = [0] * (len(places) - 1) + [NOTHING - 1]
        answer = d.answer_of(places, reason, False, said(rng, shapes, 0))
        own = answer.of == d.PLACE0 + places[-1]
        return set(zip(answer.ask[own].tolist(), answer.position[own].tolist(), strict=True))

    for reason in (True, False):
        assert positions([5], reason) == positions([0, 5], reason) == positions([1, 2, 4, 5], reason)


@given(st.integers(0, len(d.FIELDS) - 1), st.floats(-1e6, 1e6))
def test_numbers_outside_of_their_range_stay_within_a_tenth_of_it(index: int, value: float) -> None:
    share = d.share_of(value, index)
    field = d.FIELDS[index]
    assert -1.2 <= share <= 1.2
    assert (-1 <= share <= 1) == (field.low <= value <= field.high) or abs(abs(share) - 1) < 1e-9


def test_the_ends_of_a_range_are_shares_of_minus_one_and_one() -> None:
    for k, field in enumerate(d.FIELDS):
        assert d.share_of(field.low, k) == pytest.approx(-1)
        assert d.share_of(field.high, k) == pytest.approx(1)


@pytest.mark.parametrize("frame", [False, True])
@pytest.mark.parametrize("reason", [False, True])
def test_an_answer_that_is_nothing_as_long_as_it_may_has_one_body(reason: bool, frame: bool) -> None:
    grammar = d.decisions(range(3), reason, frame)
    decision = next(grammar)
    while True:
        token, value = (decision.allowed[-1], 0.0) if decision.allowed else (d.FIELD0 + decision.field, 0.5)
        try:
            decision = grammar.send((token, value))
        except StopIteration as end:
            answer = end.value
            break
    real = [s for s in answer.shapes if s != NOTHING]
    assert len(real) == 1
    assert answer.shapes[0 if frame else -1] == real[0]


def test_one_body_hits_no_other_and_no_body_hits_itself() -> None:
    def kinds_and_whoms(shapes: list[int]) -> tuple[set[int], bool]:
        answer = said(np.random.default_rng(1), shapes, d.MOST_EVENTS)
        places = list(range(len(shapes)))
        _, asked = sent(places, True, False, d.answer_of(places, True, False, answer))
        kinds = {t - d.KIND0 for a in asked if a.ask == d.ASK_KIND for t in a.allowed}
        itself = [
            d.PLACE0 + who in a.allowed
            for a, who in zip(
                [a for a in asked if a.ask == d.ASK_WHOM], [e[2] for e in answer.events if e[1] == 0], strict=True
            )
        ]
        return kinds, any(itself)

    assert kinds_and_whoms([0, NOTHING]) == (set(range(1, len(d.KINDS))), False)
    assert kinds_and_whoms([0, NOTHING, 1, 2]) == (set(range(len(d.KINDS))), False)


def test_more_events_than_an_answer_holds_are_left_out_from_the_end() -> None:
    rng = np.random.default_rng(2)
    true = said(rng, [0, 1], 2 * d.MOST_EVENTS)
    back, _ = sent([0, 1], True, False, d.answer_of([0, 1], True, False, true))
    assert [e[1:] for e in back.events] == [e[1:] for e in true.events[: d.MOST_EVENTS]]
