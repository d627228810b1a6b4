"""Flow as a uint8 picture, the form in which the model receives it.

The scale is fixed, so that a colour always means the same flow. Flow is px per frame interval. It saturates at
`max_px`, whose default is meant for 480x320 and 1/30 s; `scaled_max_px` gives that of other sizes and intervals.
"""

from __future__ import annotations

import numpy as np

from pipeline.compiled import kernel

MAX_PX = 32.0  # px at 480 px of width and 1/30 s: 2 m/s at a distance of 1.4 m with a field of view of 44 degrees
REFERENCE_WIDTH = 480
KINDS = ("wheel", "channels")

#: First colour, last colour and length of the six sectors of the Middlebury colour wheel (Baker et al., IJCV 2011).
SECTORS = (
    ("red", "yellow", 15),
    ("yellow", "green", 6),
    ("green", "cyan", 4),
    ("cyan", "blue", 11),
    ("blue", "magenta", 13),
    ("magenta", "red", 6),
)
COLOURS = {
    "red": (255, 0, 0),
    "yellow": (255, 255, 0),
    "green": (0, 255, 0),
    "cyan": (0, 255, 255),
    "blue": (0, 0, 255),
    "magenta": (255, 0, 255),
}


def scaled_max_px(width: int, seconds: float = 1 / 30) -> float:
    """`MAX_PX` scaled to pictures `width` px wide with an interval of `seconds` between frames."""
    return MAX_PX * width / REFERENCE_WIDTH * seconds * 30


def flow_picture(flow_px: np.ndarray, kind: str = "channels", max_px: float = MAX_PX) -> np.ndarray:
    """Flow (..., H, W, 2) px as a picture (..., H, W, 3) uint8.

    NaN counts as zero flow; flow beyond `max_px` saturates. kind: "wheel" is Middlebury's colour wheel, white for no
    motion and full colour at `max_px`; "channels" is described at `encode_channels`.
    """
    if kind not in KINDS:
        raise ValueError(f"unknown kind of flow picture {kind!r}; valid: {', '.join(KINDS)}")
    flow_px = np.asarray(flow_px, np.float32)
    return encode_wheel(np.nan_to_num(flow_px), max_px) if kind == "wheel" else encode_channels(flow_px, max_px)


def encode_channels(flow_px: np.ndarray, max_px: float) -> np.ndarray:
    """u and v as 128 + 127 sign(u) sqrt(|u| / max_px), and the magnitude as 255 sqrt(|flow| / max_px).

    The square root resolves slow motion: one of the 127 steps is 0.002 px at rest and 0.5 px at 32 px. NaN counts as
    zero flow.
    """
    flow_px = np.ascontiguousarray(flow_px, np.float32)
    out = np.empty((*flow_px.shape[:-1], 3), np.uint8)
    _encode_channels(flow_px.reshape(-1, 2), np.float32(max_px), out.reshape(-1, 3))
    return out


@kernel
def _encode_channels(flow_px: np.ndarray, max_px: np.float32, out: np.ndarray) -> None:
    one, middle, half, full = np.float32(1), np.float32(128), np.float32(127), np.float32(255)
    for i in range(len(flow_px)):
        u, v = flow_px[i, 0] / max_px, flow_px[i, 1] / max_px
        u, v = np.float32(0) if np.isnan(u) else u, np.float32(0) if np.isnan(v) else v
        signed_u, signed_v = np.sqrt(min(abs(u), one)), np.sqrt(min(abs(v), one))
        out[i, 0] = np.uint8(np.rint(middle + half * (signed_u if u >= 0 else -signed_u)))
        out[i, 1] = np.uint8(np.rint(middle + half * (signed_v if v >= 0 else -signed_v)))
        out[i, 2] = np.uint8(np.rint(full * np.sqrt(min(np.sqrt(u * u + v * v), one))))


def wheel() -> np.ndarray:
    """The 55 colours of the wheel, (55, 3) in 0 to 255, clockwise in the image (y down) from motion to the left."""
    arcs = [np.linspace(COLOURS[a], COLOURS[b], length, endpoint=False, dtype=np.float64) for a, b, length in SECTORS]
    return np.floor(np.concatenate(arcs))


def encode_wheel(flow_px: np.ndarray, max_px: float) -> np.ndarray:
    """Direction as hue and magnitude as saturation; beyond `max_px` the colour is darkened, as in Middlebury's code."""
    out = np.full((*flow_px.shape[:-1], 3), 255, np.uint8)
    moving = flow_px.any(-1)  # most of a picture is at rest
    out[moving] = _wheel_colours(flow_px[moving], max_px)
    return out


def _wheel_colours(flow_px: np.ndarray, max_px: float) -> np.ndarray:
    colours = wheel()
    u, v = flow_px[..., 0] / max_px, flow_px[..., 1] / max_px
    length = np.hypot(u, v)[..., None]
    place = (np.arctan2(-v, -u) / np.pi + 1) / 2 * (len(colours) - 1)
    before = np.floor(place).astype(int)
    share = (place - before)[..., None]
    hue = ((1 - share) * colours[before] + share * colours[(before + 1) % len(colours)]) / 255
    pale = 1 - np.minimum(length, 1) * (1 - hue)
    return np.floor(255 * np.where(length > 1 + 1e-6, 0.75 * hue, pale)).astype(np.uint8)
