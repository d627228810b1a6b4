"""Foreground end-point error and time of our RAFT beside OpenCV's DIS, in one run.

    python -m benchmarks.flow [--weights models/raft-small] [--seed N] [--iterations 4]

On 200 rendered pairs of a fresh seed (half by our ray caster, half by MuJoCo where OpenGL works), and on the clips of
another engine (in DYNAMICS_DATA or ../shared/data; skipped where there are none).
"""

from __future__ import annotations

import argparse
import secrets
from pathlib import Path

import torch

from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.raft import load_raft
from pipeline.vision.rendering.render_backend import choose_backend
from training.raft.flow_scores import HELD_OUT_PAIRS, Estimator, cross_engine, cross_engine_folder, held_out, score
from training.raft.pair_stream import Batch


def print_comparison(name: str, batch: Batch, estimators: dict[str, Estimator], iterations: int) -> None:
    size = f"{batch.frames_a.shape[2]}x{batch.frames_a.shape[1]}"
    print(f"\n{name}: {len(batch.frames_a)} pairs, px of {size}")
    rows = {label: score(e, batch, iterations) for label, e in estimators.items()}
    rival = rows["DIS medium"].foreground
    for label, row in rows.items():
        print(
            f"  {label:12} foreground {row.foreground:6.3f} px ({row.foreground / rival:4.2f} of DIS medium)   "
            f"all pixels {row.frame:6.4f} px   {row.seconds * 1e3:6.1f} ms a pair"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path, default=Path("models/raft-small"))
    parser.add_argument("--seed", type=int, default=None, help="of the rendered pairs; default: a fresh one")
    parser.add_argument("--iterations", type=int, default=4)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    estimators: dict[str, Estimator] = {
        "RAFT": load_raft(arguments.weights),
        "DIS fast": DIS("fast"),
        "DIS medium": DIS("medium"),
    }
    print(f"seed {seed}, RAFT with {arguments.iterations} iterations on {arguments.threads} threads")
    backend, why = choose_backend("auto")
    if backend == "mujoco":
        half = HELD_OUT_PAIRS // 2
        print_comparison("rendered by our ray caster", held_out(seed, half), estimators, arguments.iterations)
        print_comparison(f"rendered by {why}", held_out(seed + 1, half, mujoco=True), estimators, arguments.iterations)
    else:
        print_comparison(f"rendered by {why}", held_out(seed), estimators, arguments.iterations)
    folder = cross_engine_folder()
    if folder is None:
        print("\nanother engine's clips: skipped, none in DYNAMICS_DATA or ../shared/data")
    else:
        print_comparison("clips of Blender and Bullet", cross_engine(folder), estimators, arguments.iterations)


if __name__ == "__main__":
    main()
