"""Which pictures of a clip the model is shown."""

from typing import Protocol

import numpy as np

from pipeline.clips.schedule import Schedule


class HasArrays(Protocol):
    """A clip of an opened shard."""

    def array(self, name: str) -> np.ndarray: ...


def picture_stage(kind: str) -> str:
    """The stage whose shards have the pictures of model.input `flow` or `rgb`."""
    return {"flow": "flow", "rgb": "render"}[kind]


def pictures(clip: HasArrays, kind: str, schedule: Schedule) -> np.ndarray:
    """(P, H, W, 3) uint8: pictures of the flow, or the RGB frames at which it starts."""
    if kind == "flow":
        return clip.array("picture")
    return clip.array("rgb")[schedule.pairs[:, 0]]
