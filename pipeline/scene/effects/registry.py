"""The effects by name: every module of the package `kinds`, and of the folders that `extra_effects` adds to it."""

from __future__ import annotations

import contextlib
import functools
import importlib
import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path

from pipeline.scene.effects import kinds
from pipeline.scene.effects.kind import EffectKind


@functools.cache
def effect_kinds() -> dict[str, EffectKind]:
    """Name -> effect, sorted by name."""
    found = (importlib.import_module(f"{kinds.__name__}.{m.name}").EFFECT for m in pkgutil.iter_modules(kinds.__path__))
    return {kind.name: kind for kind in sorted(found, key=lambda k: k.name)}


def kind_of_scene_parameter(name: str) -> EffectKind | None:
    """The effect that is a number of the scene by another name."""
    return next((k for k in effect_kinds().values() if k.discovery.scene_parameter == name), None)


@contextlib.contextmanager
def extra_effects(folder: Path) -> Iterator[None]:
    """Within the context, each module of `folder` is an effect like those of `kinds` (docs/discovery.md).

    The registry is of this process: workers that are spawned do not see the folder.
    """
    before = set(sys.modules)
    kinds.__path__.append(str(folder))
    importlib.invalidate_caches()
    effect_kinds.cache_clear()
    try:
        yield
    finally:
        kinds.__path__.remove(str(folder))
        effect_kinds.cache_clear()
        for module in pkgutil.iter_modules([str(folder)]):
            name = f"{kinds.__name__}.{module.name}"
            if name in sys.modules and name not in before:
                del sys.modules[name]
                delattr(kinds, module.name)
