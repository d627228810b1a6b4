"""Trains the words model on examples that workers write beside it, for a given time.

    python -m training.words.trainer EXAMPLES OUT --seconds 700 [--device cuda] [--clips 640] [--start models/words]

EXAMPLES is the folder of `training.words.examples`; files are read once and removed. EXAMPLES/held has those on which
the model is measured. OUT gets log.jsonl and, every minute, weights.pt (averaged, float16).
"""

from __future__ import annotations

import argparse
import json
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional
from transformers.models.qwen2_5_vl.modeling_qwen2_5_vl import Qwen2_5_VLRMSNorm

from pipeline.model import decisions as d
from pipeline.model.words_example import chosen
from pipeline.model.words_loss import MIX, means
from pipeline.model.words_model import load_words
from pipeline.model.words_network import WordsConfig, WordsNetwork
from training.muon import Muon

#: Shares of the steps.
SHARES = {"flow": 0.62, "rgb": 0.17, "frame_flow": 0.14, "frame_rgb": 0.07}
#: Examples that are kept of each kind, in GiB of a device with plenty and without.
ROOM_GIB = {"cuda": {"flow": 24.0, "rgb": 12.0, "frame_flow": 10.0, "frame_rgb": 8.0}}
ROOM_GIB["cpu"] = {kind: room / 20 for kind, room in ROOM_GIB["cuda"].items()}
LONGEST = 132  # decisions of the longest answer that is kept, and 20 more for each body beyond four
WARM_UP, CLIP_NORM = 60, 3.0


class Ring:
    """The latest examples of one kind and number of bodies, on the device."""

    def __init__(self, kind: str, n: int, device: torch.device) -> None:
        self.kind, self.n, self.device = kind, n, device
        self.arrays: dict[str, Tensor] = {}
        self.written, self.room = 0, 0

    def __len__(self) -> int:
        return min(self.written, self.room)

    def add(self, rows: dict[str, np.ndarray]) -> None:
        count = len(rows["ask"])
        if not self.arrays:
            shapes = {k: self._shape(k, v) for k, v in rows.items()}
            size = sum(int(np.prod(shapes[k])) * v.itemsize for k, v in rows.items())
            share = {0: 1.0, 1: 0.12, 2: 0.26, 3: 0.3, 4: 0.28}.get(self.n, 0.04)
            self.room = max(256, int(share * ROOM_GIB[self.device.type][self.kind] * 2**30 / size))
            for k, v in rows.items():
                kind = torch.from_numpy(v[:0]).dtype
                shape = (self.room, *shapes[k])
                self.arrays[k] = torch.full(shape, d.FILL.get(k, 0), dtype=kind, device=self.device)
        at = torch.arange(self.written, self.written + count, device=self.device) % self.room
        for k, v in rows.items():
            new = torch.from_numpy(v).to(self.device)
            if k in d.ANSWER_TYPES:
                length = self.arrays[k].shape[2]
                behind = max(length - new.shape[2], 0)
                new = functional.pad(new[:, :, :length], (0, behind), value=d.FILL.get(k, 0))
            self.arrays[k][at] = new
        if self.device.type == "cuda":
            torch.cuda.current_stream().synchronize()
        self.written += count

    def _shape(self, name: str, values: np.ndarray) -> tuple[int, ...]:
        if name not in d.ANSWER_TYPES:
            return values.shape[1:]
        return (values.shape[1], LONGEST + 20 * max(self.n - 4, 0))

    def draw(self, count: int, rng: np.random.Generator) -> dict[str, Tensor]:
        rows = torch.from_numpy(rng.integers(0, len(self), count)).to(self.device)
        which = torch.from_numpy(rng.integers(0, self.arrays["ask"].shape[1], count)).to(self.device)
        return chosen(self.arrays, rows, which)


