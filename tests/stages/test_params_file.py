"""What a user sees of a params.yaml that is wrong, and what a stage sees of one that is right."""

from pathlib import Path

import pytest

from pipeline.errors import ParamsError
from stages.graph.params_file import Section, read_params_file
from stages.graph.stage_params import ParamsView


class ToySuite(Section):
    clips: int
    objects: tuple[int, int]


class ToySample(Section):
    shard_size: int
    rate: float
    suites: dict[str, ToySuite]
    noise: float | None


class ToyParams(Section):
    seed: int
    sample: ToySample


TEXT = """\
seed: 0
sample:
  shard_size: 64      # clips
  rate: 1e-5
  noise: null
  suites:
    train: {clips: 320, objects: [1, 3]}
    held_out: {clips: 48, objects: [4, 4]}
"""


def read(folder: Path, text: str = TEXT) -> ToyParams:
    (folder / "params.yaml").write_text(text)
    return read_params_file(folder / "params.yaml", ToyParams)


def test_numbers_are_those_of_yaml_1_2(tmp_path: Path) -> None:
    params = read(tmp_path)
    assert params.sample.rate == 1e-5
    assert params.sample.suites["train"].objects == (1, 3)
    assert read(tmp_path, TEXT.replace("1e-5", "1")).sample.rate == 1.0
    with pytest.raises(ParamsError, match='`seed` is "on"'):
        read(tmp_path, TEXT.replace("seed: 0", "seed: on"))  # which YAML 1.1 would make a bool


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "{clips: 320",
            "{clisp: 320, clips: 320",
            "`sample.suites.train.clisp` is not a parameter (did you mean 'clips'?); valid here: clips, objects",
        ),
        ("seed: 0", "seed: 0\nseeds: 1", "`seeds` is not a parameter (did you mean 'seed'?); valid here: sample, seed"),
        ("{clips: 320, ", "{", "`sample.suites.train.clips` is missing"),
        ("clips: 320", "clips: many", '`sample.suites.train.clips` is "many": input should be a valid integer'),
        ("clips: 320", "clips: true", "`sample.suites.train.clips` is true: input should be a valid integer"),
        ("rate: 1e-5", 'rate: "1e-5"', '`sample.rate` is "1e-5": input should be a valid number'),
        ("[1, 3]", "[1, x]", '`sample.suites.train.objects[1]` is "x": input should be a valid integer'),
        ("[1, 3]", "[1]", "`sample.suites.train.objects[1]` is missing"),
        ("[1, 3]", "3", "`sample.suites.train.objects` is 3: input should be a valid"),
        ("    held_out: {clips: 48, objects: [4, 4]}", "    held_out:", "`sample.suites.held_out` is null: "),
        ("seed: 0", "seed: 0\nseed: 1", 'line 2: found duplicate key "seed"'),
        ("[1, 3]}", "[1, 3]", "line 8: "),
    ],
)
def test_an_error_is_one_line_with_the_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in TEXT
    with pytest.raises(ParamsError) as caught:
        read(tmp_path, TEXT.replace(old, new))
    assert message in str(caught.value)
    assert str(tmp_path / "params.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_of_several_errors_the_first_is_described_and_the_others_are_counted(tmp_path: Path) -> None:
    with pytest.raises(ParamsError, match=r"`sample.shard_size` is missing \(and 1 more\)"):
        read(tmp_path, TEXT.replace("  shard_size: 64      # clips\n", "").replace("{clips: 48, ", "{"))


@pytest.mark.parametrize("text", ["", "- 1\n- 2\n", "just words"])
def test_the_error_of_a_file_without_sections_says_what_it_must_have(tmp_path: Path, text: str) -> None:
    with pytest.raises(ParamsError, match="must have the sections seed, sample"):
        read(tmp_path, text)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParamsError, match=r"params.yaml is missing: run in the folder of the repository"):
        read_params_file(tmp_path / "params.yaml", ToyParams)


def view(folder: Path, *declared: str) -> ParamsView:
    return ParamsView.of(read(folder), declared, "toy", folder / "params.yaml")


def test_a_stage_sees_what_it_declared(tmp_path: Path) -> None:
    params = view(tmp_path, "seed", "sample.shard_size", "sample.suites.train")
    assert params.sample.shard_size == 64
    assert params.sample.suites["train"] == ToySuite(clips=320, objects=(1, 3))


def test_a_declared_section_is_the_section_itself(tmp_path: Path) -> None:
    section = view(tmp_path, "sample").sample
    assert section == read(tmp_path).sample
    assert section.model_dump()["shard_size"] == 64


def test_reading_what_was_not_declared_is_a_defect_of_the_stage(tmp_path: Path) -> None:
    params = view(tmp_path, "sample.suites.train.clips")
    for reads in (
        lambda: params.seed,
        lambda: params.sample.rate,
        lambda: params.sample.suites["held_out"],
        lambda: params.sample.suites["train"].objects,
        lambda: params.sample.model_dump(),
    ):
        with pytest.raises(AssertionError, match="is read but not declared; add it to READS"):
            reads()


def test_the_error_of_an_unknown_suite_lists_the_suites(tmp_path: Path) -> None:
    with pytest.raises(ParamsError, match=r"\(did you mean 'held_out'\?\); valid: train, held_out"):
        view(tmp_path, "sample.suites.heldout")
