"""Video files: any recording to frames at regular times and one size, and frames to a file that browsers play.

PyAV is used: its wheel brings FFmpeg, gives every frame's own time stamp and the rotation that phones write, and
encodes H.264. OpenCV's wheel does neither of the last two reliably.
"""

from __future__ import annotations

import contextlib
import platform
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from pipeline.errors import OutputError, VideoError

SIZE = (480, 320)  # px, width and height
FPS = 30.0
KEPT_SHARE = 0.6  # of the picture; where cropping would keep less, bars are added instead
SEEK_FROM = 2.0  # s; earlier starts are reached by decoding


@dataclass(frozen=True)
class Fit:
    """How a source picture of `source` (width, height) px becomes one of `size`: the window that is kept
    (left, top, width, height; source px) and the place it takes (left, top, width, height; target px)."""

    source: tuple[int, int]
    size: tuple[int, int]
    window: tuple[int, int, int, int]
    place: tuple[int, int, int, int]

    def apply(self, picture: np.ndarray, nearest: bool = False) -> np.ndarray:
        """(h, w, ...) of the source to (H, W, ...). Bars take the median colour of the picture's border, or 0."""
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


@dataclass(frozen=True)
class Clip:
    """frames: (T, H, W, 3) uint8 RGB. times: (T,) s from the clip's start, regular. source_times: (T,) s, when each
    frame was recorded, from the file's first. source_size: (width, height) px, upright. notes: what was changed or
    assumed, a sentence each."""

    frames: np.ndarray
    times: np.ndarray
    source_times: np.ndarray
    source_fps: float
    source_size: tuple[int, int]
    fit: Fit
    notes: list[str] = field(default_factory=list)


