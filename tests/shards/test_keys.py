"""Laws of the plain values that stand for parameters in keys."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from pipeline.shards.content_hash import hash_value
from pipeline.shards.keys import plain
from stages.graph.params import ClipSettings

CLIP = ClipSettings(seconds=1.0, fps=30, model_frames=10)


@dataclass(frozen=True)
class Inner:
    weights: dict[int, float]
    path: Path | None = None


@dataclass(frozen=True)
class Outer:
    seed: int
    clip: ClipSettings
    parts: tuple[Inner, ...]


def test_a_record_of_dataclasses_and_sections_is_plain_json() -> None:
    outer = Outer(1, CLIP, (Inner({2: 0.5}, Path("models") / "words"),))
    assert plain(outer) == {
        "seed": 1,
        "clip": {"seconds": 1.0, "fps": 30, "model_frames": 10},
        "parts": [{"weights": {"2": 0.5}, "path": "models/words"}],
    }
    assert json.loads(json.dumps(plain(outer))) == plain(outer)


def test_the_section_and_the_library_s_record_of_it_are_the_same_in_a_key() -> None:
    assert hash_value(plain(CLIP)) == hash_value(plain(CLIP.schedule))


@pytest.mark.parametrize("value", [{1, 2}, object(), Inner, b"bytes"])
def test_a_value_that_is_not_plain_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match="cannot be a parameter; valid"):
        plain({"value": value})
