"""The measured sets that ship are what their command makes, and their hidden effects are discovered."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.sample_measurement import (
    FILTER_LACKS,
    HIDDEN,
    PUCK_LACKS,
    TOSSED_LACKS,
    drops_vernier,
    slides_semicolon,
    thrown_ball,
    tosses_tracker,
)
from pipeline.api.discover import discover
from pipeline.commands.main import main
from pipeline.discovery.tracks.track import read_tracks

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


TABLES = {
    "tosses_tracker.txt": (tosses_tracker, TOSSED_LACKS, {"unit": "px", "length": (160, 655, 572.5, 655, 1.0)}),
    "drops_vernier.csv": (drops_vernier, FILTER_LACKS, {}),
    "slides_semicolon.csv": (slides_semicolon, PUCK_LACKS, {}),
}


@pytest.mark.parametrize("name", TABLES)
def test_what_tables_of_other_programs_lack_is_discovered(name: str) -> None:
    make, hidden, said = TABLES[name]
    assert (FOLDER / name).read_text() == make(np.random.default_rng(2026))
    effects = "air_drag,linear_drag,tilted_gravity"
    found = discover(FOLDER / name, (FOLDER / name).with_suffix(".yaml"), effects=effects, **said)
    assert found.verdict == (hidden.name,)
    for parameter, value in hidden.parameters:
        assert found.found.verdict.parameters[parameter].value == pytest.approx(value, rel=0.05)
    assert found.found.gap.after < 1.2 * found.found.gap.noise_floor