class Pool:
    """Rings by kind and number of bodies, filled from files."""

    def __init__(self, folder: Path, device: torch.device, shares: dict[str, float], keep: bool = False) -> None:
        self.folder, self.device, self.shares, self.keep = folder, device, shares, keep
        self.read: set[Path] = set()
        self.rings: dict[tuple[str, int], Ring] = {}
        self.made = 0
        self.stream = torch.cuda.Stream() if device.type == "cuda" else None

    def refresh(self, most: int = 20) -> int:
        paths = [p for p in sorted(self.folder.glob("[0-9]*.npz")) if p not in self.read][:most]
        for path in paths:
            with np.load(path) as stored:
                arrays = {k: stored[k] for k in stored.files}
            if self.keep:
                self.read.add(path)
            else:
                path.unlink()
            if self.stream is None:
                self.add(arrays)
            else:
                with torch.cuda.stream(self.stream):
                    self.add(arrays)
        return len(paths)

    def add(self, arrays: dict[str, np.ndarray]) -> None:
        for key in sorted({k.rsplit(".", 1)[0] for k in arrays}):
            kind, n = key.split(".")
            rows = {k.rsplit(".", 1)[1]: v for k, v in arrays.items() if k.startswith(key + ".")}
            self.rings.setdefault((kind, int(n)), Ring(kind, int(n), self.device)).add(rows)
            self.made += len(rows["ask"])

    def ring(self, rng: np.random.Generator) -> Ring:
        """A ring of a kind drawn by the shares, and of a number of bodies by how many bodies there are."""
        kinds = [k for k in self.shares if any(kind == k for kind, _ in self.rings)]
        share = np.array([self.shares[k] for k in kinds])
        kind = kinds[rng.choice(len(kinds), p=share / share.sum())]
        rings = [r for (k, _), r in list(self.rings.items()) if k == kind and len(r)]
        weight = np.array([r.written * max(r.n, 1) for r in rings], float)
        return rings[rng.choice(len(rings), p=weight / weight.sum())]


def fast_norms(model: nn.Module) -> None:
    """PyTorch's own RMS norm in place of the one in several operations."""
    for m in model.modules():
        if isinstance(m, Qwen2_5_VLRMSNorm):
            m.forward = partial(_rms_norm, m)  # type: ignore[method-assign]


def _rms_norm(norm: Qwen2_5_VLRMSNorm, x: Tensor) -> Tensor:
    return functional.rms_norm(x, (x.shape[-1],), norm.weight.to(x.dtype), norm.variance_epsilon)


INNER = ("language_model.layers.", "visual.blocks.", "visual.merger.mlp")


