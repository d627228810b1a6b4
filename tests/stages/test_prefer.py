"""The stage `prefer` on a tiny model and clips of a disc that moves."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from small_base import LAYOUT, random_clips, small_base

from pipeline.errors import ParamsError, ShardError
from pipeline.report.suite import AnsweredSuite
from pipeline.shards.code_hash import ROOT
from pipeline.shards.map_shards import map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from stages import prefer
from stages.graph.answering_model import FINETUNED, PREFERRED, AnsweringModel, answering_model, split_clips

CLIPS = 4
FRAMES = 30


def discs(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """In the place of `import_clips`: masks of a disc that moves to the right, and black pictures."""
    rows, columns = np.mgrid[:40, :60]
    masks = [(np.hypot(rows - 20, columns - 15 - t) < 8).astype(np.uint8) for t in range(FRAMES)]
    rgb = np.zeros((FRAMES, 40, 60, 3), np.uint8)
    return ShardResult(arrays={"mask": np.stack([masks] * len(shard)), "rgb": np.stack([rgb] * len(shard))})


def still(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """In the place of `flow`: no motion, and pictures of noise."""
    flow = np.zeros((len(shard), LAYOUT.frames, 40, 60, 2), np.float32)
    return ShardResult(arrays={"flow": flow, "picture": random_clips(np.random.default_rng(shard.start), len(shard))})


def write_params(**prefer_values: Any) -> None:
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    params["clip"]["model_frames"] = LAYOUT.frames
    params["model"] |= {"base": "base", "input": "flow", "sees": "frame"}
    params["prefer"] |= {
        "samples": 4,
        "steps": 4,
        "checkpoint_steps": 2,
        "batch_size": 2,
        "margin": 0.0,
        **prefer_values,
    }
    yaml.dump(params, Path("params.yaml"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path / "store"))
    small_base().save(FINETUNED)
    for name, compute in (("render", discs), ("flow", still)):
        map_shards(
            name,
            "real",
            tmp_path / "data" / name / "real",
            compute,
            parameters=None,
            clips=CLIPS,
            shard_size=2,
            workers=1,
        )
    return tmp_path


def test_where_it_is_not_enabled_the_fine_tuned_model_answers_and_nothing_is_copied(folder: Path) -> None:
    with pytest.raises(ShardError, match=r"answering_model\.json is missing"):
        answering_model()
    write_params(enabled=False)
    prefer.main()
    assert answering_model() == AnsweringModel(False)
    assert answering_model().folder == FINETUNED
    assert sorted(path.name for path in (folder / "data/prefer").iterdir()) == [
        "answering_model.json",
        "contents.json",
        "curve.csv",
    ]
    assert (folder / "data/prefer/curve.csv").read_text() == "step,loss,accuracy,margin\n"


def test_where_it_is_enabled_its_model_answers_and_says_what_it_has_seen(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_params(enabled=True, clips=2)
    prefer.main()
    model = answering_model()
    assert model.folder == PREFERRED
    assert model.suite == "real"
    assert len(model.used) == 2
    pairs = json.loads((folder / "data/prefer/pairs.json").read_text())
    assert {pair["clip"] for pair in pairs} <= set(model.used)
    assert all(pair["gap"] > 0 for pair in pairs)
    with (folder / "data/prefer/curve.csv").open() as file:
        curve = list(csv.DictReader(file))
    assert [int(row["step"]) for row in curve] == ([1, 2, 3, 4] if pairs else [])
    assert (PREFERRED / "model.safetensors").read_bytes() != (FINETUNED / "model.safetensors").read_bytes()
    suite = AnsweredSuite("real", {}, frozenset(model.used))
    assert [suite.group(clip) for clip in range(CLIPS)] == [
        "real, used by prefer" if clip in model.used else "real" for clip in range(CLIPS)
    ]
    assert not model.has_used("id", model.used[0])
    written = {path.name: path.read_bytes() for path in PREFERRED.iterdir()}
    prefer.main()
    assert "prefer: from the store" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in PREFERRED.iterdir()} == written


def test_some_clips_must_be_left_for_the_scores(folder: Path) -> None:
    write_params(enabled=True, clips=CLIPS)
    with pytest.raises(ParamsError, match=r"`prefer\.clips` is 4, but real has 4 clips; valid: fewer"):
        prefer.main()
    assert not (folder / "data" / "prefer").exists()


def test_a_used_clip_is_never_among_those_left(rng: np.random.Generator) -> None:
    clips = int(rng.integers(2, 40))
    used = split_clips(rng, clips, int(rng.integers(1, clips)))
    assert len(set(used)) == len(used)
    assert set(used) < set(range(clips))
    model = AnsweringModel(True, "real", used)
    fresh = [clip for clip in range(clips) if not model.has_used("real", clip)]
    assert sorted([*used, *fresh]) == list(range(clips))
    seed = int(rng.integers(1000))
    assert split_clips(np.random.default_rng(seed), clips, 1) == split_clips(np.random.default_rng(seed), clips, 1)
