"""Video files: reading frames at regular times in one size, and writing files that browsers play.

PyAV is used because its wheel includes FFmpeg, gives the time stamp of each frame and the rotation that phones record,
and encodes H.264. OpenCV's wheel does the last two unreliably.
"""

from __future__ import annotations

import contextlib
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
from pipeline.vision.recordings.letterbox import Letterbox, letterbox_for

SIZE = (480, 320)  # px, width and height
FPS = 30.0
MOST_BYTES = 2**30  # of the frames of a clip in its own size
SEEK_FROM = 2.0  # s; up to there frames are decoded from the beginning


@dataclass(frozen=True)
class Clip:
    """A part of a video at a regular frame rate.

    Attributes:
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s from the start of the clip, regular.
        source_times: (T,) s from the first frame of the file: when each frame was recorded.
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
        note = letterbox_for(self.letterbox.source, self.letterbox.size)[1]
        return [*self.file_notes, *([note] if note else []), *repeats(self.source_times.tolist(), 1 / self.times[1])]


def read_clip(
    path: Path | str,
    start: float = 0.0,
    seconds: float = 1.0,
    fps: float = FPS,
    size: tuple[int, int] | None = SIZE,
    assume_fps: float | None = None,
) -> Clip:
    """Read a part of a video as round(seconds * fps) frames.

    Each frame is the recorded one that is nearest in time, by the time stamps of the file. Variable frame rates are
    handled.

    Args:
        path: Video file.
        start: Start of the clip, s.
        seconds: Length of the clip, s.
        fps: Frame rate of the clip.
        size: (width, height) px; None: the recording's own, or as large as `MOST_BYTES` allow.
        assume_fps: Frame rate that replaces the time stamps where they are wrong, as in slow motion. `start` and
            `seconds` then refer to that time.

    Raises:
        VideoError: The file is not a readable video, or the clip is not within it.
    """
    path = Path(path)
    count = round(seconds * fps)
    if not (seconds > 0 and fps > 0 and start >= 0 and count >= 2):
        raise VideoError(
            f"{path}: {seconds:g} s from {start:g} s at {fps:g} FPS is not a valid clip: the start must be 0 or "
            "more, and at least 2 frames are needed"
        )
    if assume_fps is not None and not 0 < assume_fps < float("inf"):
        raise VideoError(f"{path}: the frame rate must be positive and finite, not {assume_fps:g}")
    check_file(path)
    decoder = Decoder(path, start, assume_fps)
    letterbox: Letterbox | None = None
    frames: list[np.ndarray] = []
    recorded: list[float] = []
    wanted = start + np.arange(count) / fps
    before: tuple[float, np.ndarray] | None = None
    for time, picture in decoder:
        if letterbox is None:
            source = (picture.shape[1], picture.shape[0])
            letterbox, _ = letterbox_for(source, size or largest_size(source, count))
        if before is not None:
            while len(frames) < count and wanted[len(frames)] <= (before[0] + time) / 2:
                frames.append(letterbox.apply(before[1]))
                recorded.append(before[0])
        before = (time, picture)
        if len(frames) == count:
            break
    decoder.close()
    check_decoded(path, decoder, start)
    assert before is not None
    assert letterbox is not None
    slack = max(0.5 / fps, decoder.interval - 0.5 / fps) + 1e-6  # the last frame is shown up to the recording's end
    while len(frames) < count and wanted[len(frames)] <= before[0] + slack:
        frames.append(letterbox.apply(before[1]))
        recorded.append(before[0])
    if len(frames) < count:
        end = before[0] + decoder.interval
        broken = " before it breaks off" if decoder.broken else ""
        raise VideoError(
            f"{path} is {end:.2f} s long{broken}: a clip of {seconds:g} s from {start:g} s on does not fit; at most "
            f"{max(end - start, 0):.2f} s do"
        )
    return Clip(
        frames=np.stack(frames),
        times=np.arange(count) / fps,
        source_times=np.array(recorded),
        source_fps=decoder.fps,
        source_size=letterbox.source,
        letterbox=letterbox,
        file_notes=decoder.notes(assume_fps),
    )


def largest_size(source: tuple[int, int], count: int) -> tuple[int, int]:
    """The recording's size (width, height), px, made smaller where `count` frames would take more than `MOST_BYTES`."""
    width, height = source
    scale = min(1.0, (MOST_BYTES / (count * width * height * 3)) ** 0.5)
    return round(width * scale), round(height * scale)


def resampled(clip: Clip, every: int, size: tuple[int, int] = SIZE) -> Clip:
    """A clip in its own size, reduced to its frames 0, every, 2 every … and brought to another size (width, height)."""
    height, width = clip.frames.shape[1:3]
    fitted, _ = letterbox_for((width, height), size)
    return replace(
        clip,
        frames=np.stack([fitted.apply(f) for f in clip.frames[::every]]),
        times=clip.times[::every],
        source_times=clip.source_times[::every],
        letterbox=letterbox_for(clip.source_size, size)[0],
    )


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
    return np.unique(np.array(stamps, float) * float(decoder.stream.time_base or 1)) - decoder.first


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


def repeats(recorded: list[float], fps: float) -> list[str]:
    """A note on frames that repeat because the recording has fewer."""
    same = int((np.diff(recorded) <= 0).sum())
    if not same:
        return []
    return [f"{same} of {len(recorded)} frames repeat the one before: the recording has fewer than {fps:g} a second"]


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
        self.aspect = aspect if 0.1 < aspect < 10 else 1.0  # others are damage
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
        if abs(self.aspect - 1) > 0.005:
            picture = cv2.resize(picture, (round(picture.shape[1] * self.aspect), picture.shape[0]))
        self.rotation = round(frame.rotation / 90) * 90 % 360
        return np.rot90(picture, self.rotation // 90)  # both count anticlockwise

    def notes(self, assume_fps: float | None) -> list[str]:
        out = []
        if assume_fps is not None and abs(assume_fps / self.header_fps - 1) > 0.005:
            out.append(f"the header says {self.header_fps:.4g} FPS; {assume_fps:g} FPS is used as given")
        elif assume_fps is None:
            out.append(f"time base: the time stamps of the file, {self.fps:.4g} FPS")
        steps = np.array(self._steps)
        if assume_fps is None and len(steps) > 2 and np.ptp(np.quantile(steps, [0.02, 0.98])) > 0.25 * np.median(steps):
            out.append(
                f"variable frame rate, intervals of {steps.min() * 1e3:.0f} to {steps.max() * 1e3:.0f} ms: resampled "
                "by time stamps"
            )
        if self.rotation:
            out.append(f"rotated by {self.rotation} degrees anticlockwise, as the file states")
        if abs(self.aspect - 1) > 0.005:
            out.append(f"pixels that are {self.aspect:.3g} times as wide as high were made square")
        if self.broken:
            out.append(f"the file breaks off after {self.last:.2f} s")
        return out

    def close(self) -> None:
        self.container.close()


# With AVX-512, x264 reads uninitialised memory, and the bytes then vary from run to run.
_NO_AVX512 = {"x264-params": "asm=sse4.2"} if platform.machine() in ("x86_64", "AMD64") else {}
_X264 = {"crf": "18", "threads": "1"} | _NO_AVX512


def write_video(path: Path | str, frames: np.ndarray, fps: float = FPS) -> None:
    """Write frames (T, H, W, 3) uint8 RGB as H.264 mp4 (yuv420p, playable while it loads).

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
