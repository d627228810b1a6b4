"""Filmed worlds are kept with their masks, and read as they were written."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import seen_worlds
from benchmarks.seen_worlds import SeenWorld, kept_world
from benchmarks.video_discovery import plan
from pipeline.discovery.filmed.recorded_clip import RecordedClip


def drawn_world(name: str, strength: float, clips: int, rng: np.random.Generator) -> SeenWorld:
    shown = [
        RecordedClip(
            f"clip_{k}",
            rng.integers(0, 255, (3, 4, 6, 3)).astype(np.uint8),
            rng.integers(0, 2, (3, 4, 6)).astype(np.uint8),
            np.arange(3) / 30,
        )
        for k in range(clips)
    ]
    return SeenWorld(
        tuple(shown), {"objects": [{"name": name}]}, {"strength": strength}, rng.normal(size=(clips, 3, 3))
    )


def test_a_world_is_made_once_and_read_as_it_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seen_worlds, "see_world", drawn_world)
    first = kept_world(tmp_path / "films" / "7-0.npz", "drag", 30.0, 2, [7, 0])
    monkeypatch.delattr(seen_worlds, "see_world")
    again = kept_world(tmp_path / "films" / "7-0.npz", "drag", 30.0, 2, [7, 0])
    drawn = drawn_world("drag", 30.0, 2, np.random.default_rng([7, 0]))
    for world in (first, again):
        assert (world.known, world.truth) == (drawn.known, drawn.truth)
        assert np.array_equal(world.position, drawn.position)
        for clip, own in zip(world.clips, drawn.clips, strict=True):
            assert clip.name == own.name
            for array in ("frames", "masks", "times"):
                assert np.array_equal(getattr(clip, array), getattr(own, array))


def test_a_round_of_worlds_has_every_effect_at_each_strength_and_two_with_nothing(tmp_path: Path) -> None:
    jobs = list(plan(24, 5, tmp_path))
    first, second = ([(j.group, j.hidden, j.strength) for j in part] for part in (jobs[:12], jobs[12:]))
    assert first == second
    assert len(set(first)) == 11
    assert sum(j.hidden == "none" for j in jobs) == 4
    assert len({j.film for j in jobs}) == len({tuple(j.seed) for j in jobs}) == 24
