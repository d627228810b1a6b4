"""The project's own parameters."""

from pathlib import Path

import pytest
from pydantic import BaseModel

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


@pytest.mark.skipif(not PARAMS.exists(), reason="there is no params.yaml yet")
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
    if not Path(ROOT, "dvc.yaml").exists():
        pytest.skip("the stages are not there yet")
    assert not missing
