"""The effects of mechanisms by name: every module of the package `kinds`."""

from __future__ import annotations

import functools
import importlib
import pkgutil

from pipeline.discovery.mechanisms import kinds
from pipeline.discovery.mechanisms.kind import MechanismEffect


@functools.cache
def mechanism_effects() -> dict[str, MechanismEffect]:
    """Name -> effect, sorted by name."""
    found = (importlib.import_module(f"{kinds.__name__}.{m.name}").EFFECT for m in pkgutil.iter_modules(kinds.__path__))
    return {kind.name: kind for kind in sorted(found, key=lambda k: k.name)}