def optimisers(model: nn.Module, rate: float, muon: float, fused: bool) -> list[torch.optim.Optimizer]:
    """Muon for the hidden matrices, AdamW for the rest."""
    named = list(model.named_parameters())
    hidden = [p for name, p in named if p.ndim == 2 and (any(s in name for s in INNER) or name.startswith("place."))]
    ids = {id(p) for p in hidden}
    rest = [p for _, p in named if id(p) not in ids]
    return [
        torch.optim.AdamW(rest, rate, betas=(0.9, 0.97), weight_decay=0.02, fused=fused),
        Muon(hidden, muon, weight_decay=0.02),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seconds", type=float, required=True, help="on a CPU: of the processor, not of the clock")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--clips", type=int, default=640, help="of about two bodies, in a step")
    parser.add_argument("--frames", type=int, default=224, help="clips in a step of whole frames")
    parser.add_argument("--rate", type=float, default=1.5e-3)
    parser.add_argument("--muon", type=float, default=0.012)
    parser.add_argument("--decay", type=float, default=0.45, help="share of the time in which the rate falls to 0")
    parser.add_argument("--start", type=Path, help="to start from: a folder as models/words, or a weights.pt")
    parser.add_argument("--first", type=int, default=6, help="files to wait for at the beginning")
    parser.add_argument("--shares", type=json.loads, default=SHARES, help="JSON of the kinds' shares of the steps")
    parser.add_argument("--fresh", type=float, default=1e9, help="views read, at most, for each that is seen")
    parser.add_argument("--size", type=json.loads, default={}, help="JSON of WordsConfig")
    asked = parser.parse_args()
    device = torch.device(asked.device)
    cuda = device.type == "cuda"
    if cuda:
        torch.backends.cuda.enable_cudnn_sdp(False)
        torch.set_float32_matmul_precision("high")
    torch.manual_seed(0)
    asked.out.mkdir(parents=True, exist_ok=True)
    model = WordsNetwork(WordsConfig(**asked.size))
    model.to(device)  # type: ignore[arg-type]
    fast_norms(model)
    if asked.start:
        if asked.start.is_dir():
            weights = load_words(str(asked.start)).model.state_dict()
        else:
            weights = torch.load(asked.start, map_location=device)
        model.load_state_dict({k: v.float() for k, v in weights.items()})
    print("parameters", round(sum(p.numel() for p in model.parameters()) / 1e6, 2), "million", flush=True)
    began = time.time()
    pool = Pool(asked.examples, device, asked.shares)
    held = Pool(asked.examples / "held", torch.device("cpu"), SHARES, keep=True)
    read = 0
    while read < asked.first:
        read += pool.refresh()
        time.sleep(0.3)
    stop = threading.Event()

    seen, step = 0, 0

    def load() -> None:
        while not stop.is_set():
            if pool.made > asked.fresh * seen + 1000 or not pool.refresh(4):
                time.sleep(0.3)

    threading.Thread(target=load, daemon=True).start()
    steps = optimisers(model, asked.rate, asked.muon, cuda)
    average = {k: v.detach().clone() for k, v in model.state_dict().items()}
    now = [v for v in model.state_dict().values() if v.is_floating_point()]
    kept = [average[k] for k, v in model.state_dict().items() if v.is_floating_point()]
    rng = np.random.default_rng(0)

    def save() -> None:
        part = asked.out / "weights.part"
        torch.save({k: v.half().cpu() for k, v in average.items()}, part)
        part.rename(asked.out / "weights.pt")

    def measured() -> dict[str, dict[str, float]]:
        held.refresh(100)
        out: dict[str, dict[str, float]] = {}
        model.eval()
        for kind in SHARES:
            total: dict[str, float] = {}
            clips = 0
            for (k, _), ring in held.rings.items():
                if k == kind:
                    arrays = {name: v[: len(ring)].to(device) for name, v in ring.arrays.items()}
                    rows = torch.arange(len(ring), device=device)
                    with torch.no_grad(), torch.autocast(device.type, torch.bfloat16, enabled=cuda):
                        found = means(model, chosen(arrays, rows, torch.zeros_like(rows)), kind.endswith("rgb"))
                    clips += len(ring)
                    for name, v in found.items():
                        total[name] = total.get(name, 0.0) + float(v) * len(ring)
            if clips:
                out[kind] = {name: round(v / clips, 3) for name, v in total.items()}
        model.train()
        return out

    clock = time.time if cuda else time.process_time
    first, last = clock(), time.time()
    sums: dict[str, Tensor] = {}
    counts: dict[str, int] = {}
    with (asked.out / "log.jsonl").open("a") as log:
        while (gone := clock() - first) < asked.seconds:
            share = min(1.0, (step + 1) / WARM_UP) * min(1.0, (asked.seconds - gone) / (asked.decay * asked.seconds))
            ring = pool.ring(rng)
            frame = ring.kind.startswith("frame")
            count = asked.frames if frame else max(round(asked.clips * 2.1 / ring.n), 8)
            group = ring.draw(min(count, 4 * len(ring)), rng)
            for optimiser, peak in zip(steps, (asked.rate, asked.muon), strict=True):
                optimiser.param_groups[0]["lr"] = share * peak
                optimiser.zero_grad(set_to_none=True)
            with torch.autocast(device.type, torch.bfloat16, enabled=cuda):
                found = means(model, group, ring.kind.endswith("rgb"))
                loss = sum(MIX[k] * v for k, v in found.items())
            loss.backward()  # type: ignore[union-attr]
            nn.utils.clip_grad_norm_(steps[0].param_groups[0]["params"], CLIP_NORM)
            for optimiser in steps:
                optimiser.step()
            step += 1
            seen += len(group["ask"])
            if step % 4 == 0:
                torch._foreach_lerp_(kept, now, 1 - max(1 - 8 / (step / 4), 0))
            for k, v in found.items():
                name = f"{ring.kind}.{k}"
                sums[name] = sums.get(name, torch.zeros((), device=device)) + v.detach()
                counts[name] = counts.get(name, 0) + 1
            if time.time() - last > (30 if cuda else 240) or step == 20:
                row = {
                    "step": step,
                    "s": round(gone),
                    "seen": seen,
                    "made": pool.made,
                    "rate": round(share, 3),
                    "train": {k: round(float(v) / counts[k], 3) for k, v in sorted(sums.items())},
                    "held": measured(),
                }
                log.write(json.dumps(row) + "\n")
                log.flush()
                flow = {k: row["train"].get(f"flow.{k}") for k in MIX}  # type: ignore[index, union-attr]
                print(
                    step, round(gone), "s seen", seen, "made", pool.made, "train", flow, "held", row["held"], flush=True
                )
                sums.clear()
                counts.clear()
                save()
                last = time.time()
        stop.set()
        model.load_state_dict(average)
        row = {"step": step, "s": round(clock() - first), "seen": seen, "made": pool.made, "averaged": measured()}
        log.write(json.dumps(row) + "\n")
        save()
        print(json.dumps(row), f"{time.time() - began:.0f} s in all", flush=True)


if __name__ == "__main__":
    main()
