"""The effects by name: every module of `kinds`."""

from __future__ import annotations

import functools
import importlib
import pkgutil

from pipeline.scene.effects import kinds
from pipeline.scene.effects.kind import EffectKind


@functools.cache
def effect_kinds() -> dict[str, EffectKind]:
    """Name -> effect, sorted by name."""
    found = (importlib.import_module(f"{kinds.__name__}.{m.name}").EFFECT for m in pkgutil.iter_modules(kinds.__path__))
    return {kind.name: kind for kind in sorted(found, key=lambda k: k.name)}
