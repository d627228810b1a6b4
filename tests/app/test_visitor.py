"""What a visitor has, without a server: clicks, what a job is told, and how a job may end."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_clip

from pipeline.app.body_masks import BodyMasks
from pipeline.app.job import FAILED, INTERNAL, Job
from pipeline.app.live_replay import LiveScene
from pipeline.app.visitor import SEARCHES, Bodies, Result, Visitor
from pipeline.errors import ParamsError


class Kept:
    """A queue that keeps jobs and runs none."""

    def __init__(self) -> None:
        self.jobs: list[Job] = []

    def add(self, job: Job) -> None:
        self.jobs.append(job)

    def before(self, job: Job) -> int:
        return self.jobs.index(job)


@pytest.fixture
def visitor(tmp_path: Path) -> Visitor:
    """One who has a clip of 480x320 px, whose masks have half of that."""
    made = Visitor(tmp_path, Kept())  # type: ignore[arg-type]
    folder = tmp_path / "bodies"
    folder.mkdir()
    found: dict[str, Any] = {"film": {}, "source": [480, 320], "start": 0.5, "seconds": 1.0, "notes": [], "times": []}
    made.clip = Path("clip.mp4")
    made.bodies = Bodies(folder, found, BodyMasks(small_clip.masks()), 0.5 + np.arange(30) / 30)
    return made


def place(visitor: Visitor, body: int, frame: int = 0) -> tuple[float, float]:
    assert visitor.bodies is not None
    rows, cols = np.nonzero(visitor.bodies.masks.masks[frame] == body)
    return float(np.median(cols)), float(np.median(rows))


def test_clicks_change_bodies_and_undo_takes_them_back(visitor: Visitor) -> None:
    assert visitor.bodies is not None
    before, version = visitor.bodies.masks.masks, visitor.version
    visitor.change_bodies("join", 0, [place(visitor, 1), place(visitor, 2)])
    assert visitor.bodies.masks.count == 1
    visitor.change_bodies("undo", 0, [])
    np.testing.assert_array_equal(visitor.bodies.masks.masks, before)
    visitor.change_bodies("drop", 0, [place(visitor, 1)])
    assert visitor.bodies.masks.count == 1
    assert visitor.state()["bodies"]["count"] == 1
    assert visitor.version == version + 3


@pytest.mark.parametrize(
    ("action", "frame", "points", "message"),
    [
        ("paint", 0, [], "valid: add, box, drop"),
        ("drop", 99, [(1, 1)], "takes 1 places in a frame"),
        ("join", 0, [(1, 1)], "takes 2 places"),
        ("drop", 0, [(1, 1)], "no body at that place"),
    ],
)
def test_clicks_that_mean_nothing_change_nothing(
    visitor: Visitor, action: str, frame: int, points: list[tuple[float, float]], message: str
) -> None:
    with pytest.raises(ParamsError, match=message):
        visitor.change_bodies(action, frame, points)
    assert visitor.version == 0


def test_a_body_that_is_added_leaves_the_others_as_they_are(visitor: Visitor) -> None:
    assert visitor.bodies is not None
    both = visitor.bodies.masks.masks.copy()
    visitor.bodies.masks = BodyMasks(np.where(both == 1, 1, 0).astype(np.uint8))
    rows, cols = np.nonzero(both[3] == 2)
    point = float(np.median(cols)), float(np.median(rows))
    visitor.change_bodies("add", 3, [point])
    (job,) = visitor.queue.jobs  # type: ignore[attr-defined]
    assert job.request["points"] == [[2 * point[0], 2 * point[1], pytest.approx(0.6)]]
    assert (job.request["start"], job.request["seconds"]) == (0.5, 1.0)
    with pytest.raises(ParamsError, match="your run is still going"):
        visitor.change_bodies("drop", 0, [point])
    np.savez(job.folder / "masks.npz", masks=np.where(both == 2, 1, 2 * (both == 1)).astype(np.uint8))
    job.when_done({})
    np.testing.assert_array_equal(visitor.bodies.masks.masks, both)
    assert not job.folder.exists()


def test_a_drawn_length_is_told_in_px_of_the_video_and_masks_as_they_are(visitor: Visitor) -> None:
    visitor.change_bodies("drop", 0, [place(visitor, 2)])
    visitor.infer("quick", 9.81, (10, 20, 110, 20, 0.5))
    (job,) = visitor.queue.jobs  # type: ignore[attr-defined]
    assert job.request["length"] == [20, 40, 220, 40, 0.5]
    assert job.request["search"] == SEARCHES["quick"]
    assert np.load(job.request["masks"])["masks"].max() == 1


@pytest.mark.parametrize(
    ("search", "gravity", "length", "message"),
    [
        ("endless", 9.81, None, "valid: quick, usual, thorough"),
        ("quick", 0.0, None, "gravity: 0 m/s²; valid"),
        ("quick", 9.81, (1, 2, 3, 4, 0.0), "greater than 0"),
    ],
)
def test_a_search_that_cannot_be_is_refused(visitor: Visitor, search: str, gravity: float, length, message) -> None:
    with pytest.raises(ParamsError, match=message):
        visitor.infer(search, gravity, length)


def test_the_clip_is_edited_only_where_a_slider_was_moved(visitor: Visitor, tmp_path: Path) -> None:
    live = LiveScene.of(small_clip.scene(), small_clip.SCHEDULE, (480, 320))
    visitor.result = Result(tmp_path, {"film": {"frames": 30, "fps": 30.0}}, live)
    with pytest.raises(ParamsError, match="no slider was moved"):
        visitor.edit({})
    visitor.edit({"objects": {"ball": {"mass": 2}}})
    (job,) = visitor.queue.jobs  # type: ignore[attr-defined]
    assert job.request["edits"] == ["objects[0].mass=2"]


def test_a_defect_of_a_job_is_said_and_its_folder_removed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "job"
    folder.mkdir()
    job = Job("bodies", {"kind": "none of ours", "folder": str(folder)}, folder, lambda _: None)
    job.run()
    assert (job.state, job.error) == (FAILED, INTERNAL)
    assert "KeyError" in capfd.readouterr().err
    assert not folder.exists()
