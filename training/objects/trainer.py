"""Training of the network that reads objects: its optimisers, averaged weights, and the examples in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from pipeline.objects.batch import Examples, Group, groups_of, loss_sums, mean_losses, mirrored, total
from pipeline.objects.network import ObjectsNetwork
from training.muon import Muon
from training.objects.shards import read_examples

AVERAGED = 8.0  # the averaged weights are those of about the last 1/8 of the steps


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

    def learn(self, groups: list[Group], share: float, rng: np.random.Generator) -> dict[str, float]:
        """One step on clips; share: of the peak learning rates. Returns mean losses."""
        for optimizer, peak in zip(self.optimizers, self.peaks, strict=True):
            for part in optimizer.param_groups:
                part["lr"] = share * peak
            optimizer.zero_grad(set_to_none=True)
        means = mean_losses(groups, [loss_sums(self.network, group, rng) for group in groups])
        total(means).backward()
        torch.nn.utils.clip_grad_norm_(self.rest, 3.0)
        for optimizer in self.optimizers:
            optimizer.step()
        self.step += 1
        kept = (1 - 1 / self.step) ** AVERAGED
        with torch.no_grad():
            for name, value in self.network.state_dict().items():
                self.averaged[name].mul_(kept).add_(value, alpha=1 - kept)
        return {name: float(value.detach()) for name, value in means.items()}

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
