"""Files that the tests of the commands share, and how a command is run."""

from pathlib import Path

import numpy as np
import pytest
import small_clip
from command_run import Ran, Run

from pipeline.api import infer_files, simulate
from pipeline.commands.main import main


@pytest.fixture(autouse=True)
def _our_own_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine without OpenGL, whose probe takes seconds."""
    for module in (infer_files, simulate):
        monkeypatch.setattr(module, "choose_backend", lambda choice: ("raycast", "our own ray caster"))


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """`dynamics` with some words."""

    def ran(*words: object) -> Ran:
        capsys.readouterr()
        try:
            code = main([str(word) for word in words])
        except SystemExit as left:
            code = int(left.code or 0)
        done = capsys.readouterr()
        return Ran(code, done.out, done.err)

    return ran


@pytest.fixture(scope="session")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with clip.mp4, its masks.npz, scene.yaml and the folder `model`; tests only read it."""
    folder = tmp_path_factory.mktemp("shelf")
    small_clip.write(folder / "clip.mp4")
    np.savez(folder / "masks.npz", masks=small_clip.masks())
    (folder / "scene.yaml").write_text(small_clip.TEXT)
    small_clip.write_model(folder / "model")
    return folder
