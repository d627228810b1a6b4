"""`dynamics discover` and `dynamics infer`, killed at random moments and run again into the same folder."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import small_clip
from campaign import rounds

from pipeline.api.result_folder import RESULT
from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files

pytestmark = pytest.mark.campaign

OWN = ("times.json", "recording.rrd")  # which differ between equal runs


def results(folder: Path) -> dict[str, object]:
    """What equal runs have in common: hashes of files, and result.json but for the times of `infer`."""
    found: dict[str, object] = {name: digest for name, digest in hash_files(folder).items() if name not in OWN}
    result = json.loads((folder / RESULT).read_text())
    result.pop("seconds", None)
    return found | {RESULT: result}


def start(*words: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "pipeline.commands.main", *map(str, words)]
    return subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )


def finish(process: subprocess.Popen[str]) -> None:
    said, _ = process.communicate(timeout=600)
    assert process.returncode == 0, said


def kill_and_run_again(tmp_path: Path, rng: np.random.Generator, words: tuple[object, ...], kills: range) -> None:
    """Half of the killed runs replace a result that is there (--force)."""
    began = time.monotonic()
    finish(start(*words, "-o", tmp_path / "sound"))
    duration = time.monotonic() - began
    expected, out = results(tmp_path / "sound"), tmp_path / "shelf" / "out"
    done = 0
    for k in kills:
        process = start(*words, "-o", out, *["--force"] * (k % 2))
        try:
            process.communicate(timeout=rng.uniform(0.05, 0.95) * duration)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            done += 1
        assert not out.exists() or results(out) == expected, "a folder is whole or not there"
    finish(start(*words, "-o", out, "--force"))
    assert results(out) == expected
    assert [path.name for path in out.parent.iterdir()] == ["out"], "nothing of the killed runs is left"
    print(f"{words[0]}: {done} kills")


def test_discover(tmp_path: Path, rng: np.random.Generator) -> None:
    measured = ROOT / "data/measured"
    words = ("discover", measured / "thrown_ball.csv", measured / "thrown_ball.yaml")
    kill_and_run_again(tmp_path, rng, words, rounds(1, 40))


def test_infer(tmp_path: Path, rng: np.random.Generator) -> None:
    small_clip.write(tmp_path / "clip.mp4")
    np.savez(tmp_path / "masks.npz", masks=small_clip.masks())
    model = small_clip.write_model(tmp_path / "model")
    words = (
        "infer",
        tmp_path / "clip.mp4",
        "--masks",
        tmp_path / "masks.npz",
        "--model",
        model,
        "--flow",
        "dis",
        "--samples",
        1,
    )
    kill_and_run_again(tmp_path, rng, words, rounds(1, 20))
