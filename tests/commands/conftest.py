"""Files that the tests of the commands share, and how a command is run."""

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import small_clip

from pipeline.commands import infer_outputs, what_if
from pipeline.commands.main import main


@dataclass(frozen=True)
class Ran:
    """What a command left: its exit code, and what it wrote to stdout and stderr."""

    code: int
    out: str
    err: str


Run = Callable[..., Ran]


@contextmanager
def files_no_larger_than(size: int) -> Iterator[None]:
    """What a full disk is to a program: writing more than `size` bytes into a file fails."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(autouse=True)
def _our_own_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine without OpenGL, whose probe takes seconds."""
    for module in (infer_outputs, what_if):
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
