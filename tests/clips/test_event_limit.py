"""The grammar ends `<think>` after a fixed number of events, whatever a model would go on to say."""

import pytest

from pipeline.clips.events import Event
from pipeline.model.language.completion import MAX_EVENTS, completion_grammar, write_completion
from pipeline.model.language.grammar import GrammarError, split
from pipeline.scene.scene import Camera, Scene, SceneObject
from stages.graph.params import EventsSettings

SCENE = Scene((SceneObject("sphere", (0.1,), 1.0, position=(0, 0, 0.1)),), Camera((0, -2, 1), 40, -20.0))


@pytest.mark.parametrize("count", [0, 1, MAX_EVENTS - 1, MAX_EVENTS])
def test_up_to_the_limit_a_text_is_what_the_grammar_writes(count: int) -> None:
    text = write_completion(SCENE, [Event(0.5, "hits_ground", 0)] * count, 1.0)
    assert "".join(piece for _, piece in split(completion_grammar(True, 1.0), text)) == text
    assert text.count("hits the ground") == count


def test_one_more_is_no_text_of_the_grammar() -> None:
    text = write_completion(SCENE, [Event(0.5, "hits_ground", 0)] * MAX_EVENTS, 1.0)
    event = "\nt=0.50s: object 1 hits the ground."
    with pytest.raises(GrammarError):
        list(split(completion_grammar(True, 1.0), text.replace(event, 2 * event, 1)))


def test_params_allow_no_more_events_than_the_grammar() -> None:
    bounds = [m.le for m in EventsSettings.model_fields["most"].metadata if hasattr(m, "le")]
    assert bounds == [MAX_EVENTS]
