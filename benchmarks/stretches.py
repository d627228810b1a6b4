"""The stretch in which bodies move freely, found and as a person chose it, of real clips.

    python -m benchmarks.stretches [--only NAME ...]

Clips: benchmarks/outlines, whose videos are in DYNAMICS_DATA or ../shared/data; whole files, at the rate at which they
were shot. Files that are so short that they are taken whole are looked at, too.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.drawn_outlines import read_outlines
from benchmarks.filmed import in_slow_motion
from benchmarks.mask_clips import OUTLINES, data_folder
from pipeline.perception.free_motion import free_stretch
from pipeline.perception.user_clip import mask_networks
from pipeline.vision.recordings.video import frame_times


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[])
    asked = parser.parse_args(argv)
    folder = data_folder() / "real_video"
    if not folder.is_dir():
        raise SystemExit(f"there is no {folder}: set DYNAMICS_DATA to the folder that has real_video")
    print("| clip | chosen, s | found, s | share of the chosen that is found | share of the found that is chosen |")
    print("| --- " * 5 + "|")
    for clip in read_outlines(OUTLINES):
        name, video = Path(clip.clip).stem, folder / clip.clip
        if asked.only and name not in asked.only:
            continue
        fps = clip.fps if in_slow_motion(clip) else None
        stamps = frame_times(video, fps)
        begin, end = (float(stamps[k]) for k in clip.stretch_frames)
        found = free_stretch(video, mask_networks().moving, stamps, fps, None)
        both = max(min(end, found.start + found.seconds) - max(begin, found.start), 0.0)
        print(
            f"| {name} | {begin:.2f} to {end:.2f} | {found.start:.2f} to {found.start + found.seconds:.2f} | "
            f"{both / (end - begin):.2f} | {both / found.seconds:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
