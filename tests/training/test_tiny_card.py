"""The model card, the scores and the shipped weights agree."""

import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.model.base import load_base
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.tiny.card import CHECKED, LEARNED, SHOWN, measure

CARD = Path("models/tiny/README.md").read_text(encoding="utf-8")


def test_the_shipped_weights_score_as_the_card_says() -> None:
    rows = measure(load_base("models/tiny"), read_params_file(PARAMS_FILE, Params), CHECKED)
    for key, name in SHOWN.items():
        said = re.search(rf"^\| {re.escape(name)} \| .* \| ([\d.]+) \|$", CARD, re.MULTILINE)
        assert said is not None, name
        # another processor rounds otherwise, and a close choice of a token may fall the other way in a clip
        assert np.mean([r[key] for r in rows]) == pytest.approx(float(said[1]), rel=0.1, abs=1.5 / CHECKED), key


def test_the_card_has_the_scores_of_the_benchmark() -> None:
    rows = [line.split(",") for line in LEARNED.read_text(encoding="utf-8").splitlines()]
    found = {(r[0], r[1], r[3]): r[4:7] for r in rows if len(r) == 8}
    greedy = [key for key in found if key[1] == "tiny" and key[2] in SHOWN]
    assert greedy
    for key in greedy:
        mean, low, high = (f"{float(v):.3g}" for v in found[key])
        assert f"{mean} ({low}–{high})" in CARD, key
