"""The measured set that ships is what its command makes, and its hidden effect is discovered."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.sample_measurement import HIDDEN, thrown_ball
from pipeline.commands.main import main
from pipeline.discrepancy.tracks.track import read_tracks

FOLDER = Path(__file__).resolve().parents[2] / "data" / "measured"


def test_the_drag_of_the_thrown_ball_is_discovered(tmp_path: Path) -> None:
    out = tmp_path / "found"
    files = [str(FOLDER / name) for name in ("thrown_ball.csv", "thrown_ball.yaml")]
    assert main(["discover", *files, "-o", str(out)]) == 0
    verdict = json.loads((out / "report.json").read_text())["verdict"]
    assert verdict["effects"] == [HIDDEN.name] and verdict["confidence"] > 0.8
    assert verdict["parameters"]["coefficient"]["value"] == pytest.approx(HIDDEN.values["coefficient"], rel=0.02)


def test_the_file_is_what_the_command_makes() -> None:
    made = thrown_ball(np.random.default_rng(2026))
    kept = read_tracks(FOLDER / "thrown_ball.csv")
    assert [t.clip for t in kept] == [t.clip for t in made]
    for ours, file in zip(made, kept, strict=True):
        np.testing.assert_allclose(file.position, ours.position, atol=1e-4)
        assert ours.position[:, 2].min() > 0.3
