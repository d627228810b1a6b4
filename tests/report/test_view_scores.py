"""Scores of clips as people film them: when a view is right, an answer deserves its grade, and what tables say."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.clips.replay import replay
from pipeline.clips.schedule import Schedule
from pipeline.report.view_scores import SeenClip, steepest, true_roll, view_score
from pipeline.report.view_tables import ViewScore, figures, kinds_table
from pipeline.scene.scene import FixedBody, Scene, SceneObject
from pipeline.worlds.plane import Plane

SCORE = ViewScore(
    clip=0,
    kind="incline",
    shapes="sphere",
    found="incline",
    iou=0.9,
    roll_error=1.0,
    slope_error=-2.0,
    by="tracks",
    grade="good",
    beats_constant_velocity=True,
)
THROW = Scene(
    (SceneObject("sphere", (0.08,), 1.0, position=(-0.8, 0, -0.2), velocity=(1.6, 0, 3.0)),),
    Plane(480, 320, 200.0, roll=-np.radians(3)).camera(),
    ground=None,
)


def test_a_throw_is_scored_from_its_tracks() -> None:
    shown = replay(THROW, Schedule())
    seen = SeenClip(shown.masks, shown.pictures("raycast"), shown.flow, Schedule())
    score = view_score(4, "flight", THROW, seen, size=(120, 80), simulations=0)
    assert (score.found, score.by, score.grade) == ("flight", "tracks", "good")
    assert score.iou > 0.9
    assert score.roll_error == pytest.approx(0, abs=0.6)
    assert np.isnan(score.slope_error)


def test_roll_and_slope_of_a_scene() -> None:
    assert true_roll(THROW) == pytest.approx(3, abs=1e-3)
    half = np.radians(20) / 2
    ramp = FixedBody("box", (1, 1, 0.1), (0, 0, 0), (np.cos(half), 0, np.sin(half), 0))
    assert steepest(replace(THROW, fixed=(ramp,))) == pytest.approx(20, abs=1e-3)


def test_figures_of_some_clips() -> None:
    wrong = replace(SCORE, found="table", iou=0.3, roll_error=float("nan"), slope_error=float("nan"))
    side = replace(SCORE, kind="flight", found="side", grade="doubtful", slope_error=float("nan"))
    assert figures([SCORE, wrong, side]) == {
        "clips": 3,
        "view_right": 0.6667,
        "iou": 0.7,
        "roll_error_deg": 1.0,
        "slope_error_deg": 2.0,
        "good": 0.6667,
        "good_rightly": 0.5,
    }
    assert figures([]) == {"clips": 0}
    table = kinds_table([SCORE, wrong, side])
    assert "| all | 3 | 2 | 0.70 | 1.0 | 2.0 |" in table
    assert "Good: 2 of 3, of which 1 " in table
