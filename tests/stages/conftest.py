"""Stages keep a loaded model by its path, and tests have the same paths in different folders."""

import sys

import pytest


@pytest.fixture(autouse=True)
def no_model_of_another_test() -> None:
    """Empty the caches of all stage modules before each test."""
    for name, module in list(sys.modules.items()):
        if name.startswith("stages."):
            for value in vars(module).values():
                if hasattr(value, "cache_clear"):
                    value.cache_clear()
