"""Train RAFT-small, with learned upsampling, from random weights on rendered pairs with exact flow.

    python -m training.raft --minutes 100                          # one CPU core and one worker process
    python -m training.raft --minutes 60 --device cuda --batch 64 --workers 14
    python -m training.raft --export models/raft-small             # write the last checkpoint, train nothing

It reads no data: the pairs are rendered during the training (`training/raft/rendered_pairs.py`). It writes to --out
`checkpoint.safetensors`, every few minutes and under a temporary name first, and `log.csv`, the errors on held-out
pairs beside those of OpenCV's DIS. A run that finds a checkpoint continues it. At the end, or with --export, it writes
`model.safetensors`, `config.json` and a model card. The learning rate follows the time: one cycle over --minutes of
training, resumed runs included.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from pipeline.vision.flow.dis import PRESETS
from pipeline.vision.flow.raft import RAFT
from training.raft.card import write_card
from training.raft.trainer import Progress, read_checkpoint, train


def export(model: RAFT, folder: Path, progress: Progress) -> None:
    """Write the weights, and a model card with the errors measured now."""
    model.eval().to("cpu")
    model.save(folder)
    write_card(folder, model, progress.steps, progress.pairs)
    print(f"wrote {folder}", flush=True)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=100, help="of training in all, resumed runs included")
    parser.add_argument("--out", type=Path, default=Path(".train/raft"), help="checkpoints and log")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--threads", type=int, default=1, help="of torch on the CPU")
    parser.add_argument("--workers", type=int, default=1, help="processes that render pairs")
    parser.add_argument("--batch", type=int, default=8, help="pairs a step (a third in the last phase)")
    parser.add_argument("--iterations", type=int, default=3, help="recurrent updates in training")
    parser.add_argument("--rate", type=float, default=5e-4, help="highest learning rate of AdamW")
    parser.add_argument("--muon-rate", type=float, default=2e-3, help="highest learning rate of Muon")
    parser.add_argument("--warm-start", choices=("none", *PRESETS), default="none", help="DIS preset to refine")
    parser.add_argument("--foreground-weight", type=float, default=4.0, help="extra weight of moving bodies' pixels")
    parser.add_argument("--matching-weight", type=float, default=1.0, help="of the matching loss, at the start")
    parser.add_argument("--warped", type=float, default=1.0, help="share of warped textures in the first quarter")
    parser.add_argument(
        "--mujoco-share",
        type=float,
        default=0.03,
        help="of pairs that MuJoCo renders, where it can; 30 times slower, with similar pictures",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--save-minutes", type=float, default=3)
    parser.add_argument("--validate-minutes", type=float, default=8)
    parser.add_argument("--resume", action=argparse.BooleanOptionalAction, default=True, help="continue from --out")
    parser.add_argument("--weights", type=Path, default=Path("models/raft-small"), help="of the final weights")
    parser.add_argument("--export", type=Path, help="write the last checkpoint to this folder and stop")
    return parser.parse_args()


def main() -> None:
    arguments = parse()
    if arguments.export is None:
        model, progress = train(arguments)
    else:
        torch.set_num_threads(arguments.threads)
        model, progress = read_checkpoint(arguments.out / "checkpoint.safetensors", arguments)
    export(model, arguments.export or arguments.weights, progress)


if __name__ == "__main__":
    main()
