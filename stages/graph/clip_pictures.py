"""What the model is shown of a clip, and whether it is what a checkpoint was trained with."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.model.model_input import ModelInput, missing_input, read_input
from pipeline.model.shown import SeenBodies, SeenFrames, seen_clip

if TYPE_CHECKING:
    from pipeline.model.answering import Shown
    from pipeline.model.base import Base
    from pipeline.model.words_model import WordsModel

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


def shown_stages(kind: str, sees: str, words: bool) -> list[str]:
    """The stages whose shards have what the model is shown. words: whether it is a words model."""
    return ["render", "flow"] if words or sees == "bodies" else [picture_stage(kind)]


def shown_to(
    base: "Base | WordsModel", clips: Sequence[HasArrays], kind: str, sees: str, schedule: Schedule
) -> "Shown":
    """What the model sees of a clip, which is in the shards of `shown_stages`."""
    # imported here: it takes seconds
    from pipeline.model.patches import fit_layout
    from pipeline.model.question import question_about
    from pipeline.model.words_model import WordsModel

    if sees == "frame" and not isinstance(base, WordsModel):
        return fit_layout(pictures(clips[0], kind, schedule), base.layout)
    rendered, flow = clips
    seen = seen_of_clip(rendered, flow, kind, sees, schedule)
    if isinstance(base, WordsModel):
        return seen
    assert isinstance(seen, SeenBodies)
    return question_about(base, seen)


def seen_of_clip(
    rendered: HasArrays,
    flow: HasArrays,
    kind: str,
    sees: str,
    schedule: Schedule,
    worsen: Callable[[np.ndarray], np.ndarray] = lambda masks: masks,
) -> SeenBodies | SeenFrames:
    """The bodies or the frames of a clip. worsen: gives masks (P, H, W) the errors of a network."""
    first = schedule.pairs[:, 0]
    frames = rendered.array("rgb")[first] if kind == "rgb" else None
    return seen_clip(kind, sees, worsen(rendered.array("mask")[first]), flow.array("flow"), frames)


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
