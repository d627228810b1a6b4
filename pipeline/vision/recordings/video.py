"""Video files: reading frames as they were filmed, and writing files that browsers play.

PyAV is used because its wheel includes FFmpeg, gives the time stamp of each frame and the rotation that phones record,
and encodes H.264. OpenCV's wheel does the last two unreliably.
"""

from __future__ import annotations

import contextlib
import math
import platform
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from pipeline.errors import OutputError, VideoError
from pipeline.untrusted import MOST_PIXELS, open_untrusted
from pipeline.vision.recordings.letterbox import Letterbox, letterbox_for, of_area

FPS = 30.0  # frames a second that are enough of a film
LEAST_FRAMES = 30  # which of a clip in slow motion are kept even so
AREA = 480 * 320  # px² of the pictures in which clips are compared
MOST_BYTES = 2**30  # of the frames of a clip in its own size
CLOCK = Fraction(1, 90_000)  # s, of the time stamps that are written
ROUNDING = 0.005  # of ratios that a header states: a smaller difference from 1 is none
STEADY = 0.02  # intervals between frames that differ by a smaller share are equal
SEEK_FROM = 2.0  # s; up to there frames are decoded from the beginning


@dataclass(frozen=True)
class Clip:
    """A part of a video, in frames that were filmed, each once.

    Attributes:
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s from the first of them.
        source_times: (T,) s from the first frame of the file.
        source_fps: Frame rate of the recording.
        source_size: (width, height) px, upright.
        letterbox: From the upright recording to `frames`.
        file_notes: What the file needed or was assumed to be, a sentence each.
    """

    frames: np.ndarray
    times: np.ndarray
    source_times: np.ndarray
    source_fps: float
    source_size: tuple[int, int]
    letterbox: Letterbox
    file_notes: list[str] = field(default_factory=list)

    @property
    def notes(self) -> list[str]:
        """What was changed or assumed, a sentence each."""
        return [*self.file_notes, *([self.letterbox.note] if self.letterbox.note else [])]


def read_clip(
    path: Path | str,
    start: float = 0.0,
    seconds: float | None = 1.0,
    *,
    fps: float | None = None,
    size: tuple[int, int] | None = None,
    assume_fps: float | None = None,
) -> Clip:
    """Read the frames of a part of a video as they were filmed, by the time stamps of the file.

    Args:
        path: Video file.
        start: Start of the clip, s: of the first frame, or up to half an interval before it.
        seconds: Length of the clip, s; None: to the end of the file.
        fps: Frames a second that are enough: of a file with twice as many or more, every second, third … is left out,
            down to LEAST_FRAMES. None: all are kept.
        size: (width, height) px; None: the recording's own, or as large as `MOST_BYTES` allow.
        assume_fps: Frame rate that replaces the time stamps where they are wrong, as in slow motion. `start` and
            `seconds` then refer to that time.

    Raises:
        VideoError: The file is not a readable video, or the clip is not within it.
    """
    path = Path(path)
    if seconds is None:
        check_file(path)
        seconds = max(float(frame_times(path, assume_fps).max(initial=0)) - start, 0) + 1 / FPS
    if not (0 < seconds < np.inf and 0 <= start < np.inf):
        raise VideoError(
            f"{path}: {seconds:g} s from {start:g} s is not a valid clip: the start must be 0 or more, the length more"
        )
    if assume_fps is not None and not 0 < assume_fps < float("inf"):
        raise VideoError(f"{path}: the frame rate must be positive and finite, not {assume_fps:g}")
    check_file(path)
    decoder = Decoder(path, start, assume_fps)
    rate = assume_fps or decoder.header_fps
    early, every = 0.5 / rate, 1 if fps is None else thinning(rate, seconds, fps)
    letterbox: Letterbox | None = None
    frames: list[np.ndarray] = []
    recorded: list[float] = []
    within = 0
    for time, picture in decoder:
        if time >= start + seconds - early - 1e-9:
            break
        if time < start - early - 1e-9:
            continue
        if letterbox is None:
            source = (picture.shape[1], picture.shape[0])
            letterbox = letterbox_for(source, size or largest_size(source, round(seconds * rate / every) + 1))
        if within % every == 0:
            frames.append(letterbox.apply(picture))
            recorded.append(time)
        within += 1
    decoder.close()
    check_decoded(path, decoder, start)
    end = decoder.last + decoder.interval
    if start + seconds > end + max(decoder.interval, 1 / FPS):
        broken = " before it breaks off" if decoder.broken else ""
        raise VideoError(
            f"{path} is {end:.2f} s long{broken}: a clip of {seconds:g} s from {start:g} s on does not fit; at most "
            f"{max(end - start, 0):.2f} s do"
        )
    if len(frames) < 2:
        raise VideoError(f"{path}: {seconds:g} s from {start:g} s on have fewer than 2 frames at {rate:.4g} FPS")
    assert letterbox is not None
    return Clip(
        frames=np.stack(frames),
        times=np.array(recorded) - recorded[0],
        source_times=np.array(recorded),
        source_fps=decoder.fps,
        source_size=letterbox.source,
        letterbox=letterbox,
        file_notes=decoder.notes(assume_fps, every),
    )


