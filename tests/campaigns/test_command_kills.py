"""`dynamics discover` and `dynamics infer`, killed at random moments and run again into the same folder."""

import json
import os
import shutil
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


def kill_and_run_again(tmp_path: Path, rng: np.random.Generator, words: tuple[object, ...], kills: int) -> None:
    """Kill as many runs, half of which replace a result that is there (--force). A run that ends before is extra."""
    began = time.monotonic()
    finish(start(*words, "-o", tmp_path / "sound"))
    duration = time.monotonic() - began
    expected, out = results(tmp_path / "sound"), tmp_path / "shelf" / "out"
    done = ended = 0
    while done < kills:
        replace = done % 2 == 1
        if replace and not out.exists():
            shutil.copytree(tmp_path / "sound", out)
        elif out.exists() and not replace:
            shutil.rmtree(out)
        process = start(*words, "-o", out, *["--force"] * replace)
        try:
            said, _ = process.communicate(timeout=rng.uniform(0.05, 0.95) * duration)
            assert process.returncode == 0, said
            ended += 1
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            done += 1
        assert not out.exists() or results(out) == expected, "a folder is whole or not there"
    finish(start(*words, "-o", out, "--force"))
    assert results(out) == expected
    assert [path.name for path in out.parent.iterdir()] == ["out"], "nothing of the killed runs is left"
    print(f"{words[0]}: {done} kills, {ended} runs that ended before")


def test_discover(tmp_path: Path, rng: np.random.Generator) -> None:
    measured = ROOT / "data/measured"
    words = ("discover", measured / "thrown_ball.csv", measured / "thrown_ball.yaml")
    kill_and_run_again(tmp_path, rng, words, len(rounds(1, 40)))


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
    kill_and_run_again(tmp_path, rng, words, len(rounds(1, 20)))
