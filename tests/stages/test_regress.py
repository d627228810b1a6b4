"""The stage `regress` on sampled scenes and pictures of noise."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from sampled_scenes import draw
from small_base import random_clips

from pipeline.report.suite import AnsweredSuite
from pipeline.scene.text import read_scene, write_scene
from pipeline.shards.code_hash import ROOT
from pipeline.shards.dataset import open_shards
from pipeline.shards.map_shards import map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages import regress
from stages.graph.stage_params import load

FRAMES = 4


@cache
def scenes() -> list[str]:
    return [write_scene(scene) for scene in draw(1, range(4)).scenes]


def sampled(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """In the place of `sample`."""
    rows = [{"clip": c, "scene": scenes()[c]} for c in shard.clips]
    return ShardResult({"clips": table_from_rows(rows, regress.SCHEMA)})


def noise(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """In the place of `flow`."""
    return ShardResult(arrays={"picture": random_clips(np.random.default_rng(shard.start), len(shard))})


def write_params(**values: Any) -> None:
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    params["clip"]["model_frames"] = FRAMES
    params["regress"] |= {
        "width": 32,
        "height": 16,
        "hidden": 16,
        "layers": 1,
        "heads": 2,
        "steps": 4,
        "checkpoint_steps": 2,
        "batch_size": 2,
        **values,
    }
    params["executor"]["workers"] = 1
    yaml.dump(params, Path("params.yaml"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path / "store"))
    return tmp_path


def test_where_it_is_not_enabled_nothing_is_read_or_trained_or_scored(folder: Path) -> None:
    write_params(enabled=False)
    regress.main()
    (only,) = (folder / "data/regress").iterdir()
    assert {path.name: path.read_text() for path in only.iterdir() if path.name != "contents.json"} == {
        "loss.csv": "step,loss\n",
        "eval_loss.csv": "step,eval_loss\n",
    }
    assert not load("score").regress.enabled


def test_where_it_is_enabled_every_clip_has_a_valid_scene_that_is_scored(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for suite in ("train", "val"):
        map_shards(
            "sample", suite, folder / "data/sample" / suite, sampled, parameters=None, clips=4, shard_size=2, workers=1
        )
    for suite in ("train", "val", *regress.SUITES):
        map_shards(
            "flow", suite, folder / "data/flow" / suite, noise, parameters=None, clips=4, shard_size=2, workers=1
        )
    write_params(enabled=True)
    regress.main()
    assert len((folder / "data/regress/model/eval_loss.csv").read_text().splitlines()) == 4
    for suite in regress.SUITES:
        told = open_shards(folder / "data/regress" / suite)
        assert len(told) == 4
        for clip in told:
            scene = read_scene(clip.row()["scene"])
            assert scene.objects
            assert scene.camera is not None
            assert scene.camera.position[:2] == (0, -2)
    capsys.readouterr()
    regress.main()
    out = capsys.readouterr().out
    assert "regress: from the store" in out
    assert out.count("0 computed") == 4


def test_a_width_that_the_heads_do_not_share_is_refused(folder: Path) -> None:
    write_params(heads=3)
    with pytest.raises(Exception, match=r"regress.*`hidden` must be a multiple of the 3 `heads`"):
        regress.main()
    assert not (folder / "data").exists()


def test_the_scores_have_it_only_where_it_was_run(folder: Path) -> None:
    class Fake:
        def __init__(self, **row: Any) -> None:
            self._row = row

        def row(self) -> dict[str, Any]:
            return self._row

        def rows(self) -> list[dict[str, Any]]:
            return [self._row]

    found = {"scene": "scene", "simulations": 3, "guess": None, "sample": -1}
    suite: dict[str, Any] = {name: {0: Fake(**found)} for name in ("best_of_k", "cmaes", "fit", "infer")}
    assert "vivit" not in AnsweredSuite("id", suite).answers(0)
    answers = AnsweredSuite("id", {**suite, "regress": {0: Fake(scene="regressed")}}).answers(0)
    assert answers["vivit"] == ("regressed", 0)
