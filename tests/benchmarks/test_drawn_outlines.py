"""Drawn outlines: the files that ship are read and make sense, masks are exact, and errors name file and place."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.drawn_outlines import outline_mask, read_outlines
from pipeline.errors import VideoError

FOLDER = Path(__file__).parents[2] / "benchmarks" / "outlines"


def small() -> dict[str, Any]:
    return {
        "clip": "a.mp4",
        "width": 20,
        "height": 10,
        "fps": 240,
        "file_fps": 30.0,
        "stretch_frames": [2, 9],
        "stretch_file_seconds": [0.067, 0.3],
        "objects": [{"name": "ball", "shape": "sphere", "moves": True}],
        "frames": {"3": [{"object": "ball", "polygon": [[1, 1], [5, 1], [5, 4]]}], "7": []},
        "static": {"ramp_edge": [[0, 9], [19, 8]], "length_marks": {"px": [[1, 1], [4, 5]], "m": 0.5}},
        "notes": "none",
    }


def write(folder: Path, data: Any) -> Path:
    (folder / "a.json").write_text(json.dumps(data))
    return folder


def test_what_is_written_is_read(tmp_path: Path) -> None:
    (clip,) = read_outlines(write(tmp_path, small()))
    assert (clip.clip, clip.width, clip.height, clip.fps, clip.file_fps) == ("a.mp4", 20, 10, 240.0, 30.0)
    assert clip.stretch_frames == (2, 9) and clip.objects == (("ball", "sphere"),)
    assert sorted(clip.frames) == [3, 7] and clip.frames[7] == ()
    assert clip.frames[3][0].object == "ball"
    np.testing.assert_array_equal(clip.frames[3][0].polygon, [[1, 1], [5, 1], [5, 4]])
    np.testing.assert_array_equal(clip.lines["ramp_edge"], [[0, 9], [19, 8]])
    assert clip.length_marks is not None and clip.length_marks.px_per_m == pytest.approx(10)


def test_the_outlines_that_ship_are_six_frames_a_clip_with_bodies_of_a_sensible_size() -> None:
    clips = read_outlines(FOLDER)
    assert len(clips) == 14
    for clip in clips:
        assert len(clip.frames) == 6, clip.clip
        first, last = clip.stretch_frames
        assert clip.stretch_file_seconds == pytest.approx(
            (first / clip.file_fps, last / clip.file_fps), abs=0.08
        )  # time stamps
        for outlines in clip.frames.values():
            mask = outline_mask([o.polygon for o in outlines], clip.width, clip.height)
            assert len(outlines) == len(clip.objects), clip.clip
            for i, outline in enumerate(outlines):
                x, y = outline.polygon.T
                area = abs(float(x @ np.roll(y, -1) - np.roll(x, -1) @ y)) / 2
                assert np.count_nonzero(mask == i + 1) == pytest.approx(area, rel=0.1), (clip.clip, outline.object)
                assert 15 < area < 0.1 * clip.width * clip.height, (clip.clip, outline.object)


@pytest.mark.parametrize("name", ["osp_BallTossOut", "osp_pucks_collide", "osp_ball_rolls_off_table"])
def test_the_length_marks_agree_with_the_scales_that_are_known(name: str) -> None:
    known = {"osp_BallTossOut": 398.7, "osp_pucks_collide": 368.0, "osp_ball_rolls_off_table": 319.0}
    (clip,) = [c for c in read_outlines(FOLDER) if c.clip.startswith(name)]
    assert clip.length_marks is not None and clip.length_marks.px_per_m == pytest.approx(known[name], rel=0.01)


def test_a_mask_has_the_pixels_whose_centres_are_inside_and_later_polygons_win() -> None:
    square = np.array([[0.5, 0.5], [3.5, 0.5], [3.5, 2.5], [0.5, 2.5]])
    mask = outline_mask([square, square + np.array([2, 1])], 8, 6)
    expected = np.zeros((6, 8), np.uint8)
    expected[1:3, 1:4] = 1
    expected[2:4, 3:6] = 2
    assert mask.dtype == np.uint8
    np.testing.assert_array_equal(mask, expected)


def test_a_mask_of_a_polygon_that_is_not_convex_and_leaves_the_picture() -> None:
    arrow = np.array([[-3.5, -3.5], [9.5, -3.5], [9.5, 9.5], [2.5, 0.5]])  # the notch is at (2.5, 0.5)
    mask = outline_mask([arrow], 6, 5)
    assert mask[0, 3] == 1 and mask[3, 5] == 1 and mask[4, 5] == 0 and mask[4, 0] == 0 and mask[2, 2] == 0
    assert not outline_mask([arrow + 100], 6, 5).any()
    assert outline_mask([], 6, 5).shape == (5, 6)


def test_a_random_disc_has_its_area_and_centre(rng: np.random.Generator) -> None:
    centre, radius = rng.uniform(30, 70, 2), rng.uniform(8, 25)
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    mask = outline_mask([centre + radius * np.stack([np.cos(angle), np.sin(angle)], 1)], 100, 100)
    y, x = np.nonzero(mask)
    assert len(x) == pytest.approx(np.pi * radius**2, rel=0.05)
    np.testing.assert_allclose([x.mean(), y.mean()], centre, atol=0.3)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["width"], -1, "'width' must be a positive number"),
        (["stretch_frames"], [9, 2], "'stretch_frames' must be two numbers"),
        (["objects", 0, "shape"], "cone", "objects[0]: shape is 'cone'"),
        (["objects"], [], "objects must have one or more entries"),
        (["frames", "12"], [], "frames['12'] is no frame of the stretch"),
        (["frames", "3", 0, "object"], "cube", "frames['3'][0]: there is no object 'cube'"),
        (["frames", "3", 0, "polygon"], [[1, 1], [2, 2]], "frames['3'][0]: polygon must be a list of at least 3"),
        (["frames", "3", 0, "polygon", 0], [1], "frames['3'][0]: polygon is no list of points"),
        (["frames", "3", 0, "polygon", 0], [25, 1], "frames['3'][0]: the polygon leaves the picture"),
        (["static", "ramp_edge"], 3, "static['ramp_edge'] must be a list"),
        (["static", "length_marks", "m"], 0, "static['length_marks']: 'm' must be a positive number"),
        (["static", "length_marks"], {"m": 1}, "static['length_marks'] has no entry 'px'"),
    ],
)
def test_errors_name_file_and_place(tmp_path: Path, path: list[Any], value: Any, message: str) -> None:
    data = small()
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(VideoError) as error:
        read_outlines(write(tmp_path, data))
    assert message in str(error.value) and str(tmp_path / "a.json") in str(error.value)


def test_a_file_that_is_no_json_and_a_folder_without_outlines_are_named(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="has no outlines"):
        read_outlines(tmp_path)
    (tmp_path / "b.json").write_text("{")
    with pytest.raises(VideoError, match=r"b\.json cannot be read"):
        read_outlines(tmp_path)
