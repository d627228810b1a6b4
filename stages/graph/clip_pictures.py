"""What the model is shown of a clip, and whether it is what a checkpoint was trained with."""

from typing import Protocol

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.model.model_input import ModelInput, missing_input, read_input

#: The parameters behind the fields of a checkpoint's record.
PARAMETERS = {
    "input": "model.input",
    "picture": "flow.picture",
    "flow_source": "flow.source",
    "flow_size": "flow.width, flow.height",
    "flow_iterations": "flow.iterations",
    "reasoning": "model.reasoning",
    "sees": "model.sees",
}


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


def check_input(checkpoint: str, shown: ModelInput, required: bool) -> None:
    """Raise ModelError where a checkpoint was trained with another input than the parameters make.

    Args:
        checkpoint: A folder, or a hub name.
        shown: What the parameters make of a clip where the model answers.
        required: Whether the checkpoint must have recorded its input.
    """
    trained = read_input(checkpoint)
    if trained is None:
        if required:
            raise missing_input(checkpoint)
        return
    for field, parameter in PARAMETERS.items():
        trained.check(field, getattr(shown, field), parameter, checkpoint)
