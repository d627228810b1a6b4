"""Train the segmentation network on clips that `training.segmentation.generate` made.

    python -m training.segmentation.train DATA WORK --minutes 90 [--threads 1] [--start FOLDER]

Clips that are added to DATA while it runs are used too. The learning rate falls to nothing over --minutes of training;
a run that was stopped goes on from WORK/checkpoint.safetensors. WORK/weights has the moving average of the weights in
the shipped form, WORK/log.csv the losses. --start: a folder of weights to begin from.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import cv2
import numpy as np
import torch

from pipeline.bodies.networks.network import SegmentationNetwork, load_network, save_network
from pipeline.csv_rows import append_row
from training.checkpoint import has_checkpoint, load_checkpoint, save_checkpoint
from training.segmentation.clip import TrainingClip
from training.segmentation.kept_arrays import load_arrays
from training.segmentation.loss import PARTS, segmentation_loss
from training.segmentation.samples import Sample, batched, draw_sample, with_clear_plate

CROP, CROPS, WHOLE = (144, 112), 12, 4  # px; samples to a step of windows, and of whole frames
WHOLE_SHARE = 0.5  # of the steps
CLEAR_PLATES = 0.5  # share of clips whose background is without the bodies, as in the second look of `find_bodies`
POOL, RENEWED = 500, 1  # clips in memory, and how many are replaced in each step
LISTED_EVERY = 20  # clips loaded, after which those that were added to the folder are looked for
WARM_UP = 100  # steps
AVERAGE = 0.998  # of the weights' moving average


class Clips:
    """Clips of a folder, some of them in memory, the oldest of which gives way to another at each `renew`."""

    def __init__(self, folder: Path, rng: np.random.Generator) -> None:
        self.folder, self.rng = folder, rng
        self.kept: list[TrainingClip] = []
        self.paths: list[Path] = []
        self.queue: list[Path] = []
        self.loaded = 0

    def renew(self, count: int) -> None:
        for _ in range(count):
            if self.loaded % LISTED_EVERY == 0:
                known, self.paths = set(self.paths), sorted(self.folder.glob("*.npz"))
                if known:  # the last of the queue is taken next
                    self.queue += [p for p in self.paths if p not in known]
            if not self.queue:
                self.queue = [self.paths[i] for i in self.rng.permutation(len(self.paths))]
            self.loaded += 1
            clip = load_arrays(self.queue.pop(), TrainingClip)
            if self.rng.random() < CLEAR_PLATES:
                clip = with_clear_plate(self.rng, clip)
            if len(self.kept) < POOL:
                self.kept.append(clip)
            else:
                self.kept[int(self.rng.integers(POOL))] = clip

    def samples(self, count: int, size: tuple[int, int] | None) -> list[Sample]:
        """Frames in windows of `size`; None: whole frames, all of one shape."""
        some = self.kept
        if size is None:
            shape = some[int(self.rng.integers(len(some)))].mask.shape[1:]
            some = [c for c in some if c.mask.shape[1:] == shape]
        clips = [some[i] for i in self.rng.integers(len(some), size=count)]
        return [draw_sample(self.rng, c, int(self.rng.integers(len(c.frames))), size, augment=True) for c in clips]


def learning_rate(step: int, progress: float) -> float:
    """A share of the peak: linear warm-up, then a cosine down to 0 over the training's progress from 0 to 1."""
    return min(1.0, (step + 1) / WARM_UP) * 0.5 * (1 + math.cos(math.pi * min(progress, 1.0)))


def average_weights(average: dict[str, torch.Tensor], network: torch.nn.Module, step: int) -> None:
    """Move `average` a little towards the network's weights, in place."""
    keep = min(AVERAGE, step / (step + 10))
    with torch.no_grad():
        for name, value in network.state_dict().items():
            if value.is_floating_point():
                average[name].lerp_(value, 1 - keep)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--minutes", type=float, default=90)
    parser.add_argument("--rate", type=float, default=2.5e-3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--start", type=Path)
    parser.add_argument("--bfloat16", action="store_true", help="twice as fast where the processor has AMX")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    cv2.setNumThreads(1)
    torch.manual_seed(arguments.seed)
    arguments.work.mkdir(parents=True, exist_ok=True)
    network = load_network(arguments.start) if arguments.start else SegmentationNetwork()
    network.train().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.AdamW(network.parameters(), arguments.rate, weight_decay=1e-2)
    step, spent, shown = 0, 0.0, 0
    average = {k: v.detach().clone() for k, v in network.state_dict().items()}
    checkpoint = arguments.work / "checkpoint.safetensors"
    if has_checkpoint(checkpoint):
        saved = load_checkpoint(checkpoint)
        network.load_state_dict(saved["network"])
        optimiser.load_state_dict(saved["optimiser"])
        average, step, spent, shown = saved["average"], saved["step"], saved["spent"], saved["shown"]
    rng = np.random.default_rng(np.random.SeedSequence((arguments.seed, step)))
    clips = Clips(arguments.data, rng)
    clips.renew(min(POOL, len(list(arguments.data.glob("*.npz")))))
    print(
        f"{len(clips.paths)} clips, {sum(p.numel() for p in network.parameters())} parameters, step {step}", flush=True
    )
    mean: torch.Tensor | None = None
    before, total = time.monotonic(), 60 * arguments.minutes

    def save() -> None:
        state = {
            "network": network.state_dict(),
            "optimiser": optimiser.state_dict(),
            "average": average,
            "step": step,
            "spent": spent,
            "shown": shown,
        }
        save_checkpoint(checkpoint, state)
        config = {"steps": step, "frames_shown": shown, "clips": len(clips.paths), "minutes": round(spent / 60, 1)}
        shadow = SegmentationNetwork(network.channels)  # type: ignore[arg-type]
        shadow.load_state_dict(average)
        save_network(shadow, arguments.work / "weights", config)

    while spent < total:
        for group in optimiser.param_groups:
            group["lr"] = arguments.rate * learning_rate(step, spent / total)
        whole = rng.random() < WHOLE_SHARE
        count = WHOLE if whole else CROPS
        batch = batched(clips.samples(count, None if whole else CROP))
        with torch.autocast("cpu", torch.bfloat16, enabled=arguments.bfloat16):
            loss, parts = segmentation_loss(network, batch)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        average_weights(average, network, step)
        clips.renew(RENEWED)
        step, shown = step + 1, shown + count
        mean = parts if mean is None else 0.98 * mean + 0.02 * parts
        now = time.monotonic()
        spent, before = spent + now - before, now
        if step % 50 == 0:
            row = {
                "step": step,
                "minutes": round(spent / 60, 2),
                "clips": len(clips.paths),
                **{k: round(float(v), 4) for k, v in zip(PARTS, mean, strict=True)},
            }
            print(row, flush=True)
            append_row(arguments.work / "log.csv", row)
        if step % 250 == 0:
            save()
    save()
    print(f"finished: {step} steps, {shown} samples, {spent / 60:.1f} minutes", flush=True)


if __name__ == "__main__":
    main()