def thinning(rate: float, seconds: float, fps: float) -> int:
    """Every how many frames of a film, `rate` a second, one is kept, so that `fps` or LEAST_FRAMES are left."""
    return max(1, min(math.floor(rate / fps + 0.1), math.floor(rate * seconds / LEAST_FRAMES + 0.01)))


def largest_size(source: tuple[int, int], count: int) -> tuple[int, int]:
    """The recording's size (width, height), px, made smaller where `count` frames would take more than `MOST_BYTES`."""
    return of_area(source, min(source[0] * source[1], MOST_BYTES / (3 * count)))


def scaled(clip: Clip, size: tuple[int, int] | None = None) -> Clip:
    """A clip in its own size brought to another (width, height), px; None: evenly to AREA."""
    height, width = clip.frames.shape[1:3]
    wanted = size or of_area(clip.source_size, AREA)
    fitted = letterbox_for((width, height), wanted)
    frames = clip.frames if (width, height) == wanted else np.stack([fitted.apply(f) for f in clip.frames])
    return replace(clip, frames=frames, letterbox=letterbox_for(clip.source_size, wanted))


def nearest_frames(clip: Clip, fps: float, count: int) -> np.ndarray:
    """(count,) the frames of a clip that are nearest to regular times, `fps` a second."""
    return np.asarray(np.abs(clip.times - np.arange(count)[:, None] / fps).argmin(1))


def frame_times(path: Path | str, assume_fps: float | None = None) -> np.ndarray:
    """Times (N,) of all frames of a video, s from the first, read from its packets. Raises VideoError."""
    decoder = Decoder(Path(path), 0.0, None)
    try:
        stamps = [p.pts for p in decoder.container.demux(decoder.stream) if p.pts is not None]
    except av.FFmpegError as error:
        raise VideoError(f"{path} is broken: its frames cannot be counted") from error
    finally:
        decoder.close()
    if assume_fps is not None:
        return np.arange(len(stamps)) / assume_fps
    return np.unique(np.array(stamps, float) * decoder.tick) - decoder.first


def check_file(path: Path) -> None:
    with open_untrusted(path, VideoError) as file:
        if not file.read(1):
            raise VideoError(f"{path} is empty (0 bytes)")


def check_decoded(path: Path, decoder: Decoder, start: float) -> None:
    if decoder.count == 0 and start > 0 and not decoder.broken:
        raise VideoError(f"{path}: {start:g} s is after its end")
    if decoder.count == 0:
        raise VideoError(f"{path} is broken: none of its frames can be decoded")
    if decoder.count == 1 and not decoder.seeked:
        raise VideoError(f"{path} has one frame only: at least two are needed")
    if start > decoder.last + decoder.interval:
        raise VideoError(f"{path} is {decoder.last + decoder.interval:.2f} s long: {start:g} s is after its end")


#: A playlist may name other files and addresses; containers that hold their own pictures are opened, and nothing else.
_ONLY_FILES = {
    "protocol_whitelist": "file",
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,ogg,flv,asf,gif,apng,ivf,"
    "h264,hevc,av1,m4v,mjpeg,nut,yuv4mpegpipe,wtv,mxf,dv,rm,obu,swf,webp_pipe,image2,png_pipe",
}


