"""The words model ready for use: loading, saving, and its answers as texts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pipeline.clips.events import Event
from pipeline.errors import ModelError
from pipeline.model import decisions as d
from pipeline.model.checkpoint import LOADING_ERRORS, load_weights
from pipeline.model.deciding import decide
from pipeline.model.fields import NOTHING, OBJECT_FIELDS, SCENE_FIELDS, off_scale, scene_of
from pipeline.model.language.completion import MAX_OBJECTS, write_completion
from pipeline.model.model_input import ModelInput, read_input, write_input
from pipeline.model.sampling import Completed, Sampling
from pipeline.model.shown import SeenBodies, SeenFrames, most_seen, no_bodies
from pipeline.model.words_network import FRAMES, WordsNetwork
from pipeline.scene.scene import BASIC_SHAPES, Scene


@dataclass
class WordsModel:
    """A model ready for use.

    Attributes:
        model: The weights.
        input: How its input is made, as it was trained; None where that was not recorded.
        name: The folder that it was loaded from.
    """

    model: WordsNetwork
    input: ModelInput | None = None
    name: str = ""

    def save(self, folder: Path) -> None:
        """Weights (float16), configuration and input, as `load_words` reads them."""
        halves = {name: value.half() for name, value in self.model.state_dict().items()}
        self.model.save_pretrained(folder, state_dict=halves)
        if self.input is not None:
            write_input(folder, self.input)


def load_words(name: str, frames: int = FRAMES) -> WordsModel:
    """The model of a folder; frames: that will be shown of a clip. Raises `ModelError`."""
    if frames != FRAMES:
        raise ModelError(f"{name!r} was trained on {FRAMES} frames a clip; {frames} cannot be shown to it")
    try:
        network = load_weights(WordsNetwork, name, dtype=torch.float32)
    except LOADING_ERRORS as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise ModelError(f"{name!r} has no words model ({reason}); valid: models/words") from None
    return WordsModel(network.eval(), read_input(name), name)


@torch.no_grad()
def write_answers(model: WordsModel, seen: SeenBodies | SeenFrames, sampling: Sampling, seed: int) -> list[Completed]:
    """Completions of a clip, `sampling.samples` of them.

    Args:
        model: The model.
        seen: What it is shown. Of more than MAX_OBJECTS bodies, those that are seen longest count.
        sampling: How completions are drawn; temperature 0: the likeliest, with one sample.
        seed: Makes them repeatable.

    Raises:
        ModelError: Where there are no bodies.
    """
    if isinstance(seen, SeenBodies):
        seen = most_seen(seen, MAX_OBJECTS)
        if not len(seen.instances):
            raise no_bodies()
    prompt, places = prompt_of(model.model, seen)
    prior = seen.instances.shape_prior if isinstance(seen, SeenBodies) else None
    said, log_p = decide(model.model, prompt, places, isinstance(seen, SeenFrames), sampling, seed, prior)
    return [
        Completed(completion_of(one, sampling.reasoning, sampling.seconds), float(p), one)
        for one, p in zip(said, log_p, strict=True)
    ]


def prompt_of(network: WordsNetwork, seen: SeenBodies | SeenFrames) -> tuple[tuple[Tensor, Tensor], list[int]]:
    """The prompt of one clip with its rotary positions, and the places that its bodies have there."""
    if isinstance(seen, SeenFrames):
        frames = torch.from_numpy(np.ascontiguousarray(seen.frames))[None]
        return network.frame_prompt(frames, seen.colours), list(range(MAX_OBJECTS))
    places = list(range(len(seen.instances)))
    crops, where = torch.from_numpy(seen.crops)[None], torch.from_numpy(seen.instances.places)[None]
    return network.bodies_prompt(crops, seen.colours is not None, where, torch.tensor([places])), places


def completion_of(said: d.Said, reasoning: bool, seconds: float) -> str:
    """The text of an answer. Bodies that are none are left out, and the others numbered in their order."""
    scene = scene_said(said)
    return write_completion(scene, events_said(said, seconds) if reasoning else None, seconds)


def scene_said(said: d.Said) -> Scene:
    """The scene of an answer."""
    real = bodies_said(said)
    numbers = off_scale(torch.tensor(said.scene), SCENE_FIELDS).numpy()
    values = off_scale(torch.tensor(said.values), OBJECT_FIELDS).numpy()
    return scene_of(numbers, [BASIC_SHAPES[said.shapes[i]] for i in real], values[real])


def bodies_said(said: d.Said) -> list[int]:
    """Which places of the prompt an answer takes for bodies."""
    return [i for i, shape in enumerate(said.shapes) if shape != NOTHING]


def events_said(said: d.Said, seconds: float) -> list[Event]:
    """The events of an answer in order of time (s), bodies by their index in its scene."""
    number = {i: k for k, i in enumerate(bodies_said(said))}
    events = [
        Event(time * seconds, d.KINDS[kind], number[first], None if second is None else number[second])
        for time, kind, first, second in said.events
    ]
    return sorted(events, key=lambda e: e.time)
