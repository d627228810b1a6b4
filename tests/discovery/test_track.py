"""Measured files: what is read, and what is said of each fault."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.discovery.tracks.track import (
    ROW_NUMBERS,
    Track,
    read_tracks,
    track_rows,
    tracks_from_rows,
    tracks_table,
)
from pipeline.errors import MeasurementError


def good(rows: int = 8) -> pd.DataFrame:
    t = np.arange(rows) / 60
    return pd.DataFrame({"clip": "a", "object": "ball", "time": t, "x": t, "y": 0 * t, "z": 1 - t})


def test_a_track_comes_back_from_parquet_and_csv_as_it_was(tmp_path: Path, rng: np.random.Generator) -> None:
    turn = rng.normal(size=(9, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    track = Track(
        clip="a",
        object="ball",
        time=np.cumsum(rng.uniform(0.01, 0.03, 9)),
        position=rng.normal(size=(9, 3)),
        quaternion=turn,
        angular_velocity=rng.normal(size=(9, 3)),
        sigma=rng.uniform(0.001, 0.002, 9),
    )
    table = tracks_table([track])
    pq.write_table(table, tmp_path / "m.parquet")
    table.to_pandas().to_csv(tmp_path / "m.csv", index=False)
    for name in ("m.parquet", "m.csv"):
        (back,) = read_tracks(tmp_path / name)
        assert (back.clip, back.object) == ("a", "ball")
        for key in ("time", "position", "quaternion", "angular_velocity", "sigma"):
            np.testing.assert_allclose(getattr(back, key), getattr(track, key), atol=1e-12)


def test_numbers_as_names_of_clips_stay_texts(tmp_path: Path) -> None:
    good().assign(clip="07").to_csv(tmp_path / "m.csv", index=False)
    assert read_tracks(tmp_path / "m.csv")[0].clip == "07"


def test_nan_is_a_missing_measurement(tmp_path: Path) -> None:
    frame = good()
    frame.loc[2, "y"] = np.nan
    frame.to_csv(tmp_path / "m.csv", index=False)
    assert np.isnan(read_tracks(tmp_path / "m.csv")[0].position[2, 1])


def changed(frame: pd.DataFrame, row: int, column: str, value: object) -> pd.DataFrame:
    frame = frame.astype({column: object})
    frame.loc[row, column] = value
    return frame


FAULTS = [
    (lambda f: f.drop(columns="z"), r"no column 'z'; needed: clip, object, time, x, y, z"),
    (lambda f: changed(f, 3, "time", f.time[2]), r"clip a, object ball, row 4: the same time as the row before"),
    (lambda f: changed(f, 3, "time", 0.0), r"clip a, object ball, row 4: time goes back"),
    (lambda f: f.iloc[:4], r"clip a, object ball, row 4: 4 measured positions end this track; needed: 5"),
    (lambda f: changed(f, 1, "x", "far"), r"clip a, object ball, row 2: x is 'far', not a number"),
    (lambda f: changed(f, 1, "x", "inf"), r"clip a, object ball, row 2: x is infinite"),
    (lambda f: changed(f, 4, "time", ""), r"clip a, object ball, row 5: no time"),
    (lambda f: f.assign(qw=1.0), r"column 'qw' without the others of qw, qx, qy, qz"),
    (lambda f: f.assign(qw=0.0, qx=0.0, qy=0.0, qz=0.0), r"row 1: a quaternion of length zero"),
    (lambda f: f.assign(wx=1.0), r"column 'wx' without the others of wx, wy, wz"),
    (lambda f: f.assign(sigma=0.0), r"clip a, object ball, row 1: sigma must be greater than 0"),
    (lambda f: f.iloc[:0], r"no rows"),
    (lambda f: changed(f, 2, "object", None), r"row 3: no object"),
]


@pytest.mark.parametrize(("damage", "said"), FAULTS)
def test_each_fault_names_clip_object_and_row(tmp_path: Path, damage, said: str) -> None:  # type: ignore[no-untyped-def]
    damage(good()).to_csv(tmp_path / "m.csv", index=False)
    with pytest.raises(MeasurementError, match=said):
        read_tracks(tmp_path / "m.csv")


def test_files_that_are_none_are_said_to_be(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="no such file"):
        read_tracks(tmp_path / "none.csv")
    (tmp_path / "m.parquet").write_bytes(b"no parquet")
    with pytest.raises(MeasurementError, match="cannot be read"):
        read_tracks(tmp_path / "m.parquet")
    (tmp_path / "m.txt").write_text("x")
    with pytest.raises(MeasurementError, match=r"valid: \.parquet, \.csv"):
        read_tracks(tmp_path / "m.txt")
    lines = good().to_csv(index=False).splitlines()
    (tmp_path / "m.csv").write_text("\n".join([lines[0], lines[1] + ",0.1,0.2", *lines[2:]]))
    with pytest.raises(MeasurementError, match="row 1 has more fields than the header names"):
        read_tracks(tmp_path / "m.csv")


def test_the_index_of_a_frame_is_read_as_columns(tmp_path: Path) -> None:
    good().set_index(["clip", "object"]).to_parquet(tmp_path / "m.parquet")
    good().to_csv(tmp_path / "m.csv", index=False)
    for indexed, plain in zip(read_tracks(tmp_path / "m.parquet"), read_tracks(tmp_path / "m.csv"), strict=True):
        assert indexed.clip == plain.clip
        np.testing.assert_allclose(indexed.position, plain.position)


def test_a_track_comes_back_from_rows_as_it_was(rng: np.random.Generator) -> None:
    time = np.cumsum(rng.uniform(0.01, 0.03, 9))
    spinning = Track("a", "ball", time, rng.normal(size=(9, 3)), angular_velocity=rng.normal(size=(9, 3)))
    turning = Track("a", "cube", time, rng.normal(size=(9, 3)), quaternion=rng.normal(size=(9, 4)))
    rows = track_rows([spinning, turning])
    assert set(rows[0]) == {"clip", "object", *ROW_NUMBERS} and rows[0]["qw"] is None and rows[-1]["wx"] is None
    for track, back in zip((spinning, turning), tracks_from_rows(rows), strict=True):
        assert (back.clip, back.object) == (track.clip, track.object)
        for name in ("time", "position", "quaternion", "angular_velocity"):
            np.testing.assert_equal(getattr(back, name), getattr(track, name))
