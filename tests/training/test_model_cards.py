"""The model cards, the scores and the shipped weights agree."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pipeline.objects.answering import load_objects
from training.objects import card as objects_card
from training.tiny import card as tiny_card

from pipeline.model.base import load_base
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.model_card import CHECKED, LEARNED, SHOWN

Measure = Callable[[Params, int], list[dict[str, float]]]
MEASURES: dict[str, Measure] = {
    "tiny": lambda params, clips: tiny_card.measure(load_base("models/tiny"), params, clips),
    "objects": lambda params, clips: objects_card.measure(load_objects("models/objects").model, params, clips),
}


@pytest.mark.parametrize("model", MEASURES)
def test_the_shipped_weights_score_as_the_card_says(model: str) -> None:
    card = (Path("models") / model / "README.md").read_text(encoding="utf-8")
    rows = MEASURES[model](read_params_file(PARAMS_FILE, Params), CHECKED)
    for key, name in SHOWN.items():
        said = re.search(rf"^\| {re.escape(name)} \| .* \| ([\d.]+) \|$", card, re.MULTILINE)
        assert said is not None, name
        # another processor rounds otherwise, and a close choice may fall the other way in a clip
        assert np.mean([r[key] for r in rows]) == pytest.approx(float(said[1]), rel=0.1, abs=1.5 / CHECKED), key


@pytest.mark.parametrize("model", MEASURES)
def test_the_card_has_the_scores_of_the_benchmark(model: str) -> None:
    card = (Path("models") / model / "README.md").read_text(encoding="utf-8")
    rows = [line.split(",") for line in LEARNED.read_text(encoding="utf-8").splitlines()]
    found = {(r[0], r[1], r[3]): r[4:7] for r in rows if len(r) == 8}
    greedy = [key for key in found if key[1] == model and key[2] in SHOWN]
    assert greedy
    for key in greedy:
        mean, low, high = (f"{float(v):.3g}" for v in found[key])
        assert f"{mean} ({low}–{high})" in card, key
