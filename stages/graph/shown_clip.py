"""What the model that answers is shown of a clip."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.model.shown import SeenBodies, SeenFrames, seen_clip
from stages.graph.clip_pictures import HasArrays, picture_stage, pictures

if TYPE_CHECKING:
    from pipeline.model.answering import Shown
    from pipeline.model.base import Base
    from pipeline.model.words_model import WordsModel


def shown_stages(kind: str, sees: str, words: bool) -> list[str]:
    """The stages whose shards have what the model is shown. words: whether it is a words model."""
    return ["render", "flow"] if words or sees == "bodies" else [picture_stage(kind)]


def shown_to(
    base: "Base | WordsModel", clips: Sequence[HasArrays], kind: str, sees: str, schedule: Schedule
) -> "Shown":
    """What the model sees of a clip, which is in the shards of `shown_stages`."""
    # imported here: it takes seconds
    from pipeline.model.answering import as_shown
    from pipeline.model.patches import fit_layout
    from pipeline.model.words_model import WordsModel

    if sees == "frame" and not isinstance(base, WordsModel):
        return fit_layout(pictures(clips[0], kind, schedule), base.layout)
    rendered, flow = clips
    return as_shown(base, seen_of_clip(rendered, flow, kind, sees, schedule))


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
