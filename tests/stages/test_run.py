"""What a stage's command does with words, errors and Ctrl-C."""

from collections.abc import Callable

import pytest

from pipeline.errors import ParamsError
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


def test_a_defect_shows_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        run(raising(ZeroDivisionError()), [])
