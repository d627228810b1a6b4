"""What the model is shown of a clip, and whether it is what a checkpoint was trained with."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.errors import ParamsError
from pipeline.model.model_input import ModelInput, missing_input, read_input
from pipeline.model.shown import SeenBodies, SeenFrames, seen_clip

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


def shown_stages(kind: str, words: bool) -> list[str]:
    """The stages whose shards have what the model is shown. words: whether it is a words model."""
    return ["render", "flow"] if words else [picture_stage(kind)]


def seen_by_words(
    rendered: HasArrays,
    flow: HasArrays,
    kind: str,
    sees: str,
    schedule: Schedule,
    worsen: Callable[[np.ndarray], np.ndarray] = lambda masks: masks,
) -> SeenBodies | SeenFrames:
    """What the words model sees of a clip. worsen: gives masks (P, H, W) the errors of a network."""
    first = schedule.pairs[:, 0]
    frames = rendered.array("rgb")[first] if kind == "rgb" else None
    return seen_clip(kind, sees, worsen(rendered.array("mask")[first]), flow.array("flow"), frames)


def check_sees(base: str, sees: str, words: bool) -> None:
    """Raise ParamsError where the model cannot be shown bodies one by one. words: whether it is a words model."""
    if sees == "bodies" and not words:
        raise ParamsError(f"model.sees: bodies, but {base} is shown whole frames; valid: frame")


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