def fit_to(source: tuple[int, int], size: tuple[int, int]) -> tuple[Fit, str | None]:
    """The fit of a source to a size, both (width, height) px, and a note where their shapes differ.

    The middle is cut out, which keeps square pixels and the optical axis in the middle and only narrows the field of
    view. Where that would keep less than KEPT_SHARE of the picture (portrait), bars are added instead.
    """
    (sw, sh), (w, h) = source, size
    ratio = (sw / sh) / (w / h)
    if abs(ratio - 1) < 0.01:
        return Fit(source, size, (0, 0, sw, sh), (0, 0, w, h)), None
    if min(ratio, 1 / ratio) >= KEPT_SHARE:
        kw, kh = (round(sh * w / h), sh) if ratio > 1 else (sw, round(sw * h / w))
        side = "horizontal" if ratio > 1 else "vertical"
        note = (
            f"cropped from {sw}x{sh} to the middle {kw}x{kh}: the camera that is found has "
            f"{min(ratio, 1 / ratio):.0%} of the recording's {side} field of view (as a tangent)"
        )
        return Fit(source, size, ((sw - kw) // 2, (sh - kh) // 2, kw, kh), (0, 0, w, h)), note
    pw, ph = (w, round(w * sh / sw)) if ratio > 1 else (round(h * sw / sh), h)
    note = (
        f"{sw}x{sh} is far from {w}x{h} in shape: the whole picture is kept, {pw}x{ph} between bars; objects that "
        "leave it vanish behind them"
    )
    return Fit(source, size, (0, 0, sw, sh), ((w - pw) // 2, (h - ph) // 2, pw, ph)), note


def read_clip(
    path: Path | str,
    start: float = 0.0,
    seconds: float = 1.0,
    fps: float = FPS,
    size: tuple[int, int] = SIZE,
    assume_fps: float | None = None,
) -> Clip:
    """`seconds` of a video from `start` (s) on, as round(seconds * fps) frames of `size` (width, height).

    Each frame is the one recorded nearest to its time, by the file's own time stamps (so a variable frame rate is
    no matter), or by counting frames at `assume_fps` where the header is wrong, as in slow motion. Then `start` and
    `seconds` too are in that time. Raises VideoError.
    """
    path = Path(path)
    count = round(seconds * fps)
    if not (seconds > 0 and fps > 0 and start >= 0 and count >= 2):
        raise VideoError(
            f"{path}: start {start:g} s, {seconds:g} s at {fps:g} FPS is no clip: start is 0 or more, and at least 2 "
            "frames are needed"
        )
    if assume_fps is not None and not 0 < assume_fps < float("inf"):
        raise VideoError(f"{path}: a recording has a positive frame rate, not {assume_fps:g}")
    check_file(path)
    decoder = Decoder(path, start, assume_fps)
    fit: Fit | None = None
    note = None
    frames: list[np.ndarray] = []
    recorded: list[float] = []
    wanted = start + np.arange(count) / fps
    before: tuple[float, np.ndarray] | None = None
    for time, picture in decoder:
        if fit is None:
            fit, note = fit_to((picture.shape[1], picture.shape[0]), size)
        if before is not None:
            while len(frames) < count and wanted[len(frames)] <= (before[0] + time) / 2:
                frames.append(fit.apply(before[1]))
                recorded.append(before[0])
        before = (time, picture)
        if len(frames) == count:
            break
    decoder.close()
    check_decoded(path, decoder, start)
    assert before is not None
    assert fit is not None
    slack = 0.5 * max(1 / fps, decoder.interval) + 1e-6
    while len(frames) < count and wanted[len(frames)] <= before[0] + slack:
        frames.append(fit.apply(before[1]))
        recorded.append(before[0])
    if len(frames) < count:
        end = before[0] + decoder.interval
        broken = " before it breaks off" if decoder.broken else ""
        raise VideoError(
            f"{path} is {end:.2f} s long{broken}: {seconds:g} s from {start:g} s on do not fit, "
            f"{max(end - start, 0):.2f} s would"
        )
    notes = [*decoder.notes(assume_fps), *([note] if note else []), *repeats(recorded, fps)]
    return Clip(
        np.stack(frames),
        np.arange(count) / fps,
        np.array(recorded),
        decoder.fps,
        fit.source,
        fit,
        notes,
    )


def frame_times(path: Path | str, assume_fps: float | None = None) -> np.ndarray:
    """Times (N,), s from the first, of all frames of a video, from its packets, without decoding. Raises VideoError."""
    decoder = Decoder(Path(path), 0.0, None)
    try:
        stamps = [p.pts for p in decoder.container.demux(decoder.stream) if p.pts is not None]
    except av.FFmpegError as error:
        raise VideoError(f"{path} is broken: its frames cannot be counted") from error
    finally:
        decoder.close()
    if assume_fps is not None:
        return np.arange(len(stamps)) / assume_fps
    return np.unique(np.array(stamps, float) * float(decoder.stream.time_base or 1)) - decoder.first


def check_file(path: Path) -> None:
    if not path.exists():
        raise VideoError(f"{path}: there is no such file")
    if path.is_dir():
        raise VideoError(f"{path} is a folder, not a video file")
    try:
        with path.open("rb") as file:
            if not file.read(1):
                raise VideoError(f"{path} is empty (0 bytes)")
    except OSError as error:
        raise VideoError(f"{path} cannot be read: {error.strerror}") from error


def check_decoded(path: Path, decoder: Decoder, start: float) -> None:
    if decoder.count == 0 and start > 0 and not decoder.broken:
        raise VideoError(f"{path}: {start:g} s is after its end")
    if decoder.count == 0:
        raise VideoError(f"{path} is broken: not one frame of it can be decoded")
    if decoder.count == 1 and not decoder.seeked:
        raise VideoError(f"{path} has one frame only: motion needs two or more")
    if start > decoder.last + decoder.interval:
        raise VideoError(f"{path} is {decoder.last + decoder.interval:.2f} s long: {start:g} s is after its end")


def repeats(recorded: list[float], fps: float) -> list[str]:
    """A note on frames that had to be shown twice, since the recording has fewer."""
    same = int((np.diff(recorded) <= 0).sum())
    if not same:
        return []
    return [f"{same} of {len(recorded)} frames repeat the one before: the recording has fewer than {fps:g} a second"]


class Decoder:
    """Iterates over (time, s from the first frame; upright RGB picture (h, w, 3) uint8) of a video file."""

    def __init__(self, path: Path, start: float, assume_fps: float | None) -> None:
        self.path = path
        self.assume_fps = assume_fps
        self.count = 0
        self.last = 0.0
        self.broken = False
        self.seeked = False
        self.rotation = 0
        self._steps: list[float] = []
        try:
            self.container = av.open(str(path))
        except (av.FFmpegError, OSError, ValueError) as error:
            raise VideoError(f"{path} is not a video that FFmpeg can read, or it is broken") from error
        if not self.container.streams.video:
            self.container.close()
            raise VideoError(f"{path} has no video stream")
        self.stream = self.container.streams.video[0]
        self.stream.thread_type = "AUTO"
        rate = self.stream.average_rate or self.stream.guessed_rate
        self.header_fps = float(rate) if rate else FPS
        self.aspect = float(self.stream.sample_aspect_ratio or 1) or 1.0
        self.tick = float(self.stream.time_base or 1)
        self.first = (self.stream.start_time or 0) * self.tick
        if start > SEEK_FROM and assume_fps is None:
            self._seek(start)

    def _seek(self, start: float) -> None:
        try:
            self.container.seek(int((self.first + start) / self.tick), stream=self.stream)
            self.seeked = True
        except av.FFmpegError:
            pass  # decode from the beginning, then

    @property
    def interval(self) -> float:
        """Median time between two frames, s."""
        return float(np.median(self._steps)) if self._steps else 1 / (self.assume_fps or self.header_fps)

    @property
    def fps(self) -> float:
        return self.assume_fps or 1 / self.interval

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        try:
            for frame in self.container.decode(self.stream):
                time = self._time(frame)
                if self.count and time <= self.last:
                    continue  # a damaged stream may repeat or turn back its stamps
                if self.count:
                    self._steps.append(time - self.last)
                self.count, self.last = self.count + 1, time
                yield time, self._upright(frame)
        except (av.FFmpegError, ValueError):
            self.broken = True

    def _time(self, frame: av.VideoFrame) -> float:
        if self.assume_fps is not None:
            return self.count / self.assume_fps
        if frame.time is None:
            return self.last + 1 / self.header_fps if self.count else 0.0
        return float(frame.time) - self.first

    def _upright(self, frame: av.VideoFrame) -> np.ndarray:
        picture: np.ndarray = frame.to_ndarray(format="rgb24")
        if abs(self.aspect - 1) > 0.005:
            picture = cv2.resize(picture, (round(picture.shape[1] * self.aspect), picture.shape[0]))
        self.rotation = round(frame.rotation / 90) * 90 % 360
        return np.rot90(picture, self.rotation // 90)  # both count anticlockwise

    def notes(self, assume_fps: float | None) -> list[str]:
        out = []
        if assume_fps is not None and abs(assume_fps / self.header_fps - 1) > 0.005:
            out.append(f"the header says {self.header_fps:.4g} FPS; {assume_fps:g} FPS was assumed as told")
        elif assume_fps is None:
            out.append(f"time base: the file's own time stamps, {self.fps:.4g} FPS")
        steps = np.array(self._steps)
        if assume_fps is None and len(steps) > 2 and np.ptp(np.quantile(steps, [0.02, 0.98])) > 0.25 * np.median(steps):
            out.append(
                f"variable frame rate, intervals of {steps.min() * 1e3:.0f} to {steps.max() * 1e3:.0f} ms: resampled "
                "by time stamps"
            )
        if self.rotation:
            out.append(f"turned upright by {self.rotation} degrees anticlockwise, as the file says")
        if abs(self.aspect - 1) > 0.005:
            out.append(f"pixels {self.aspect:.3g} times as wide as high were made square")
        if self.broken:
            out.append(f"the file breaks off after {self.last:.2f} s")
        return out

    def close(self) -> None:
        self.container.close()


# With AVX-512, x264 reads memory that nobody wrote, and the bytes then vary from run to run.
_NO_AVX512 = {"x264-params": "asm=sse4.2"} if platform.machine() in ("x86_64", "AMD64") else {}
_X264 = {"crf": "18", "threads": "1"} | _NO_AVX512


def write_video(path: Path | str, frames: np.ndarray, fps: float = FPS) -> None:
    """(T, H, W, 3) uint8 RGB to an H.264 mp4 (yuv420p, playable while it loads), renamed when complete.

    An odd width or height gets its last column or row twice. Raises OutputError.
    """
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    padding = ((0, 0), (0, frames.shape[1] % 2), (0, frames.shape[2] % 2), (0, 0))
    frames = np.pad(np.asarray(frames, np.uint8), padding, mode="edge")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(temporary), "w", format="mp4", options={"movflags": "+faststart"}) as container:
            encode(container, frames, Fraction(fps).limit_denominator(1001))
        temporary.replace(path)
    except (OSError, av.FFmpegError) as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def encode(container: av.container.OutputContainer, frames: np.ndarray, rate: Fraction) -> None:
    name, options = ("libx264", _X264) if "libx264" in av.codecs_available else ("mpeg4", {})
    stream = container.add_stream(name, rate=rate, options=options)
    assert isinstance(stream, av.VideoStream)
    stream.width, stream.height, stream.pix_fmt = frames.shape[2], frames.shape[1], "yuv420p"
    for frame in frames:
        container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
    container.mux(stream.encode())
