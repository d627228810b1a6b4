"""Preference optimisation of a words model that has learned nothing."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch
from test_words_answers import DRAWN, seen_frames, seen_of
from tiny_words import tiny_words

from pipeline.model.answering import Shown
from pipeline.model.preference import Pair, draw_answers, prefer
from pipeline.model.training_plan import TrainingPlan
from pipeline.model.words_example import answers_example, chosen, tensors
from pipeline.model.words_loss import log_probabilities
from pipeline.model.words_model import WordsModel, write_answers

SHOWN: dict[str, Shown] = {
    "bodies": seen_of(2, rgb=False),
    "colours": seen_of(3, rgb=True),
    "frames": seen_frames(rgb=False),
}


@pytest.mark.parametrize("kind", SHOWN)
def test_an_answer_has_the_probability_with_which_it_was_drawn(kind: str) -> None:
    model, seen = WordsModel(tiny_words().eval()), SHOWN[kind]
    assert not isinstance(seen, np.ndarray)
    answers = write_answers(model, seen, DRAWN, 1)
    said = [a.said for a in answers if a.said is not None]
    both = tensors([answers_example(seen, said, DRAWN.reasoning)])
    which = torch.arange(len(said))
    with torch.no_grad():
        found = log_probabilities(model.model, chosen(both, torch.zeros_like(which), which), kind == "colours")
    # among all tokens instead of those that the grammar allows: at most less
    assert len(said) == DRAWN.samples
    for log_p, answer in zip(found.tolist(), answers, strict=True):
        assert log_p < answer.log_probability + 0.01


def test_a_few_steps_raise_the_margin_and_pairs_survive_their_file(tmp_path: Path) -> None:
    model = WordsModel(tiny_words().eval())
    shown = dict(enumerate(SHOWN.values()))
    answers = draw_answers(model, shown, DRAWN, {0: 1, 1: 2, 2: 3}, 64)
    pairs = [Pair(clip, each[0], each[1], 1.0) for clip, each in answers.items()]
    pairs = [Pair.read(row) for row in json.loads(json.dumps([asdict(p) for p in pairs]))]
    assert [p.better.text for p in pairs] == [each[0].text for each in answers.values()]
    rows: list[dict] = []
    plan = TrainingPlan(steps=8, epochs=1.0, batch_size=3, learning_rate=2e-3, lora_rank=0, checkpoint_steps=8, seed=3)
    prefer(model, pairs, shown, 0.1, DRAWN, plan, tmp_path, rows.append)
    curve = [row for row in rows if "margin" in row]
    assert curve[0]["loss"] == pytest.approx(np.log(2), abs=1e-3)
    assert curve[-1]["margin"] > curve[0]["margin"] + 0.1
    assert curve[-1]["accuracy"] == 1
