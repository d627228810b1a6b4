"""What `dynamics` says of itself, and what it does with errors."""

import os
import subprocess
import sys

import pytest
from command_run import Run

from pipeline.commands.main import VERBS
from pipeline.errors import SceneError


def test_every_subcommand_explains_itself(run: Run) -> None:
    overview = run("--help").out
    for name in VERBS:
        assert f"\n    {name}" in overview
        help_text = run(name, "--help").out
        assert "examples:" in help_text
        assert f"dynamics {name}" in help_text
    assert {"discover", "infer", "simulate", "view"} <= set(VERBS)


def test_the_help_comes_without_loading_anything_heavy() -> None:
    heavy = {"torch", "transformers", "mujoco", "numba", "rerun", "cv2", "numpy"}
    code = f"""import sys
from pipeline.commands.main import parser
parser().format_help()
print({heavy} & set(sys.modules))"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("guess",),
        ("infer",),
        ("infer", "a.mp4"),
        ("simulate", "a", "--seconds", "-1"),
        ("infer", "a.mp4", "-o", "b", "--samples", "1.5"),
    ],
)
def test_words_that_do_not_fit_are_exit_code_2(run: Run, words: tuple[str, ...]) -> None:
    done = run(*words)
    assert done.code == 2
    assert "error:" in done.err


def test_an_error_of_the_user_is_one_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: object) -> None:
        raise SceneError("objects[0].mass:\n  must be greater than 0")

    monkeypatch.setattr("pipeline.commands.view.run", refuse)
    done = run("view", "scene.yaml")
    assert (done.code, done.err) == (2, "error: objects[0].mass: must be greater than 0\n")


def test_ctrl_c_is_exit_code_130_and_a_defect_shows_itself(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    def fail(_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("pipeline.commands.view.run", interrupt)
    done = run("view", "scene.yaml")
    assert done.code == 130
    assert "interrupted" in done.err
    monkeypatch.setattr("pipeline.commands.view.run", fail)
    with pytest.raises(ZeroDivisionError):
        run("view", "scene.yaml")
