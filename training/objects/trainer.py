"""Training of the network that reads objects: batches, mirrored clips, losses, optimisers, averaged weights."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from pipeline.language.completion import MAX_OBJECTS
from pipeline.objects.fields import MIRRORED, NOTHING, OBJECT_FIELDS
from pipeline.objects.instances import WIDTH
from pipeline.objects.network import ObjectsNetwork
from training.muon import Muon
from training.objects.shards import Examples, read_examples

SHAPE_WEIGHT, FRAME_WEIGHT = 2.0, 0.3
MOTION_SCALE = torch.tensor([0.5] * 3 + [0.8] * 3 + [4.0] * 3)  # m, m/s, rad/s that count as 1 in the loss
MOTION_MIRRORED = (0, 3, 7, 8)  # x of position and velocity, y and z of spin
AVERAGED = 8.0  # the averaged weights are those of about the last 1/8 of the steps

Group = dict[str, Tensor]


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


class Trainer:
    """The network with its optimisers.

    Args:
        network: To train.
        rate: Peak learning rate of AdamW.
        muon_rate: Of Muon, for the hidden matrices.
    """

    def __init__(self, network: ObjectsNetwork, rate: float, muon_rate: float) -> None:
        self.network, self.step = network, 0
        inner = ("blocks.", "crop.", "place.", ".up.", ".down.")
        hidden = [p for name, p in network.named_parameters() if p.ndim >= 2 and any(part in name for part in inner)]
        chosen = {id(p) for p in hidden}
        rest = [p for p in network.parameters() if id(p) not in chosen]
        self.optimizers: list[torch.optim.Optimizer] = [
            torch.optim.AdamW(rest, rate, betas=(0.9, 0.98), weight_decay=0.01),
            Muon(hidden, muon_rate, weight_decay=0.01),
        ]
        self.peaks = (rate, muon_rate)
        self.rest = rest
        self.averaged = {k: v.detach().clone() for k, v in network.state_dict().items()}
        self.weights = torch.tensor([f.weight for f in OBJECT_FIELDS])

    def losses(self, group: Group, rng: np.random.Generator) -> dict[str, Tensor]:
        """Sums of the losses of a group, nats: scene, shape, numbers and frames."""
        slots = random_slots(*group["shapes"].shape, rng)
        keys = ("crops", "places", "scene", "shapes", "values")
        of_scene, of_shape, each, read = self.network.losses(*(group[k] for k in keys), slots)
        labels = self.network.frame_labels(read.frames).flatten(0, 1)
        shapes, here = group["shapes"].flatten(), group["places"].flatten(0, 1)[..., 0] > 0
        kinds = labels[..., : NOTHING + 1]
        frames = here.shape[1]
        kind = functional.cross_entropy(kinds.flatten(0, 1), shapes.repeat_interleave(frames), reduction="none")
        off = labels[..., NOTHING + 1 :] - group["motion"].flatten(0, 1) / MOTION_SCALE
        moved = functional.smooth_l1_loss(off, torch.zeros_like(off), reduction="none").sum(-1)
        known = here & (shapes != NOTHING)[:, None]
        return {
            "scene": of_scene.sum(),
            "shape": of_shape.sum(),
            "numbers": (each * self.weights).sum(),
            "frames": (kind.view_as(here) * here + moved * known).sum() / frames,
        }

    def learn(self, groups: list[Group], share: float, rng: np.random.Generator) -> dict[str, float]:
        """One step on clips; share: of the peak learning rates. Returns mean losses."""
        for optimizer, peak in zip(self.optimizers, self.peaks, strict=True):
            for part in optimizer.param_groups:
                part["lr"] = share * peak
            optimizer.zero_grad(set_to_none=True)
        clips = sum(len(g["scene"]) for g in groups)
        bodies = sum(g["shapes"].numel() for g in groups)
        means: dict[str, float] = {}
        for group in groups:
            sums = self.losses(group, rng)
            of_bodies = SHAPE_WEIGHT * sums["shape"] + sums["numbers"] + FRAME_WEIGHT * sums["frames"]
            (sums["scene"] / clips + of_bodies / bodies).backward()
            for name, value in sums.items():
                means[name] = means.get(name, 0.0) + float(value.detach()) / (clips if name == "scene" else bodies)
        torch.nn.utils.clip_grad_norm_(self.rest, 3.0)
        for optimizer in self.optimizers:
            optimizer.step()
        self.step += 1
        kept = (1 - 1 / self.step) ** AVERAGED
        with torch.no_grad():
            for name, value in self.network.state_dict().items():
                self.averaged[name].mul_(kept).add_(value, alpha=1 - kept)
        return means

    def state(self) -> dict:
        """What a training continues from."""
        return {
            "network": self.network.state_dict(),
            "averaged": self.averaged,
            "optimizers": [o.state_dict() for o in self.optimizers],
            "step": self.step,
        }

    def load(self, state: dict) -> None:
        """Continue from `state`."""
        self.network.load_state_dict(state["network"])
        self.averaged, self.step = state["averaged"], state["step"]
        for optimizer, stored in zip(self.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(stored)


class Pool:
    """The examples of some files in memory, with the oldest exchanged for the next ones as they are used.

    Args:
        folder: Of the files, which may grow meanwhile.
        files: At most so many in memory.
        visits: Of a file's clips before another is read in its place, where there is one.
    """

    def __init__(self, folder: Path, files: int, visits: float) -> None:
        self.folder, self.files, self.visits = folder, files, visits
        self.loaded: dict[Path, Examples] = {}
        self.used: dict[Path, float] = {}
        self.times_read: dict[Path, int] = {}

    def refresh(self) -> None:
        """Read another file where one has been used enough, or there is room."""
        there = sorted(self.folder.glob("*.parquet"))
        waiting = sorted((p for p in there if p not in self.loaded), key=lambda p: (self.times_read.get(p, 0), p))
        if not waiting:
            return
        if len(self.loaded) >= self.files:
            worn = max(self.loaded, key=lambda p: self.used[p])
            if self.used[worn] < self.visits:
                return
            del self.loaded[worn], self.used[worn]
        path = waiting[0]
        self.loaded[path], self.used[path] = read_examples(path), 0.0
        self.times_read[path] = self.times_read.get(path, 0) + 1

    def draw(self, clips: int, rng: np.random.Generator) -> list[Group]:
        """Clips of a file drawn at random, every second batch in a mirror."""
        paths = list(self.loaded)
        path = paths[rng.integers(len(paths))]
        examples = self.loaded[path]
        self.used[path] += clips / len(examples.count)
        chosen = rng.choice(len(examples.count), clips, replace=False)
        turned = rng.random() < 0.5
        return [mirrored(g) if turned else g for g in groups_of(examples, chosen)]
