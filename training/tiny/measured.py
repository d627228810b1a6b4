"""Make training examples with RAFT's own flow: a second each, 20 times as long as with exact flow and noise.

    python -m training.tiny.measured --out .train/measured --minutes 60

Writes chunk_<number>.safetensors, 16 clips each (pictures, tokens, labels of patches), until the time is over; a later
run continues after the last one. `python -m training.tiny --measured .train/measured` mixes them in.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from pipeline.language.codec import Codec, Tokens
from pipeline.language.tokenizer import build_tokenizer
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.checkpoint import load_checkpoint, save_checkpoint
from training.tiny.examples import CHUNK, LAYOUT, Example, ExampleKind, make_examples
from training.tiny.patch_labels import PatchLabels
from training.tiny.soft_numbers import SoftTargets

SUITE = "tiny-measured"


@dataclass
class MeasuredExamples:
    """The examples in a folder, to which another process may still add."""

    folder: Path
    examples: list[Example] = field(default_factory=list)
    read: set[Path] = field(default_factory=set)

    def refresh(self) -> list[Example]:
        """All examples, new ones included."""
        for file in sorted(set(self.folder.glob("chunk_*.safetensors")) - self.read):
            self.examples += read_examples(file)
            self.read.add(file)
        return self.examples


def write_examples(examples: list[Example], file: Path) -> None:
    """Write a file, whole or not at all."""

    def tensors(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: tensors(inner) for name, inner in value.items()}
        return torch.from_numpy(value) if isinstance(value, np.ndarray) else value

    save_checkpoint(file, {"examples": [tensors(asdict(example)) for example in examples]})


def read_examples(file: Path) -> list[Example]:
    """What `write_examples` wrote. Raises ModelError for a damaged file."""

    def arrays(values: dict[str, Any]) -> dict[str, Any]:
        return {name: v.numpy() if isinstance(v, torch.Tensor) else v for name, v in values.items()}

    return [
        Example(
            tokens=Tokens(**arrays(e["tokens"])),
            soft=SoftTargets(**arrays(e["soft"])),
            picture=e["picture"].numpy(),
            patches=PatchLabels(**arrays(e["patches"])),
        )
        for e in load_checkpoint(file)["examples"]
    ]


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
        file = args.out / f"chunk_{chunk:05d}.safetensors"
        if file.exists():
            continue
        if time.monotonic() > until:
            break
        indices = range(chunk * CHUNK, (chunk + 1) * CHUNK)
        write_examples(make_examples(params, codec, kind, SUITE, indices, kind.reasons(chunk)), file)


if __name__ == "__main__":
    main()
