"""Events that are written to `<think>` are read back from it."""

import numpy as np
import pytest
from random_walk import random_walk
from sampled_scenes import SCHEDULE, clips, thresholds

from pipeline.clips.events import Event, find_events
from pipeline.clips.matched_events import ANSWERED_KINDS
from pipeline.clips.view import areas_px
from pipeline.errors import SceneError
from pipeline.model.language.completion import (
    EVENT_PHRASES,
    completion_grammar,
    read_completion,
    think_text,
    write_completion,
)
from pipeline.model.language.said_events import said_events
from pipeline.scene.scene import Camera, Scene, SceneObject

BALL = SceneObject("sphere", (0.1,), 1.0, position=(0, 0, 0.1))
PAIR = Scene((BALL, BALL), Camera((0, -2, 1), 40, -20.0))
EVERY_KIND = [
    Event(round(0.1 * k, 2), kind, k % 2, 1 - k % 2 if kind == "hits_object" else None)
    for k, kind in enumerate(EVENT_PHRASES)
]


def test_what_can_be_said_can_be_compared() -> None:
    assert set(EVENT_PHRASES) == set(ANSWERED_KINDS)


@pytest.mark.parametrize("events", [[], EVERY_KIND, EVERY_KIND * 3], ids=["none", "every kind", "to the limit"])
def test_events_that_a_completion_says_are_read_back(events: list[Event]) -> None:
    events = sorted(events, key=lambda e: e.time)
    assert said_events(read_completion(write_completion(PAIR, events, 1.0)).think) == events
    assert said_events(think_text(PAIR, events, 1.0)) == events


def test_events_of_sampled_clips_are_read_back_to_a_hundredth_of_a_second(rng: np.random.Generator) -> None:
    for clip in clips(int(rng.integers(2**31)), 4):
        areas = areas_px(clip.masks, len(clip.scene.objects))
        true = find_events(clip.trace, clip.scene.shapes, areas, SCHEDULE.frame_steps, thresholds())
        said = said_events(read_completion(write_completion(clip.scene, true, SCHEDULE.seconds)).think)
        assert [(e.kind, e.first, e.second) for e in said] == [(e.kind, e.first, e.second) for e in true]
        assert [e.time for e in said] == pytest.approx([e.time for e in true], abs=0.005 + 1e-9)


def test_every_text_of_the_grammar_is_read(rng: np.random.Generator) -> None:
    for _ in range(30):
        text, _ = random_walk(rng, completion_grammar(True, 1.0))
        found = read_completion(text)
        said = said_events(found.think)
        assert think_text(found.scene, said, 1.0) == found.think
        assert all(0 <= i < len(found.scene.objects) for e in said for i in e.objects)


@pytest.mark.parametrize(
    "line",
    [
        "t=0.50s: object 1 hits object .",
        "t=0.50s: object 1 hits the ground2.",
        "t=0.50s: object 0 hits the ground.",
        "t=0.50s: object 1 explodes.",
        "t=-0.50s: object 1 enters the view.",
        "object 1 enters the view.",
        "",
    ],
)
def test_a_line_that_is_no_event_is_named(line: str) -> None:
    with pytest.raises(SceneError, match=r"is no event; valid: .*hits the ground"):
        said_events(f"1 object: sphere.\n{line}\nt=0.60s: object 1 leaves the view.")
