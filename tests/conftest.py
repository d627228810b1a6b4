"""Fixtures for all tests."""

import os
import secrets
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from s3_server import server

__all__ = ["server"]

_SEED = "DYNAMICS_TEST_SEED"
_seed_of_test: pytest.StashKey[int] = pytest.StashKey()


@pytest.fixture(scope="session")
def session_seed() -> int:
    """DYNAMICS_TEST_SEED, else the hash of the committed files: new with each commit, the same in every run of one."""
    if _SEED in os.environ:
        return int(os.environ[_SEED])
    ask = ["git", "rev-parse", "--verify", "--quiet", "HEAD^{tree}"]
    answer = subprocess.run(ask, cwd=Path(__file__).parent, capture_output=True, text=True)
    return int(answer.stdout[:8], 16) if answer.returncode == 0 else secrets.randbits(32)


@pytest.fixture
def rng(request: pytest.FixtureRequest, session_seed: int) -> np.random.Generator:
    """A generator with the seed of the session, which a failure prints."""
    request.node.stash[_seed_of_test] = session_seed
    return np.random.default_rng(session_seed)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report = yield
    if report.failed and _seed_of_test in item.stash:
        report.sections.append(("seed", f"{_SEED}={item.stash[_seed_of_test]} repeats this test"))
    return report
