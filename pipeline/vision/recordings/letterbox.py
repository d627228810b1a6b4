"""Pictures of any size brought to another: evenly, and between bars where their aspect ratios differ."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

ALIKE = 0.01  # aspect ratios that differ by less need no bars


@dataclass(frozen=True)
class Letterbox:
    """How pictures of one size become pictures of another.

    Attributes:
        source: Size of the source (width, height), px.
        size: Size of the result (width, height), px.
        place: Where the source goes in the result: left, top, width, height, px.
    """

    source: tuple[int, int]
    size: tuple[int, int]
    place: tuple[int, int, int, int]

    @property
    def scale(self) -> float:
        """px of the result for a px of the source."""
        return self.place[2] / self.source[0]

    def apply(self, picture: np.ndarray, nearest: bool = False) -> np.ndarray:
        """The result (H, W, ...) of a source picture (h, w, ...).

        Bars have the median colour of the picture's border. nearest: for masks; bars are 0.
        """
        x, y, w, h = self.place
        shrinks = w * h < self.source[0] * self.source[1]
        how = cv2.INTER_NEAREST_EXACT if nearest else cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        inner = picture if (w, h) == self.source else cv2.resize(picture, (w, h), interpolation=how)
        if (w, h) == self.size:
            return inner
        border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        fill = np.zeros_like(border[0]) if nearest else np.median(border, axis=0).astype(picture.dtype)
        out = np.empty((self.size[1], self.size[0], *picture.shape[2:]), picture.dtype)
        out[:] = fill
        out[y : y + h, x : x + w] = inner
        return out

    @property
    def note(self) -> str | None:
        """A sentence where there are bars."""
        if self.place[2:] == self.size:
            return None
        (sw, sh), (w, h) = self.source, self.size
        return f"the whole picture of {sw}x{sh} is kept, {self.place[2]}x{self.place[3]} between bars of {w}x{h}"


def of_area(source: tuple[int, int], area: float) -> tuple[int, int]:
    """A size (width, height), px, scaled evenly to an area, px²."""
    scale = (area / (source[0] * source[1])) ** 0.5
    return round(source[0] * scale), round(source[1] * scale)


def letterbox_for(source: tuple[int, int], size: tuple[int, int]) -> Letterbox:
    """The letterbox from a source to a size, both (width, height) px; the optical axis stays in the centre."""
    (sw, sh), (w, h) = source, size
    ratio = (sw / sh) / (w / h)
    if abs(ratio - 1) < ALIKE:
        return Letterbox(source, size, (0, 0, w, h))
    pw, ph = (w, round(w * sh / sw)) if ratio > 1 else (round(h * sw / sh), h)
    return Letterbox(source, size, ((w - pw) // 2, (h - ph) // 2, pw, ph))
