"""A checkpoint's record of how its input is made."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.errors import ModelError
from pipeline.model.model_input import INPUT_FILE, ModelInput, read_input, write_input

FLOW = ModelInput(
    input="flow", picture="wheel", flow_source="raft", flow_size=(240, 160), flow_iterations=4, reasoning=True
)
RGB = ModelInput(input="rgb", picture=None, flow_source=None, flow_size=None, flow_iterations=None, reasoning=False)
WORDS = ModelInput("any", None, "exact", (240, 160), 4, "any", "any")


@pytest.mark.parametrize("written", [FLOW, RGB, WORDS])
def test_what_is_written_is_read(tmp_path: Path, written: ModelInput) -> None:
    assert read_input(str(tmp_path)) is None
    write_input(tmp_path, written)
    assert read_input(str(tmp_path)) == written


def test_settings_of_flow_do_not_count_for_a_model_of_frames() -> None:
    assert ModelInput.of("rgb", "wheel", "raft", (240, 160), 4, False) == RGB
    assert ModelInput.of("flow", "wheel", "raft", (240, 160), 4, True) == FLOW


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"input": "depth"}, '`input` is "depth"; valid: "flow", "rgb", "any"'),
        ({"picture": "wheels"}, '`picture` is "wheels"; valid: "channels", "wheel"'),
        ({"flow_source": "guess"}, '`flow_source` is "guess"; valid: "exact", "raft", "dis"'),
        ({"flow_size": None}, "`flow_size` is None"),
        ({"flow_iterations": 0}, "`flow_iterations` 0"),
        ({"reasoning": "yes"}, '`reasoning` is "yes"; valid: true, false, "any"'),
        ({"size": 3}, "cannot be used"),
    ],
)
def test_a_record_that_cannot_be_is_refused_with_its_place(tmp_path: Path, change: dict, said: str) -> None:
    write_input(tmp_path, FLOW)
    stored = json.loads((tmp_path / INPUT_FILE).read_text()) | change
    (tmp_path / INPUT_FILE).write_text(json.dumps(stored))
    with pytest.raises(ModelError) as raised:
        read_input(str(tmp_path))
    assert said in str(raised.value)
    assert str(tmp_path / INPUT_FILE) in str(raised.value)


def test_a_setting_that_contradicts_the_record_is_named_with_both_values() -> None:
    with pytest.raises(
        ModelError, match=r'^flow\.picture is "channels", but m was .* picture "wheel" .*; valid: "wheel"$'
    ):
        FLOW.check("picture", "channels", "flow.picture", "m")
    FLOW.check("picture", "wheel", "flow.picture", "m")
    with pytest.raises(ModelError, match='--flow is "dis"'):
        FLOW.check("flow_source", "dis", "--flow", "m")


def test_a_model_of_any_input_contradicts_nothing_and_is_asked_for_bodies_by_flow_with_reasons() -> None:
    for name, given in (("input", "rgb"), ("reasoning", False), ("sees", "frame"), ("picture", "wheel")):
        WORDS.check(name, given, "model", "m")
    assert WORDS.asked == ModelInput("flow", None, "exact", (240, 160), 4, True, "bodies")
    assert FLOW.asked == FLOW


def test_a_model_of_exact_flow_may_be_shown_measured_flow() -> None:
    for source in ("exact", "raft", "dis"):
        replace(FLOW, flow_source="exact").check("flow_source", source, "--flow", "m")
