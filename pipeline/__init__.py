"""Video in, editable physics out.

    from pipeline import infer, masks, simulate, edit, discover, discover_clips, export

`infer` finds the scene that a clip shows, `masks` only the bodies that move in it, `simulate` runs a scene with
changes, `edit` shows the clip itself with changes, `discover` finds which physics a scene lacks, from measured motion,
and `discover_clips` the same from videos, `export` makes a web page of what was found. They are loaded when they are
first used: `import pipeline` alone loads nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.api.discover import discover
    from pipeline.api.discover_clips import discover_clips
    from pipeline.api.edit import edit
    from pipeline.api.export import export
    from pipeline.api.infer import infer
    from pipeline.api.masks import masks
    from pipeline.api.simulate import simulate

__all__ = ["discover", "discover_clips", "edit", "export", "infer", "masks", "simulate"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.api.{name}"), name)
