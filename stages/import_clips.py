"""Import the user's clips as the suite `real`: decode videos, read or find masks, resample both.

Reads the folder suites.real.path: videos, or folders that each have a video and masks (masks.npz, or a folder masks/ of
PNGs); where there are none, the network in models/masks finds the moving bodies. Writes data/render/real: table clips
(clip, name, source_fps, recorded: the time of each frame, s, masks_from, notes), arrays rgb and mask.
Parameters: clip, suites.real, sample.shard_size. Run: python -m stages.import_clips
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from pipeline.bodies.mask_source import WEIGHTS, MaskSource
from pipeline.bodies.prompts import Prompts
from pipeline.errors import ParamsError
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from pipeline.vision.recordings.clip_folder import find_clips, masks_beside
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

SCHEMA = pa.schema(
    {
        "clip": pa.int64(),
        "name": pa.string(),
        "source_fps": pa.float64(),
        "recorded": pa.list_(pa.float64()),
        "masks_from": pa.string(),
        "notes": pa.list_(pa.string()),
    }
)


SIZE = (480, 320)  # px, width and height, of all clips of the graph


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        clips: The videos and folders, by the clip's number.
        start: Where in each video the clip begins, s.
        seconds: How long it is.
        frames_per_second: At which it is resampled.
        assume_fps: At which it was recorded; None for what the file's header says.
    """

    clips: tuple[Path, ...]
    start: float
    seconds: float
    frames_per_second: int
    assume_fps: float | None


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    # imported here: it takes seconds, and mostly the shards are in the store
    from pipeline.bodies.user_clip import on_grid, read_frames, with_masks

    rows, frames, masks = [], [], []
    for clip in shard.clips:
        place = parameters.clips[clip]
        read = read_frames(
            place,
            start=parameters.start,
            seconds=parameters.seconds,
            assume_fps=parameters.assume_fps,
            source=MaskSource(masks_beside(place)),
        )
        frames_a_clip = round(parameters.seconds * parameters.frames_per_second)
        taken = on_grid(with_masks(read, Prompts()), parameters.frames_per_second, frames_a_clip, SIZE)
        rows.append(
            {
                "clip": clip,
                "name": place.stem,
                "source_fps": taken.clip.source_fps,
                "recorded": taken.clip.source_times.tolist(),
                "masks_from": taken.masks_from,
                "notes": [*taken.clip.notes, *taken.doubts],
            }
        )
        frames.append(taken.clip.frames)
        masks.append(taken.masks)
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, {"rgb": np.stack(frames), "mask": np.stack(masks)})


def main() -> None:
    params = load("import_clips", "real")
    own = params.suites.real
    if own.path is not None and round(own.seconds * params.clip.fps) != round(params.clip.seconds * params.clip.fps):
        raise ParamsError(
            f"suites.real.seconds is {own.seconds}, clip.seconds is {params.clip.seconds}; valid: equally many frames"
        )
    clips = find_clips(Path(own.path)) if own.path is not None else []
    parameters = Parameters(
        clips=tuple(clips),
        start=own.start,
        seconds=own.seconds,
        frames_per_second=params.clip.fps,
        assume_fps=own.fps,
    )
    run_shards(
        "import_clips",
        "real",
        compute,
        parameters,
        output="render",
        clips=len(clips),
        shard_size=params.sample.shard_size,
        files={str(clip): clip for clip in clips} | {"masks": WEIGHTS},
        versions=["opencv-python-headless", "av", "torch"],
    )


if __name__ == "__main__":
    run(main)
