"""Examples kept in Parquet files: made once, read by every training.

    python -m training.objects.shards OUT [--first 0] [--clips 60000] [--seed 1] [--suite objects-training]

One file has SHARD clips, a row each; a file that is there is not made again.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.objects.batch import Examples, arrays_of
from pipeline.objects.example import MOTION, Example
from pipeline.objects.fields import OBJECT_FIELDS
from pipeline.objects.instances import CHANNELS, PLACES, SIDE
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.objects.examples import make_examples

SHARD = 250
SUITE = "objects-training"
#: Arrays of an example: type, and the shape of an instance's part, T for the number of frames.
COLUMNS: dict[str, tuple[str, tuple[int, ...]]] = {
    "crops": ("int8", (-1, len(CHANNELS), SIDE, SIDE)),
    "places": ("float32", (-1, len(PLACES))),
    "shapes": ("int8", ()),
    "values": ("float32", (len(OBJECT_FIELDS),)),
    "motion": ("float32", (-1, MOTION)),
}


def write_examples(examples: Sequence[Example], path: Path) -> None:
    """Write a file, whole or not at all."""
    rows: dict[str, list] = {"scene": [], "count": [], **{name: [] for name in COLUMNS}}
    for e in examples:
        rows["scene"].append(e.scene.astype(np.float32).tobytes())
        rows["count"].append(len(e.instances))
        arrays = arrays_of(e)
        for name, (kind, _) in COLUMNS.items():
            rows[name].append(arrays[name].astype(kind).tobytes())
    schema = pa.schema([("scene", pa.binary()), ("count", pa.int32()), *((name, pa.binary()) for name in COLUMNS)])
    part = path.with_suffix(".part")
    pq.write_table(pa.table(rows, schema=schema), part, compression="zstd", use_dictionary=False)
    part.rename(path)


def read_examples(path: Path, frames: int = 10) -> Examples:
    """A file of `write_examples`; frames: of a clip."""
    table = pq.read_table(path)
    count = np.array(table["count"])

    def column(name: str, kind: str, shape: tuple[int, ...]) -> np.ndarray:
        joined = b"".join(table[name].to_pylist())
        return np.frombuffer(joined, kind).reshape(-1, *(frames if side == -1 else side for side in shape))

    arrays = {name: column(name, kind, shape) for name, (kind, shape) in COLUMNS.items()}
    return Examples(column("scene", "float32", (4,)), count, arrays)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the files")
    parser.add_argument("--first", type=int, default=0, help="index of the first clip, a multiple of the shard's size")
    parser.add_argument("--clips", type=int, default=60_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--suite", default=SUITE, help="names the random streams")
    parser.add_argument("--noise", type=float, default=1.0, help="strength of the errors; 0: exact masks and flow")
    asked = parser.parse_args()
    params = read_params_file(PARAMS_FILE, Params)
    train = params.suites.train
    asked.out.mkdir(parents=True, exist_ok=True)
    began, done = time.perf_counter(), 0
    for first in range(asked.first, asked.first + asked.clips, SHARD):
        path = asked.out / f"{first:07d}.parquet"
        if path.exists():
            continue
        indices = range(first, first + SHARD)
        examples, _ = make_examples(params, asked.seed, asked.suite, indices, train.objects, train.without, asked.noise)
        write_examples(examples, path)
        done += SHARD
        if done % (8 * SHARD) == 0 or done == SHARD:
            print(f"{path.name}: {done / (time.perf_counter() - began):.0f} clips/s", flush=True)


if __name__ == "__main__":
    main()
