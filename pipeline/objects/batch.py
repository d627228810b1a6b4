"""Batches of examples, and the loss of the network that reads objects on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from pipeline.language.completion import MAX_OBJECTS
from pipeline.objects.example import Example
from pipeline.objects.fields import MIRRORED, NOTHING, OBJECT_FIELDS
from pipeline.objects.instances import WIDTH
from pipeline.objects.network import ObjectsNetwork

SHAPE_WEIGHT, FRAME_WEIGHT = 2.0, 0.3
WEIGHTS = torch.tensor([f.weight for f in OBJECT_FIELDS])
MOTION_SCALE = torch.tensor([0.5] * 3 + [0.8] * 3 + [4.0] * 3)  # m, m/s, rad/s that count as 1 in the loss
MOTION_MIRRORED = (0, 3, 7, 8)  # x of position and velocity, y and z of spin
#: Arrays of an example.
ARRAYS = ("crops", "places", "shapes", "values", "motion")

Group = dict[str, Tensor]


@dataclass(frozen=True)
class Examples:
    """Many clips, their instances one after another.

    Attributes:
        scene: (C, 4) numbers of the scenes.
        count: (C,) instances of each clip.
        arrays: By ARRAYS, over all instances.
    """

    scene: np.ndarray
    count: np.ndarray
    arrays: dict[str, np.ndarray]


def arrays_of(example: Example) -> dict[str, np.ndarray]:
    """The arrays of a clip, by ARRAYS."""
    seen = example.instances
    return dict(zip(ARRAYS, (seen.crops, seen.places, example.shapes, example.values, example.motion), strict=True))


def joined(examples: Sequence[Example]) -> Examples:
    """The examples one after another."""
    each = [arrays_of(e) for e in examples]
    arrays = {name: np.concatenate([a[name] for a in each]) for name in ARRAYS}
    return Examples(np.stack([e.scene for e in examples]), np.array([len(e.instances) for e in examples]), arrays)


def groups_of(examples: Examples, clips: np.ndarray) -> Iterator[Group]:
    """The clips as tensors, those with equally many instances together; clips without any are left out."""
    start = np.concatenate([[0], np.cumsum(examples.count)])
    for count in np.unique(examples.count[clips]):
        if not 0 < count <= MAX_OBJECTS:
            continue
        some = clips[examples.count[clips] == count]
        rows = start[some][:, None] + np.arange(count)
        group = {name: torch.from_numpy(array[rows]) for name, array in examples.arrays.items()}
        group["shapes"] = group["shapes"].long()
        yield {**group, "scene": torch.from_numpy(examples.scene[some])}


def mirrored(group: Group) -> Group:
    """The clips in a mirror, right and left changed."""
    crops, places = group["crops"].flip(-1).clone(), group["places"].clone()
    crops[..., 2, :, :] = -crops[..., 2, :, :]
    here = places[..., 0] > 0
    left, right = places[..., 1].clone(), places[..., 2].clone()
    places[..., 1], places[..., 2] = torch.where(here, WIDTH - right, left), torch.where(here, WIDTH - left, right)
    places[..., 5] = torch.where(here, WIDTH - places[..., 5], places[..., 5])
    places[..., 8] = -places[..., 8]
    places[..., [10, 11]] = places[..., [11, 10]]
    values, motion = group["values"].clone(), group["motion"].clone()
    values[..., list(MIRRORED)] *= -1
    motion[..., list(MOTION_MIRRORED)] *= -1
    return {**group, "crops": crops, "places": places, "values": values, "motion": motion}


def random_slots(clips: int, bodies: int, rng: np.random.Generator) -> Tensor:
    """(clips, bodies) different marks of the bodies of each clip."""
    return torch.from_numpy(np.stack([rng.permutation(MAX_OBJECTS)[:bodies] for _ in range(clips)]))


def loss_sums(network: ObjectsNetwork, group: Group, rng: np.random.Generator) -> dict[str, Tensor]:
    """Sums of the losses of a group, nats: scene, shape, numbers and frames."""
    slots = random_slots(len(group["shapes"]), group["shapes"].shape[1], rng)
    keys = ("crops", "places", "scene", "shapes", "values")
    crops, places, scene, shapes, values = (group[k] for k in keys)
    of_scene, of_shape, each, read = network.losses(crops, places, scene, shapes, values, slots)
    labels = network.frame_labels(read.frames).flatten(0, 1)
    shapes, here = shapes.flatten(), places.flatten(0, 1)[..., 0] > 0
    kinds = labels[..., : NOTHING + 1]
    frames = here.shape[1]
    kind = functional.cross_entropy(kinds.flatten(0, 1), shapes.repeat_interleave(frames), reduction="none")
    off = labels[..., NOTHING + 1 :] - group["motion"].flatten(0, 1) / MOTION_SCALE
    moved = functional.smooth_l1_loss(off, torch.zeros_like(off), reduction="none").sum(-1)
    known = here & (shapes != NOTHING)[:, None]
    return {
        "scene": of_scene.sum(),
        "shape": of_shape.sum(),
        "numbers": (each * WEIGHTS).sum(),
        "frames": (kind.view_as(here) * here + moved * known).sum() / frames,
    }


def mean_losses(groups: Sequence[Group], sums: Sequence[dict[str, Tensor]]) -> dict[str, Tensor]:
    """Of the sums of each group the means, of `scene` over clips and else over instances."""
    clips = sum(len(g["scene"]) for g in groups)
    bodies = sum(g["shapes"].numel() for g in groups)
    names = sums[0]
    return {name: torch.stack([s[name] for s in sums]).sum() / (clips if name == "scene" else bodies) for name in names}


def total(means: dict[str, Tensor]) -> Tensor:
    """The loss that is lowered."""
    return means["scene"] + SHAPE_WEIGHT * means["shape"] + means["numbers"] + FRAME_WEIGHT * means["frames"]
