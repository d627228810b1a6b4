"""Published measurements, where they are there (DYNAMICS_DATA, else ../shared/data)."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.published.ball_drops import read_ball_drops, together
from benchmarks.published.cube_tosses import read_cube_tosses
from benchmarks.published.published_set import real_motion_folder
from benchmarks.published.table_tennis import read_table_tennis
from pipeline.discovery.discover import discover
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.scene.effects.registry import effect_kinds


@pytest.fixture
def folder() -> Path:
    found = real_motion_folder()
    if found is None:
        pytest.skip("no published measurements here: set DYNAMICS_DATA to the folder that has real_motion")
    return found


def test_ball_drops_have_two_drops_of_each_ball(folder: Path) -> None:
    pytest.importorskip("openpyxl", reason="an extra: benchmark")
    sets = read_ball_drops(folder / "ball_drops")
    assert len(sets) == 11
    for real in sets:
        assert len(real.tracks) == 2 and all(42 <= len(t.time) <= 58 for t in real.tracks)
        assert 0.02 < known_scene(real.known).scene.objects[0].mass < 7


def test_gravity_does_not_swallow_the_drag_of_a_basketball(folder: Path) -> None:
    pytest.importorskip("openpyxl", reason="an extra: benchmark")
    verdicts = {}
    for real in read_ball_drops(folder / "ball_drops"):
        if real.name in ("bluebasketball", "greenbasketball", "volleyball", "bowlingball"):
            verdicts[real.name] = discover(
                real.tracks, known_scene(real.known), 0.3, tuple(effect_kinds()), np.random.default_rng(0)
            ).verdict
    assert verdicts["volleyball"].effects == ("linear_drag",) and verdicts["bowlingball"].effects == ()
    for name in ("bluebasketball", "greenbasketball"):
        assert verdicts[name].effects == ("unknown",) and "linear_drag" in verdicts[name].equivalent[0]
    assert all(v.confidence <= 0.5 for v in verdicts.values())


def test_a_cube_that_rests_touches_the_ground(folder: Path) -> None:
    real = read_cube_tosses(folder / "cube_tosses", 5)
    assert all(t.quaternion is not None for t in real.tracks)
    assert abs(real.known["ground"]["height"]) < 0.05


@pytest.mark.slow
def test_table_tennis_balls_have_drag(folder: Path) -> None:
    real = read_table_tennis(folder / "table_tennis", 20)
    found = discover(real.tracks, known_scene(real.known), 0.3, tuple(effect_kinds()), np.random.default_rng(0))
    assert found.verdict.effects[0] == "air_drag" and found.verdict.remainder is not None
    assert found.gap.after < 0.6 * found.gap.before
    drag = found.verdict.named[0].parameters["coefficient"].value
    assert drag == pytest.approx(0.5 * 1.2 * 0.4 * np.pi * 0.02**2, rel=0.3)  # of a smooth ball


@pytest.mark.slow
def test_heavy_balls_show_the_drag_of_the_basketballs(folder: Path) -> None:
    pytest.importorskip("openpyxl", reason="an extra: benchmark")
    heavy_and_light = ("bowlingball", "golfball", "bluebasketball", "greenbasketball")
    real = together([s for s in read_ball_drops(folder / "ball_drops") if s.name in heavy_and_light])
    found = discover(real.tracks, known_scene(real.known), 0.3, tuple(effect_kinds()), np.random.default_rng(0))
    assert {"linear_drag", "air_drag"} & {*found.verdict.effects, *(n for s in found.verdict.equivalent for n in s)}
    assert "unknown" not in found.verdict.effects
