"""What a stage's command does with words, errors and Ctrl-C."""

from collections.abc import Callable
from pathlib import Path

import pytest
from toy_stage import make

from pipeline.errors import ParamsError
from pipeline.shards.prune import usage
from pipeline.shards.store import Store
from stages.graph.run import run


def raising(error: BaseException) -> Callable[[], None]:
    def main() -> None:
        raise error

    return main


def test_the_words_of_the_command_line_are_the_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    def main(suite: str, times: str = "1") -> None:
        print(suite, times)

    run(main, ["train"])
    run(main, ["train", "2"])
    assert capsys.readouterr().out == "train 1\ntrain 2\n"


@pytest.mark.parametrize("words", [[], ["a", "b"]])
def test_words_that_do_not_fit_are_answered_with_the_usage(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    def main(suite: str) -> None:
        raise AssertionError

    with pytest.raises(SystemExit) as done:
        run(main, words)
    assert done.value.code == 2
    assert capsys.readouterr().err.endswith("SUITE\n")


def test_an_error_of_the_user_is_one_line_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    error = ParamsError("`seed` is missing")
    error.add_note("in drop train, clips 0 to 3")
    with pytest.raises(SystemExit) as done:
        run(raising(error), [])
    assert done.value.code == 2
    assert capsys.readouterr().err == "error: `seed` is missing (in drop train, clips 0 to 3)\n"


def test_ctrl_c_is_exit_code_130_without_a_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        run(raising(KeyboardInterrupt()), [])
    assert done.value.code == 130
    assert "interrupted" in capsys.readouterr().err


def test_a_store_that_has_a_limit_keeps_to_it_after_each_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path / "store"))

    def stage() -> None:
        for seed in (1, 2, 3):
            make(tmp_path, seed=seed)

    run(stage, [])
    everything = usage(Store(tmp_path / "store"))
    monkeypatch.setenv("DYNAMICS_STORE_GIB", f"{everything.bytes / 2 / 2**30:.9f}")
    run(stage, [])
    assert 0 < usage(Store(tmp_path / "store")).bytes <= everything.bytes / 2
    assert "DYNAMICS_STORE_GIB" in capsys.readouterr().out
    assert "0 computed" in (make(tmp_path, seed=3), capsys.readouterr().out)[1], "what was used last stays"


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "ten"])
def test_a_limit_that_is_no_size_is_an_error_before_anything_is_done(
    limit: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("DYNAMICS_STORE_GIB", limit)
    with pytest.raises(SystemExit):
        run(raising(AssertionError()), [])
    assert "valid: a number of GiB" in capsys.readouterr().err


def test_a_defect_shows_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        run(raising(ZeroDivisionError()), [])
