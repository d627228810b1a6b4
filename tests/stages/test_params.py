"""The project's own parameters."""

import importlib
from pathlib import Path

import pytest
from pydantic import BaseModel
from ruamel.yaml import YAML

from pipeline.errors import DynamicsError
from pipeline.shards.code_hash import ROOT
from stages.graph.params import Params
from stages.graph.stage_params import READS, declared_keys, load, load_executor

PARAMS = ROOT / "params.yaml"


def sections(model: type[BaseModel]) -> set[str]:
    """Every key of a model and of the models in it, dotted."""
    keys = set(model.model_fields)
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            keys |= {f"{name}.{key}" for key in sections(field.annotation)}
    return keys


def test_the_parameters_that_ship_are_valid_for_every_stage() -> None:
    for stage, keys in READS.items():
        load(stage, "train" if any("{suite}" in key for key in keys) else None, PARAMS)
    assert load_executor(PARAMS).name == "local"


def test_no_stage_declares_how_many_workers_there_are() -> None:
    for stage in READS:
        assert not any(key.split(".")[0] == "executor" for key in declared_keys(stage, "train"))


def test_no_stage_declares_a_key_and_a_part_of_it() -> None:
    for stage in READS:
        keys = declared_keys(stage, "train")
        assert not [(a, b) for a in keys for b in keys if b.startswith(f"{a}.")], stage


def test_every_declared_key_is_a_parameter() -> None:
    valid = sections(Params)
    for stage in READS:
        for key in declared_keys(stage, "train"):
            assert key in valid, f"{stage} reads {key}"


def test_every_stage_that_declares_parameters_is_a_module() -> None:
    missing = [stage for stage in READS if not Path(ROOT, "stages", f"{stage}.py").exists()]
    assert not missing


@pytest.mark.parametrize(
    ("stage", "words", "change", "message"),
    [
        ("simulate", ["id"], {"clip": {"model_frames": 30}}, "`clip` is .*`model_frames` must be less than the 30"),
        ("predict", ["id"], {"predict": {"seconds": 1.5}}, r"predict\.seconds: 1\.5 s; valid: multiples of 0\.1 s"),
        ("import_clips", [], {"clip": {"seconds": 2.0}}, r"suites\.real\.seconds is 1\.0, clip\.seconds is 2\.0"),
        ("discover", [], {"discover": {"effects": "air_drga"}}, r"discover\.effects: unknown effect 'air_drga'.*valid"),
        ("flow", ["id"], {"flow": {"raft": "models/nowhere"}}, r"flow\.raft: models/nowhere is missing"),
    ],
)
def test_parameters_that_do_not_fit_together_are_an_error_that_names_the_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str, words: list[str], change: dict, message: str
) -> None:
    yaml = YAML()
    params = yaml.load(PARAMS)
    for section, values in change.items():
        params[section] |= values
    yaml.dump(params, tmp_path / "params.yaml")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DynamicsError, match=message):
        importlib.import_module(f"stages.{stage}").main(*words)
    assert [path.name for path in tmp_path.iterdir()] == ["params.yaml"]
