"""DVC's own remote on an S3 server: what one clone pushed, another pulls, and nothing of the graph runs there."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML
from s3_server import S3Server

from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files

TARGET = "compile@id"  # and `sample@id`, which it needs


def run(folder: Path, server: S3Server, *words: str) -> str:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    names = {"GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@b", "GIT_COMMITTER_NAME": "a", "GIT_COMMITTER_EMAIL": "a@b"}
    environment = {**os.environ, **server.environment, **names, "PYTHONPATH": str(folder), "PATH": path}
    environment.pop("DYNAMICS_STORE", None)
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def repository(folder: Path) -> Path:
    folder.mkdir()
    for name in ("pipeline", "stages"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "dvc.yaml", folder)
    (folder / ".gitignore").write_text("__pycache__/\n.shards/\n.dvc/tmp/\n.dvc/cache/\n/data/\n")
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    params["suites"]["id"]["clips"] = 2
    params["executor"]["workers"] = 1
    yaml.dump(params, folder / "params.yaml")
    return folder


@pytest.mark.slow
def test_a_fresh_clone_pulls_what_was_pushed_and_runs_nothing(tmp_path: Path, server: S3Server) -> None:
    pytest.importorskip("dvc_s3", reason='DVC cannot reach S3: pip install -e ".[s3]"')
    first, second, dvc = repository(tmp_path / "first"), tmp_path / "second", (sys.executable, "-m", "dvc")
    run(first, server, "git", "init", "-q")
    run(first, server, *dvc, "init", "-q")
    run(first, server, *dvc, "remote", "add", "-d", "store", "s3://bucket/dvc")
    run(first, server, *dvc, "config", "core.analytics", "false")
    run(first, server, *dvc, "repro", TARGET)
    run(first, server, *dvc, "push", TARGET, "--with-deps")
    run(first, server, "git", "add", "-A")
    run(first, server, "git", "commit", "-q", "-m", "a run")

    run(tmp_path, server, "git", "clone", "-q", str(first), str(second))
    run(second, server, *dvc, "pull", TARGET, "--with-deps")
    assert hash_files(second / "data") == hash_files(first / "data")
    said = run(second, server, *dvc, "repro", TARGET)
    assert "Running stage" not in said and "didn't change" in said
    assert not (second / ".shards").exists()
