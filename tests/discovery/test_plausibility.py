"""Tables in other units, and overrides of clips that are not there."""

from pathlib import Path

import pandas as pd
import pytest

from pipeline.api.discover import discover
from pipeline.errors import DynamicsError, MeasurementError, SceneError
from pipeline.shards.code_hash import ROOT

TABLE, SCENE = ROOT / "data/measured/thrown_ball.csv", ROOT / "data/measured/thrown_ball.yaml"


def refused(folder: Path, table: pd.DataFrame, error: type[DynamicsError], scene: Path = SCENE) -> str:
    """What `discover` says of a table, before it begins."""
    file = folder / "table.parquet"
    table.to_parquet(file)
    with pytest.raises(error) as caught:
        discover(file, scene)
    return str(caught.value)


def test_times_in_another_unit_are_an_error_that_names_it(tmp_path: Path) -> None:
    table = pd.read_csv(TABLE)
    for factor, unit in ((1e3, "milliseconds"), (1e9, "nanoseconds")):
        said = refused(tmp_path, table.assign(time=table["time"] * factor), MeasurementError)
        assert said.startswith("clip throw_1, object ball: ")
        assert unit in said
    dates = pd.to_datetime(table["time"], unit="s")
    assert "time is a date" in refused(tmp_path, table.assign(time=dates), MeasurementError)
    assert "time is a date" in refused(tmp_path, table.assign(time=dates.astype(str)), MeasurementError)


def test_positions_in_millimetres_are_an_error_that_names_them(tmp_path: Path) -> None:
    table = pd.read_csv(TABLE)
    scaled = table.assign(**{c: 1e3 * table[c] for c in "xyz"})
    assert "in millimetres or pixels? Valid: metres" in refused(tmp_path, scaled, MeasurementError)


def test_a_misspelt_clip_is_an_error_that_names_the_right_one(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE.read_text() + "\nclips: {trow_1: {gravity: 9.8}}\n")
    said = refused(tmp_path, pd.read_csv(TABLE), SceneError, scene)
    assert said.startswith("clips.trow_1: no clip of that name was measured (did you mean 'throw_1'?)")
