"""Fixtures for all tests."""

import os
import secrets
from collections.abc import Iterator

import numpy as np
import pytest
from s3_server import server

__all__ = ["server"]

_SEED = "DYNAMICS_TEST_SEED"
_seed_of_test: pytest.StashKey[int] = pytest.StashKey()


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator with a fresh seed each run; DYNAMICS_TEST_SEED repeats one, and a failure prints it."""
    seed = int(os.environ.get(_SEED, secrets.randbits(32)))
    request.node.stash[_seed_of_test] = seed
    return np.random.default_rng(seed)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report = yield
    if report.failed and _seed_of_test in item.stash:
        report.sections.append(("seed", f"{_SEED}={item.stash[_seed_of_test]} repeats this test"))
    return report