class Decoder:
    """Iterates over the frames of a video file: time, s from the first, and upright RGB picture (h, w, 3) uint8."""

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
            self.container = av.open(f"file:{path}", options=_ONLY_FILES)
        except (av.FFmpegError, OSError, ValueError) as error:
            raise VideoError(f"{path} is not a video that FFmpeg can read, or it is broken") from error
        if not self.container.streams.video:
            self.container.close()
            raise VideoError(f"{path} has no video stream")
        self.stream = self.container.streams.video[0]
        self.stream.thread_type = "AUTO"
        coded = self.stream.codec_context
        if coded is None:
            self.container.close()
            raise VideoError(f"{path} is broken, or coded in a way that FFmpeg does not know")
        if coded.width * coded.height > MOST_PIXELS:
            self.container.close()
            raise VideoError(f"{path} is {coded.width} x {coded.height} px; that is too large")
        rate = self.stream.average_rate or self.stream.guessed_rate
        self.header_fps = float(rate) if rate else FPS
        aspect = float(self.stream.sample_aspect_ratio or 1)
        self.aspect = aspect if 0.1 < aspect < 10 and abs(aspect - 1) > ROUNDING else 1.0  # beyond 10: damage
        self.tick = float(self.stream.time_base or 1)
        self.first = (self.stream.start_time or 0) * self.tick
        if start > SEEK_FROM and assume_fps is None:
            self._seek(start)

    def _seek(self, start: float) -> None:
        try:
            self.container.seek(int((self.first + start) / self.tick), stream=self.stream)
            self.seeked = True
        except av.FFmpegError:
            pass  # decode from the beginning instead

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
                    continue  # time stamps of a damaged stream may repeat or go back
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
        if self.aspect != 1:
            picture = cv2.resize(picture, (round(picture.shape[1] * self.aspect), picture.shape[0]))
        self.rotation = round(frame.rotation / 90) * 90 % 360
        return np.rot90(picture, self.rotation // 90)  # both count anticlockwise

    def notes(self, assume_fps: float | None, every: int) -> list[str]:
        """What the file needed or was assumed to be, a sentence each; every: of so many frames one was kept."""
        out = []
        if assume_fps is not None and abs(assume_fps / self.header_fps - 1) > ROUNDING:
            out.append(f"the header says {self.header_fps:.4g} FPS; {assume_fps:g} FPS is used as given")
        elif assume_fps is None:
            out.append(f"time base: the time stamps of the file, {self.fps:.4g} FPS")
        steps = np.array(self._steps)
        if assume_fps is None and len(steps) > 2 and np.ptp(np.quantile(steps, [0.02, 0.98])) > 0.25 * np.median(steps):
            out.append(
                f"variable frame rate, intervals of {steps.min() * 1e3:.0f} to {steps.max() * 1e3:.0f} ms: each frame "
                "counts at its own time"
            )
        if every > 1:
            out.append(f"one frame of {every} is used, {self.fps / every:.4g} a second")
        if self.rotation:
            out.append(f"rotated by {self.rotation} degrees anticlockwise, as the file states")
        if self.aspect != 1:
            out.append(f"pixels that are {self.aspect:.3g} times as wide as high were made square")
        if self.broken:
            out.append(f"the file breaks off after {self.last:.2f} s")
        return out

    def close(self) -> None:
        self.container.close()


# With AVX-512, x264 reads uninitialised memory, and the bytes then vary from run to run.
_NO_AVX512 = {"x264-params": "asm=sse4.2"} if platform.machine() in ("x86_64", "AMD64") else {}
_X264 = {"crf": "18", "threads": "1"} | _NO_AVX512


def write_video(path: Path | str, frames: np.ndarray, fps: float | np.ndarray = FPS) -> None:
    """Write frames (T, H, W, 3) uint8 RGB as H.264 mp4 (yuv420p, playable while it loads).

    fps: Frames a second, or (T,) s, when each of them is shown.

    The file gets its name when it is complete. An odd width or height is padded with the last column or row. Raises
    OutputError.
    """
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    padding = ((0, 0), (0, frames.shape[1] % 2), (0, frames.shape[2] % 2), (0, 0))
    frames = np.pad(np.asarray(frames, np.uint8), padding, mode="edge")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(temporary), "w", format="mp4", options={"movflags": "+faststart"}) as container:
            encode(container, frames, fps)
        temporary.replace(path)
    except (OSError, av.FFmpegError) as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def encode(container: av.container.OutputContainer, frames: np.ndarray, fps: float | np.ndarray) -> None:
    """Encode frames (T, H, W, 3); fps: as of `write_video`."""
    name, options = ("libx264", _X264) if "libx264" in av.codecs_available else ("mpeg4", {})
    rate, times = (float(fps), None) if np.ndim(fps) == 0 else steady_rate(np.asarray(fps))
    stream = container.add_stream(name, rate=Fraction(rate).limit_denominator(1001), options=options)
    assert isinstance(stream, av.VideoStream)
    stream.width, stream.height, stream.pix_fmt = frames.shape[2], frames.shape[1], "yuv420p"
    if times is not None:
        stream.codec_context.time_base = CLOCK
    for k, picture in enumerate(frames):
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        if times is not None:
            frame.pts, frame.time_base = round((times[k] - times[0]) / CLOCK), CLOCK
        container.mux(stream.encode(frame))
    container.mux(stream.encode())


def steady_rate(times: np.ndarray) -> tuple[float, np.ndarray | None]:
    """The mean rate of times (T,), s, and the times where the intervals between them differ; else None."""
    steps = np.diff(times)
    return float(1 / steps.mean()), times if np.ptp(steps) > STEADY * steps.mean() else None
