"""Every stage of dvc.yaml that writes a data folder, on one clip a suite and the smallest sizes."""

import contextlib
import importlib
import pickle
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files
from pipeline.shards.executor import EXECUTORS
from stages import regress

SUITES = ("train", "val", "id", "views", "real")  # held_out and more run as id does
TRAINING = {"steps": 1, "batch_size": 1, "checkpoint_steps": 1}
SMALLEST = {
    "sample": {"shard_size": 1},
    "render": {"width": 120, "height": 80, "backend": "raycast"},
    "flow": {"width": 120, "height": 80, "iterations": 1},
    "finetune": TRAINING,
    "regress": {"enabled": True, "width": 32, "height": 16, "hidden": 16, "layers": 1, "heads": 2, **TRAINING},
    "infer": {"samples": 1},
    "search": {"width": 48, "height": 32, "starts": 1},
    "cmaes": {"population": 4, "iterations": 1},
    "fit": {"simulations": 200},
    "predict": {"simulations": 200},
    "tracks": {"simulations": 200},
    "hide": {"worlds": 1, "clips": 2},
    "hide_filmed": {"worlds": 1, "clips": 2},
    "discover": {"effects": "air_drag"},
    "executor": {"workers": 1},
}
WITHOUT_DATA = ("score", "score_views", "verify")  # they write reports


def runs() -> Iterator[tuple[str, list[str], list[str]]]:
    """Stage, command line and outputs, in the order of dvc.yaml, which is one in which the stages can run."""
    for stage, entry in YAML(typ="safe").load(ROOT / "dvc.yaml")["stages"].items():
        if stage not in WITHOUT_DATA:
            suites = [suite for suite in entry["matrix"]["suite"] if suite in SUITES] if "matrix" in entry else [""]
            for suite in suites:
                yield stage, suite.split(), [out.replace("${item.suite}", suite) for out in entry["outs"]]


@dataclass(frozen=True)
class Elsewhere:
    """Computes in an empty folder, as a machine of a cluster does, which has the code and the store alone."""

    folder: Path
    distant = True

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        for item in items:
            with contextlib.chdir(self.folder):
                result = function(pickle.loads(pickle.dumps(item)))
            yield result


def run_graph() -> None:
    for stage, words, _ in runs():
        importlib.import_module(f"stages.{stage}").main(*words)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path / "store"))
    monkeypatch.setattr(regress, "SUITES", ("id", "real"))
    (tmp_path / "models").symlink_to(ROOT / "models")
    shutil.copytree(ROOT / "data/samples/cross_engine_01", tmp_path / "videos/cross_engine_01")
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    for suite in ("train", "val", "id", "views"):
        params["suites"][suite]["clips"] = 1
    params["suites"]["real"]["path"] = "videos"
    for section, values in SMALLEST.items():
        params[section] |= values
    yaml.dump(params, tmp_path / "params.yaml")
    return tmp_path


@pytest.mark.slow
def test_what_every_stage_takes_from_the_store_is_byte_for_byte_what_it_computed_on_a_machine_with_the_store_alone(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    with monkeypatch.context() as computing:
        computing.setitem(EXECUTORS, "local", lambda *_: Elsewhere(elsewhere))
        run_graph()
    outputs = [out for *_, outs in runs() for out in outs]
    computed = {out: hash_files(folder / out) for out in outputs}
    assert all(computed.values())
    shutil.rmtree(folder / "data")
    capsys.readouterr()
    run_graph()
    printed = capsys.readouterr().out
    assert [line for line in printed.splitlines() if " computed" in line and " 0 computed" not in line] == []
    stored = {out: hash_files(folder / out) for out in outputs}
    assert [out for out in outputs if stored[out] != computed[out]] == []
