"""Make training examples with RAFT's own flow: a second each, 20 times as long as with exact flow and noise.

    python -m training.tiny.measured --out .train/measured --minutes 60

Writes chunk_<number>.pkl, 16 clips each (pictures, tokens, labels of patches), until the time is over; a later run
continues after the last one. `python -m training.tiny --measured .train/measured` mixes them in.
"""

from __future__ import annotations

import argparse
import pickle
import time
from dataclasses import dataclass, field
from pathlib import Path

import torch
from tqdm import tqdm

from pipeline.language.codec import Codec
from pipeline.language.tokenizer import build_tokenizer
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.tiny.examples import CHUNK, LAYOUT, Example, ExampleKind, make_examples

SUITE = "tiny-measured"


@dataclass
class MeasuredExamples:
    """The examples in a folder, to which another process may still add. They are pickles: read only your own."""

    folder: Path
    examples: list[Example] = field(default_factory=list)
    read: set[Path] = field(default_factory=set)

    def refresh(self) -> list[Example]:
        """All examples, new ones included."""
        for file in sorted(set(self.folder.glob("chunk_*.pkl")) - self.read):
            self.examples += pickle.loads(file.read_bytes())
            self.read.add(file)
        return self.examples


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(".train/measured"))
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--chunks", type=int, default=10_000, help="in the folder, at most")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    args.out.mkdir(parents=True, exist_ok=True)
    params, kind = read_params_file(PARAMS_FILE, Params), ExampleKind("raft")
    codec = Codec(build_tokenizer(), LAYOUT.tokens)
    until = time.monotonic() + 60 * args.minutes
    for chunk in tqdm(range(args.chunks), unit=f"{CHUNK} clips", disable=None):
        file = args.out / f"chunk_{chunk:05d}.pkl"
        if file.exists():
            continue
        if time.monotonic() > until:
            break
        indices = range(chunk * CHUNK, (chunk + 1) * CHUNK)
        examples = make_examples(params, codec, kind, SUITE, indices, kind.reasons(chunk))
        partial = file.with_suffix(".partial")
        partial.write_bytes(pickle.dumps(examples))
        partial.replace(file)


if __name__ == "__main__":
    main()
