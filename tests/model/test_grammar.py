"""The grammar: what it writes it splits, what it generates parses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_walk import random_walk
from sampled_scenes import clips, draw, thresholds
from small_tokenizer import build_tokenizer

from pipeline.clips.events import Event, find_events
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import areas_px
from pipeline.model.language.completion import (
    EVENT_PHRASES,
    MATERIAL,
    MAX_OBJECTS,
    VECTORS,
    completion_grammar,
    read_completion,
    think_text,
    write_completion,
)
from pipeline.model.language.grammar import Choice, Grammar, GrammarError, Literal, Number, spell, split
from pipeline.scene.canonical import DECIMALS
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.scene.text import read_scene, write_scene

TOKENIZER = build_tokenizer()


@pytest.mark.parametrize("reasoning", [True, False])
def test_every_random_walk_parses_into_a_scene(rng: np.random.Generator, reasoning: bool) -> None:
    for _ in range(40):
        text, cut = random_walk(rng, completion_grammar(reasoning, 1.0))
        completion = read_completion(text)
        scene = completion.scene
        assert 1 <= len(scene.objects) <= MAX_OBJECTS
        assert read_scene(write_scene(scene)) == scene
        assert "".join(cut) == text
        assert "".join(piece for _, piece in split(completion_grammar(reasoning, 1.0), text)) == text
        assert bool(completion.think) == reasoning
        if reasoning:
            assert completion.think.split(": ", 1)[1].split(".\n")[0].rstrip(".") == ", ".join(scene.shapes)
            times = [float(line[2:6]) for line in completion.think.splitlines() if line.startswith("t=")]
            assert times == sorted(times)
            assert all(0 <= t <= 1 for t in times)


@pytest.mark.parametrize("reasoning", [True, False])
def test_every_piece_of_a_random_walk_is_one_token_of_the_small_tokenizer(
    rng: np.random.Generator, reasoning: bool
) -> None:
    vocabulary = TOKENIZER.get_vocab()
    for _ in range(30):
        _, cut = random_walk(rng, completion_grammar(reasoning, 1.0))
        assert [p for p in cut if p not in vocabulary] == []


@pytest.mark.parametrize("reasoning", [True, False])
def test_random_walks_reach_all_shapes_counts_and_events(rng: np.random.Generator, reasoning: bool) -> None:
    texts = [random_walk(rng, completion_grammar(reasoning, 1.0), end=0.05)[0] for _ in range(80)]
    counts = {len(read_completion(t).scene.objects) for t in texts}
    assert counts >= {1, 2, 3}, "without reasoning every further object takes another throw"
    if reasoning:
        assert counts == set(range(1, MAX_OBJECTS + 1))
        assert all(any(phrase in t for t in texts) for phrase in EVENT_PHRASES.values())


def example(rng: np.random.Generator) -> tuple[Scene, list[Event]]:
    (scene,) = draw(int(rng.integers(2**31)), [0], {2: 1.0, 3: 1.0}).scenes
    times = np.sort(rng.uniform(0, 1, 5).round(2))
    kinds = rng.choice(list(EVENT_PHRASES), 5)
    return scene, [
        Event(float(t), str(k), 0, 1 if k == "hits_object" else None) for t, k in zip(times, kinds, strict=True)
    ]


@pytest.mark.parametrize("reasoning", [True, False])
def test_a_sampled_scene_reads_back_from_its_completion(rng: np.random.Generator, reasoning: bool) -> None:
    for _ in range(5):
        scene, events = example(rng)
        assert read_completion(write_completion(scene, events if reasoning else None, 1.0)).scene == scene


def test_the_words_of_think_tell_the_events(rng: np.random.Generator) -> None:
    scene, events = example(rng)
    header, *lines = think_text(scene, events, 1.0).splitlines()
    assert header == f"{len(scene.objects)} objects: {', '.join(scene.shapes)}."
    for line, event in zip(lines, events, strict=True):
        other = "" if event.second is None else str(event.second + 1)
        assert line == f"t={event.time:.2f}s: object 1{EVENT_PHRASES[event.kind]}{other}."


def test_a_scene_of_six_objects_is_written_and_read(rng: np.random.Generator) -> None:
    (scene,) = draw(int(rng.integers(2**31)), [0], {6: 1.0}).scenes
    for events in (None, []):
        assert read_completion(write_completion(scene, events, 1.0)).scene == scene


def test_clips_of_other_lengths_have_their_own_times() -> None:
    scene = Scene((SceneObject("sphere", (0.1,), 1.0),), Camera((0, -2, 1), 40, pitch=-20))
    text = write_completion(scene, [Event(2.5, "hits_ground", 0)], 3.0)
    assert "t=2.50s" in text
    with pytest.raises(GrammarError):
        split(completion_grammar(True, 1.0), text)


def test_numbers_out_of_bounds_are_moved_in() -> None:
    wild = SceneObject(
        shape="box",
        size=(0.0001, 12, 0.5),
        mass=1e4,
        sliding_friction=77,
        rolling_friction=9,
        damping=1e-4,
        position=(50, -50, 1),
        velocity=(99, -99, 0),
        angular_velocity=(1e4, -1e4, 0),
    )
    scene = Scene((wild,), Camera((0, -2, 44.0), 170, pitch=-90), (0, 0, -99))
    read = read_completion(write_completion(scene, [], 1.0)).scene
    (obj,) = read.objects
    assert obj.size == (0.01, 3.0, 0.5)
    assert (obj.mass, obj.sliding_friction, obj.rolling_friction, obj.damping) == (99, 5, 0.5, 0.01)
    assert obj.position == (9.999, -9.999, 1)
    assert obj.velocity == (20, -20, 0)
    assert obj.angular_velocity == (99, -99, 0)
    assert read.camera == Camera((0, -2, 9.99), 99, pitch=-89)
    assert read.gravity == (0, 0, -50)


@given(st.integers(0, 4), st.floats(-50, 50), st.floats(0, 50), st.floats(-200, 200))
@settings(max_examples=100, deadline=None)
def test_a_numbers_text_is_one_of_its_options_and_near_its_value(d: int, low: float, span: float, value: float) -> None:
    number = Number(min(d, 2), low, low + span)
    bounded = min(max(value, low), low + span)
    text = number.text(value)
    assert float(text) == pytest.approx(bounded, abs=0.5 * 10.0**-number.decimals + 1e-9)
    assert not text.startswith("-0") or float(text) != 0
    # bounds that are no texts themselves round like the values
    assert text in Number(number.decimals, round(low, number.decimals), round(low + span, number.decimals)).options


def test_the_decimals_of_the_grammar_are_those_of_the_digits(rng: np.random.Generator) -> None:
    for key, number in {**MATERIAL, **VECTORS}.items():
        assert number.decimals == DECIMALS[key]
        for value in rng.uniform(number.low, number.high, 20):
            assert len(number.text(value).split(".")[1]) == DECIMALS[key]


def toy() -> Grammar:
    yield Literal("a ")
    colour = yield Choice(("red", "rose", "blue"))
    yield Literal(" ")
    if colour == "blue":
        yield Number(1, -1.0, 1.0)
    yield Literal(".")


def test_what_is_spelled_is_split_into_the_same_values() -> None:
    text = spell(toy(), ["blue", -0.04])
    assert text == "a blue 0.0."
    assert [piece for _, piece in split(toy(), text)] == ["a ", "blue", " ", "0.0", "."]
    assert spell(toy(), ["rose"]) == "a rose ."


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("the red .", r"at character 0: 'the red \.', expected 'a '"),
        ("a green .", r"at character 2: .* expected one of \('red', 'rose', 'blue'\)"),
        ("a blue 1.5.", r"at character 7: '1\.5\.', expected Number"),
        ("a blue 0.55.", "at character 10"),
        ("a red . And more", "text goes on after its end: ' And more'"),
        ("a red", "at character 5: '', expected ' '"),
    ],
)
def test_a_foreign_text_is_a_grammar_error_that_says_where(text: str, told: str) -> None:
    with pytest.raises(GrammarError, match=told):
        split(toy(), text)


@pytest.mark.parametrize(
    "spoil", [lambda t: t[:-3], lambda t: t.replace("mass", "weight"), lambda t: t + "!", lambda t: ""]
)
def test_a_spoilt_completion_is_a_grammar_error(rng: np.random.Generator, spoil: object) -> None:
    text, _ = random_walk(rng, completion_grammar(True, 1.0))
    with pytest.raises(GrammarError):
        split(completion_grammar(True, 1.0), spoil(text))  # type: ignore[operator]


def test_events_of_sampled_clips_are_all_told(rng: np.random.Generator) -> None:
    for clip in clips(int(rng.integers(2**31)), 6):
        areas = areas_px(clip.masks, len(clip.scene.objects))
        events = find_events(
            clip.trace, clip.scene.shapes, areas, Schedule().frame_steps, replace(thresholds(), most=4)
        )
        text = write_completion(clip.scene, events, 1.0)
        assert text.count("t=") == len(events) <= 4
        assert read_completion(text).scene == clip.scene
