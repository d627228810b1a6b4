"""Pictures of any size and aspect ratio brought to one size, by a crop or with bars."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

KEPT_SHARE = 0.6  # of the picture that a crop must keep


@dataclass(frozen=True)
class Letterbox:
    """How pictures of one size become pictures of another: by a crop, or between bars.

    Attributes:
        source: Size of the source (width, height), px.
        size: Size of the result (width, height), px.
        window: The part of the source that is kept: left, top, width, height, px of the source.
        place: Where it goes in the result: left, top, width, height, px of the result.
    """

    source: tuple[int, int]
    size: tuple[int, int]
    window: tuple[int, int, int, int]
    place: tuple[int, int, int, int]

    def apply(self, picture: np.ndarray, nearest: bool = False) -> np.ndarray:
        """The result (H, W, ...) of a source picture (h, w, ...).

        Bars have the median colour of the picture's border. nearest: for masks; bars are 0.
        """
        left, top, width, height = self.window
        cut = picture[top : top + height, left : left + width]
        x, y, w, h = self.place
        shrinks = w * h < width * height
        how = cv2.INTER_NEAREST_EXACT if nearest else cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        inner = cut if (w, h) == (width, height) else cv2.resize(cut, (w, h), interpolation=how)
        if (w, h) == self.size:
            return inner
        border = np.concatenate([cut[0], cut[-1], cut[:, 0], cut[:, -1]])
        fill = np.zeros_like(border[0]) if nearest else np.median(border, axis=0).astype(picture.dtype)
        out = np.empty((self.size[1], self.size[0], *picture.shape[2:]), picture.dtype)
        out[:] = fill
        out[y : y + h, x : x + w] = inner
        return out


def letterbox_for(source: tuple[int, int], size: tuple[int, int]) -> tuple[Letterbox, str | None]:
    """The letterbox from a source to a size, both (width, height) px, and a note where their aspect ratios differ.

    The middle is cropped, which keeps pixels square and the optical axis in the centre. It narrows the field of view.
    Where less than `KEPT_SHARE` of the picture would remain (portrait), bars are added instead.
    """
    (sw, sh), (w, h) = source, size
    ratio = (sw / sh) / (w / h)
    if abs(ratio - 1) < 0.01:
        return Letterbox(source, size, (0, 0, sw, sh), (0, 0, w, h)), None
    if min(ratio, 1 / ratio) >= KEPT_SHARE:
        kw, kh = (round(sh * w / h), sh) if ratio > 1 else (sw, round(sw * h / w))
        side = "horizontal" if ratio > 1 else "vertical"
        note = (
            f"cropped from {sw}x{sh} to the middle {kw}x{kh}: the tangent of the {side} field of view is "
            f"{min(ratio, 1 / ratio):.0%} of that of the recording"
        )
        return Letterbox(source, size, ((sw - kw) // 2, (sh - kh) // 2, kw, kh), (0, 0, w, h)), note
    pw, ph = (w, round(w * sh / sw)) if ratio > 1 else (round(h * sw / sh), h)
    note = (
        f"the aspect ratio of {sw}x{sh} differs much from {w}x{h}: the whole picture is kept, {pw}x{ph} between "
        "bars; objects that leave the picture disappear there"
    )
    return Letterbox(source, size, (0, 0, sw, sh), ((w - pw) // 2, (h - ph) // 2, pw, ph)), note
