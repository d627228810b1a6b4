"""Training clips a second: sampled, simulated, with exact flow and noise, tokens and labels; and with RGB or RAFT.

Run: python -m benchmarks.examples [--workers 2] [--seconds 20]
"""

from __future__ import annotations

import argparse
import multiprocessing
import time

import torch
from training.tiny.examples import CHUNK, LAYOUT, ExampleKind, make_examples

from pipeline.evaluation.tables import markdown
from pipeline.language.codec import Codec
from pipeline.language.tokenizer import build_tokenizer
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file

KINDS = {"flow": "exact flow with noise", "rgb": "RGB", "raft": "RGB, then RAFT's flow"}


def rate(job: tuple[str, int, float]) -> float:
    """Clips a second of one process after a warm-up; job: kind, worker, seconds."""
    kind, worker, seconds = job
    torch.set_num_threads(1)
    params, codec = read_params_file(PARAMS_FILE, Params), Codec(build_tokenizer(), LAYOUT.tokens)
    suite = f"benchmark-{time.time_ns()}-{worker}"
    make_examples(params, codec, ExampleKind(kind), suite, range(2), True)
    began, count = time.monotonic(), 0
    while time.monotonic() < began + seconds:
        indices = range(2 + count, 2 + count + CHUNK)
        count += len(make_examples(params, codec, ExampleKind(kind), suite, indices, True))
    return count / (time.monotonic() - began)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20.0)
    args = parser.parse_args()
    rows = []
    with multiprocessing.get_context("spawn").Pool(args.workers) as pool:
        for kind, name in KINDS.items():
            rates = pool.map(rate, [(kind, w, args.seconds) for w in range(args.workers)], chunksize=1)
            rows.append([name, f"{sum(rates):.1f}"])
    print(markdown(["clips", f"a second, {args.workers} processes"], rows))


if __name__ == "__main__":
    main()
