"""Answers of the model that reads objects, as the text that a language model would write: `<think>` and `<answer>`.

The network gives the scene. The events of `<think>` are those of this scene, simulated: what the answer says happens.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import event_areas
from pipeline.errors import ModelError, SimulationError
from pipeline.language.completion import MAX_OBJECTS, write_completion
from pipeline.language.events import DEFAULT_THRESHOLDS, Event, find_events
from pipeline.model.model_input import ModelInput, read_input, write_input
from pipeline.model.sampling import Completed, Sampling
from pipeline.objects.checkpoint import load_objects_network, save_objects
from pipeline.objects.fields import NOTHING, OBJECT_FIELDS, SCENE_FIELDS, off_scale, scene_of
from pipeline.objects.instances import Instances
from pipeline.objects.network import ObjectsNetwork, Read
from pipeline.objects.number_chain import greedy, sampler
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import BASIC_SHAPES, Scene


@dataclass
class ObjectsModel:
    """A model ready for use.

    Attributes:
        model: The weights.
        input: How its input is made, as it was trained; None where that was not recorded.
        name: The folder that it was loaded from.
    """

    model: ObjectsNetwork
    input: ModelInput | None = None
    name: str = ""

    def save(self, folder: Path) -> None:
        """Weights, configuration and input, as `load_objects` reads them."""
        save_objects(folder, self.model)
        if self.input is not None:
            write_input(folder, self.input)


def load_objects(name: str, frames: int = 10) -> ObjectsModel:
    """The model of a folder; frames: that will be shown of a clip. Raises `ModelError`."""
    network = load_objects_network(Path(name))
    if network.size.frames != frames:
        raise ModelError(f"{name!r} was trained on {network.size.frames} frames a clip; {frames} cannot be shown to it")
    return ObjectsModel(network, read_input(name), name)


@torch.no_grad()
def write_answers(model: ObjectsModel, instances: Instances, sampling: Sampling, seed: int) -> list[Completed]:
    """Completions of a clip, `sampling.samples` of them.

    Args:
        model: The model.
        instances: What it sees. Of more than MAX_OBJECTS, those that are seen longest count.
        sampling: How completions are drawn; temperature 0: the likeliest, with one sample.
        seed: Makes them repeatable.

    Raises:
        ModelError: Where there are no instances.
    """
    scenes, log_probability = write_scenes(model.model, instances, sampling, seed)
    return [
        Completed(completion_of(scene, sampling.reasoning, sampling.seconds), float(p))
        for scene, p in zip(scenes, log_probability, strict=True)
    ]


@torch.no_grad()
def write_scenes(
    network: ObjectsNetwork, instances: Instances, sampling: Sampling, seed: int
) -> tuple[list[Scene], Tensor]:
    """The scenes of `write_answers`, and their log-probabilities, nats; the arguments are as there."""
    shown = _most_seen(instances)
    if not len(shown):
        raise ModelError("the model reads bodies one by one, and the masks of this clip have none")
    generator = torch.Generator().manual_seed(seed)
    draw = sampler(sampling.middle, generator) if sampling.temperature else greedy
    each, bodies = sampling.samples, len(shown)
    read = network.read(torch.from_numpy(shown.crops)[None], torch.from_numpy(shown.places)[None])
    read = Read(*(part.expand(each, *part.shape[1:]) for part in (read.bodies, read.scene, read.frames)))
    numbers, total = network.write_scene(read, draw)
    known = network.known(read, numbers).flatten(0, 1)
    chances = network.bodies.choose(known).softmax(-1)
    if shown.shape_prior is not None:
        chances = _with_prior(chances.view(each, bodies, -1), shown.shape_prior).flatten(0, 1)
    shapes = _shapes(chances, sampling, generator).view(each, bodies)
    likely = chances[:, :NOTHING].view(each, bodies, NOTHING).max(-1)
    nobody = (shapes == NOTHING).all(1)  # an answer has a body
    best = likely.values.argmax(1)
    shapes[nobody, best[nobody]] = likely.indices[nobody, best[nobody]]
    total = total + chances.gather(1, shapes.flatten()[:, None]).log().view(each, bodies).sum(1)
    real = shapes != NOTHING
    values, log_p = network.write_bodies(known, shapes.clamp(max=NOTHING - 1).flatten(), draw)
    total = total + (log_p.view(each, bodies) * real).sum(1)
    values = off_scale(values, OBJECT_FIELDS).view(each, bodies, -1)
    numbers = off_scale(numbers, SCENE_FIELDS)
    scenes = [
        scene_of(numbers[k].numpy(), [BASIC_SHAPES[s] for s in shapes[k][real[k]]], values[k][real[k]].numpy())
        for k in range(each)
    ]
    return scenes, total


def _most_seen(instances: Instances) -> Instances:
    """At most MAX_OBJECTS instances, in their order."""
    seen = instances.places[..., 0].sum(1)
    kept = np.sort(np.argsort(-seen, kind="stable")[:MAX_OBJECTS])
    shape_prior = None if instances.shape_prior is None else instances.shape_prior[kept]
    return Instances(instances.crops[kept], instances.places[kept], instances.ids[kept], shape_prior)


def _with_prior(chances: Tensor, shape_prior: np.ndarray) -> Tensor:
    """Chances (K, N, 4) of shapes and of NOTHING, those of shapes weighted by shape_prior (N, 3); NOTHING's stays."""
    real = chances[..., :NOTHING]
    both = real * torch.from_numpy(shape_prior).to(real)
    both = both * (real.sum(-1, keepdim=True) / both.sum(-1, keepdim=True))
    return torch.cat([both, chances[..., NOTHING:]], -1)


def _shapes(chances: Tensor, sampling: Sampling, generator: torch.Generator) -> Tensor:
    """Shapes (M,) by their probabilities (M, 4): the likeliest, or of the nucleus."""
    if not sampling.temperature:
        return chances.argmax(-1)
    p = chances ** (1 / sampling.temperature)
    ordered, order = (p / p.sum(-1, keepdim=True)).sort(-1, descending=True)
    ordered = ordered * (ordered.cumsum(-1) - ordered < sampling.top_p)
    return order.gather(1, torch.multinomial(ordered, 1, generator=generator))[:, 0]


def completion_of(scene: Scene, reasoning: bool, seconds: float) -> str:
    """The text of an answer; its events are those of the scene as it is simulated."""
    return write_completion(scene, _events(scene, seconds) if reasoning else None, seconds)


def _events(scene: Scene, seconds: float) -> list[Event]:
    """What happens in a scene; nothing where it cannot be simulated."""
    schedule = Schedule(seconds=seconds)
    try:
        trace = simulate(scene, seconds)
    except SimulationError:
        return []
    areas = event_areas(scene, trace, schedule)
    return find_events(trace, scene.shapes, areas, schedule.frame_steps, DEFAULT_THRESHOLDS)
