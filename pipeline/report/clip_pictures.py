"""A clip beside its replays: an animation of input, replay and outlines, and a sheet of stills with masks and flow."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from PIL import Image

from pipeline.clips.replay import HEIGHT, WIDTH, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.errors import SimulationError
from pipeline.scene.scene import Scene
from pipeline.vision.flow.flow_picture import flow_picture

#: Object colours, RGB.
PALETTE = np.array(
    [[230, 76, 60], [52, 152, 219], [46, 204, 113], [241, 196, 15], [155, 89, 182], [26, 188, 156], [230, 126, 34]],
    float,
)
COLUMNS = 5  # moments on a sheet of stills
STILL = (360, 240)  # px, width and height at which a still of a replay is rendered
STILL_WIDTH = 200  # px, on the sheet
PANEL = (240, 160)  # px, width and height of each of the three panels of an animation
PANELS = ("input", "replay", "outlines on the input")


def painted(frame: np.ndarray, mask: np.ndarray, tint: float = 0.45) -> np.ndarray:
    """A frame (H, W, 3) uint8 with each object of a mask (h, w) tinted by so much and outlined, in its colour."""
    height, width = frame.shape[:2]
    mask = cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST)
    out = frame.astype(float)
    for i in range(1, int(mask.max(initial=0)) + 1):
        inside = (mask == i).astype(np.uint8)
        colour = PALETTE[(i - 1) % len(PALETTE)]
        out[inside > 0] = (1 - tint) * out[inside > 0] + tint * colour
        contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        canvas = np.ascontiguousarray(out.astype(np.uint8))
        cv2.drawContours(canvas, contours, -1, colour.tolist(), 2)
        out = canvas.astype(float)
    return out.astype(np.uint8)


def tiled(rows: Sequence[tuple[str, Sequence[np.ndarray]]]) -> np.ndarray:
    """Pictures (H, W, 3) uint8 in rows, each row with its title above, each picture STILL_WIDTH px wide."""
    strips = []
    for title, pictures in rows:
        sizes = [(STILL_WIDTH, round(STILL_WIDTH * p.shape[0] / p.shape[1])) for p in pictures]
        scaled = [cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p, size in zip(pictures, sizes, strict=True)]
        strip = np.concatenate([np.pad(p, ((0, 0), (0, 4), (0, 0)), constant_values=255) for p in scaled], 1)
        head = np.full((18, strip.shape[1], 3), 255, np.uint8)
        cv2.putText(head, title, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
        strips += [head, strip]
    longest = max(s.shape[1] for s in strips)
    return np.concatenate([np.pad(s, ((0, 0), (0, longest - s.shape[1]), (0, 0)), constant_values=255) for s in strips])


def stills(
    frames: np.ndarray, masks: np.ndarray, flow: np.ndarray, answers: Mapping[str, Scene], schedule: Schedule
) -> np.ndarray:
    """A sheet (H, W, 3) uint8 of COLUMNS moments of a clip, and of each answer to it.

    Args:
        frames: (F, H, W, 3) uint8.
        masks: (F, h, w) uint8, as given with the clip.
        flow: (P, h, w, 2) px, of the pairs that the model sees.
        answers: Scenes by method. Each adds a row of its replay, and a row of the replay's masks over the input.
        schedule: Of the clip.
    """
    chosen = np.linspace(0, schedule.model_frames - 1, COLUMNS).round().astype(int)
    moments = schedule.pairs[chosen, 0]
    longest = max(float(np.abs(flow).max()), 1e-6)
    rows = [
        ("input", [frames[m] for m in moments]),
        ("masks given", [painted(frames[m], masks[m]) for m in moments]),
        ("flow measured", [flow_picture(flow[c], "wheel", longest) for c in chosen]),
    ]
    for name, scene in answers.items():
        try:
            own = replay_poses(scene, schedule)
            rows.append((f"{name}: replay", list(own.pictures("raycast", moments, *STILL))))
            rows.append((f"{name}: its masks over the input", [painted(frames[m], own.masks[m]) for m in moments]))
        except SimulationError:
            rows.append((f"{name}: the simulation diverges", [np.full((HEIGHT, WIDTH, 3), 128, np.uint8)]))
    return tiled(rows)


def animation(frames: np.ndarray, scene: Scene, schedule: Schedule) -> np.ndarray:
    """(F, H, 3 W, 3) uint8: each frame of a clip in the panels PANELS; a grey panel where the replay diverges.

    Args:
        frames: (F, H, W, 3) uint8.
        scene: The answer.
        schedule: Of the clip.
    """
    shown = np.stack([cv2.resize(f, PANEL, interpolation=cv2.INTER_AREA) for f in frames])
    try:
        own = replay_poses(scene, schedule)
        masks, rendered = own.masks, own.pictures("raycast", np.arange(len(frames)), *PANEL)
    except SimulationError:
        masks, rendered = np.zeros((len(frames), HEIGHT, WIDTH), np.uint8), np.full_like(shown, 128)
    outlines = np.stack([painted(f, m, tint=0) for f, m in zip(shown, masks, strict=True)])
    return np.concatenate([shown, rendered, outlines], axis=2)


def as_jpeg(picture: np.ndarray) -> bytes:
    """An RGB picture (H, W, 3) uint8 as JPEG."""
    encoded, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
    assert encoded
    return data.tobytes()


def as_webp(frames: np.ndarray, fps: float) -> bytes:
    """RGB frames (F, H, W, 3) uint8 as an animated WebP that repeats."""
    first, *rest = (Image.fromarray(f) for f in frames)
    data = io.BytesIO()
    first.save(
        data, "WEBP", save_all=True, append_images=rest, duration=round(1000 / fps), loop=0, quality=55, method=4
    )
    return data.getvalue()
