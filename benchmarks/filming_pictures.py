"""The pictures of docs/filming.md and the real clip of README.md.

    python -m benchmarks.filming_pictures [--seed 11] [--scene out/scene.yaml --start S]

Writes docs/filming_views.jpg: one sampled scene per kind of view, its bodies at several moments in one picture. With
--scene also docs/real_clip.jpg: a frame of the tennis ball's clip (DYNAMICS_DATA or ../shared/data; MIT) beside itself
with the outlines of that scene's replay. The scene is what `dynamics infer` wrote for that clip from S on.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw

from pipeline.clips.draw_views import draw_view_clips, view_kind
from pipeline.clips.replay import masks_at, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.scene.text import read_scene
from pipeline.vision.recordings.video import read_clip
from pipeline.vision.rendering.appearance import sample_appearance
from pipeline.vision.rendering.render import render_rgb
from training.data_folder import data_folder

DOCS = Path("docs")
REAL, REAL_SIZE = "tennisball_toss_wall.mp4", (720, 480)
MOMENTS = 6  # shown in one picture
CAPTIONS = {
    "side": "side: across the motion, camera low",
    "incline": "incline: along the ramp's edge",
    "flight": "flight: the whole arc in the picture",
    "top": "top: straight down",
    "table": "table: from above and aside",
}
PICKED = {"side": 6, "incline": 2, "flight": 3, "top": 9, "table": 0}  # clips that show their kind well
EDGE, SHADOW = (255, 235, 0), (0, 0, 0)


def strobed(frames: np.ndarray, masks: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: the last of frames (T, H, W, 3) with the bodies of some earlier ones, by masks (T, H, W)."""
    out = frames[-1].copy()
    for k in np.linspace(0, len(frames) - 1, MOMENTS).round().astype(int):
        out[masks[k] > 0] = frames[k][masks[k] > 0]
        outline(out, masks[k] > 0)
    return out


def outline(picture: np.ndarray, mask: np.ndarray) -> None:
    """Draw the edge of a mask (H, W) into a picture (H, W, 3) uint8."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, found, -1, SHADOW, 3, cv2.LINE_AA)
    cv2.drawContours(picture, found, -1, EDGE, 1, cv2.LINE_AA)


def views_sheet(seed: int) -> Image.Image:
    """A picture for each kind of view."""
    schedule, panels = Schedule(), []
    for kind, caption in CAPTIONS.items():
        index = PICKED[kind]
        assert view_kind(index) == kind
        (scene,) = draw_view_clips(seed, "views benchmark", [index], schedule).scenes
        shown = replay_poses(scene, schedule)
        rng = np.random.default_rng([seed, index])
        appearance = sample_appearance(rng, len(scene.objects), n_fixed=len(scene.fixed))
        frames = render_rgb(
            scene, shown.position, shown.quaternion, appearance, shown.width, shown.height, "raycast", True
        )
        panel = Image.fromarray(strobed(frames, shown.masks)).resize((360, 240), Image.Resampling.LANCZOS)
        sheet = Image.new("RGB", (360, 262), "white")
        sheet.paste(panel, (0, 22))
        ImageDraw.Draw(sheet).text((2, 4), caption, fill="black")
        panels.append(sheet)
    whole = Image.new("RGB", (3 * 368 - 8, 2 * 270 - 8), "white")
    for k, panel in enumerate(panels):
        whole.paste(panel, (368 * (k % 3), 270 * (k // 3)))
    return whole


def real_sheet(scene_file: Path, start: float) -> Image.Image:
    """A frame of the real clip, and the same with the replay's outlines."""
    scene = read_scene(scene_file.read_text(encoding="utf-8"), str(scene_file))
    clip = read_clip(data_folder() / "real_video" / REAL, start, 0.65, size=REAL_SIZE)
    own = masks_at(scene, clip.times, *REAL_SIZE)
    drawn = clip.frames[len(clip.frames) // 2].copy()
    for k in range(0, len(own), 2):
        outline(drawn, own[k] > 0)
    return Image.fromarray(np.concatenate([clip.frames[len(clip.frames) // 2], drawn], 1))


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--scene", type=Path)
    parser.add_argument("--start", type=float, default=0.0)
    arguments = parser.parse_args(argv)
    views_sheet(arguments.seed).save(DOCS / "filming_views.jpg", quality=85)
    if arguments.scene is not None:
        real_sheet(arguments.scene, arguments.start).save(DOCS / "real_clip.jpg", quality=85)


if __name__ == "__main__":
    main()
