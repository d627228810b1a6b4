"""Laws of reading and writing video files, and what bad ones give."""

import os
import struct
import subprocess
import sys
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from pipeline.errors import OutputError, VideoError
from pipeline.vision.recordings.letterbox import letterbox_for, of_area
from pipeline.vision.recordings.video import read_clip, write_video


def numbered(count, height=64, width=96):
    """Frames (T, H, W, 3) uint8 whose grey value tells their number: 4 a frame."""
    return np.stack([np.full((height, width, 3), 4 * k, np.uint8) for k in range(count)])


def number(frame):
    return round(float(np.median(frame)) / 4)


def write_stamped(path, frames, times_ms):
    """A video whose frames have these time stamps, ms."""
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=1000, options={"crf": "4"})
        stream.width, stream.height, stream.pix_fmt = frames.shape[2], frames.shape[1], "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for frame, time in zip(frames, times_ms, strict=True):
            picture = av.VideoFrame.from_ndarray(frame, format="rgb24")
            picture.pts, picture.time_base = int(time), Fraction(1, 1000)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def turn_by_header(path, matrix):
    """Write a display matrix (a, b, c, d; of 1) into the track header of an mp4 file, as phones do."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 4 + 40
    a, b, c, d = (v << 16 for v in matrix)
    data[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(data)


def test_what_is_written_is_read_back_frame_by_frame(tmp_path, rng):
    smooth = cv2.resize(rng.integers(40, 216, (4, 6, 3), np.uint8), (96, 64), interpolation=cv2.INTER_CUBIC)
    frames = np.stack([np.roll(smooth, 2 * k, axis=1) for k in range(30)])
    write_video(tmp_path / "clip.mp4", frames, 30)
    clip = read_clip(tmp_path / "clip.mp4", size=(96, 64))
    assert clip.frames.shape == frames.shape
    read = clip.frames.astype(int)
    own = np.abs(read - frames).mean((1, 2, 3))  # the codec keeps less of colours than of lightness
    for step in (-1, 1):
        assert (own < 0.6 * np.abs(read - np.roll(frames, step, axis=0)).mean((1, 2, 3))).all()
    assert np.allclose(clip.times, np.arange(30) / 30)
    assert np.allclose(clip.source_times, clip.times, atol=1e-3)
    assert clip.source_fps == pytest.approx(30, rel=1e-3)
    assert clip.source_size == (96, 64)


def test_the_same_frames_give_the_same_bytes(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, numbered(8), 30)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mp4", "b.mp4"]


def test_the_bytes_do_not_depend_on_what_memory_held_before(rng, tmp_path):
    np.save(tmp_path / "noise.npy", rng.integers(0, 256, (4, 224, 336, 3), dtype=np.uint8))
    program = """
import sys, numpy
from pipeline.vision.recordings.video import write_video
write_video(sys.argv[2], numpy.load(sys.argv[1]))
"""
    written = []
    for filling in ("0", "1", "85", "170"):  # glibc fills fresh memory with it
        command = [sys.executable, "-c", program, "noise.npy", f"{filling}.mp4"]
        subprocess.run(command, cwd=tmp_path, env=os.environ | {"MALLOC_PERTURB_": filling}, check=True)
        written.append((tmp_path / f"{filling}.mp4").read_bytes())
    assert len(set(written)) == 1


def test_odd_sizes_are_padded_to_even_ones(tmp_path):
    write_video(tmp_path / "odd.mp4", numbered(3, 63, 95), 30)
    assert read_clip(tmp_path / "odd.mp4", seconds=0.1).source_size == (96, 64)


def test_a_place_that_cannot_be_written_to_is_named_and_nothing_is_left(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(OutputError, match="cannot write"):
        write_video(tmp_path / "file" / "clip.mp4", numbered(3), 30)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_frames_are_as_they_were_filmed_where_the_rate_varies(tmp_path, rng):
    times = np.cumsum(rng.choice([20, 30, 60], 60)) - 20
    write_stamped(tmp_path / "vfr.mp4", numbered(60), times)
    clip = read_clip(tmp_path / "vfr.mp4")
    shown = [number(f) for f in clip.frames]
    assert shown == list(range(len(shown)))
    assert np.allclose(clip.times, (times[shown] - times[0]) / 1000, atol=1e-3)
    assert times[len(shown)] - times[0] >= 960
    assert any("variable frame rate" in n for n in clip.notes)


def test_times_that_are_written_are_read_back(tmp_path, rng):
    times = np.cumsum(rng.uniform(0.02, 0.06, 20))
    write_video(tmp_path / "vfr.mp4", numbered(20), times)
    clip = read_clip(tmp_path / "vfr.mp4", seconds=None)
    assert [number(f) for f in clip.frames] == list(range(20))
    assert np.allclose(clip.times, times - times[0], atol=1e-4)


@pytest.mark.parametrize(
    ("rate", "seconds", "every"),
    [(24, 1, 1), (25, 1, 1), (29.97, 1, 1), (50, 1, 1), (60, 1, 2), (120, 0.5, 2), (120, 0.3, 1)],
)
def test_no_frame_repeats_and_of_many_every_second_third_is_kept(tmp_path, rate, seconds, every):
    count = round(rate * seconds)
    write_video(tmp_path / "clip.mp4", numbered(count), rate)
    clip = read_clip(tmp_path / "clip.mp4", seconds=seconds, fps=30)
    assert [number(f) for f in clip.frames] == list(range(0, count, every))
    assert np.allclose(np.diff(clip.times), every / rate, atol=1e-3)
    assert any("one frame of" in n for n in clip.notes) == (every > 1)


def test_a_start_between_frames_begins_with_the_nearest(tmp_path):
    write_video(tmp_path / "clip.mp4", numbered(60), 30)
    clip = read_clip(tmp_path / "clip.mp4", start=0.24, seconds=0.5)
    assert [number(f) for f in clip.frames] == list(range(7, 22))


def test_an_assumed_rate_overrules_the_header(tmp_path):
    write_video(tmp_path / "slow_motion.mp4", numbered(60), 30)
    clip = read_clip(tmp_path / "slow_motion.mp4", seconds=0.2, assume_fps=240)
    assert [number(f) for f in clip.frames] == list(range(48))
    assert np.allclose(clip.times, np.arange(48) / 240)
    assert clip.source_fps == 240
    assert any("240 FPS is used" in n for n in clip.notes)


def test_a_start_is_reached_by_decoding_and_by_seeking_alike(tmp_path):
    frames = np.concatenate([numbered(60)] * 3)
    write_video(tmp_path / "long.mp4", frames, 30)
    for start in (0.5, 1.9, 2.1, 4.0):
        clip = read_clip(tmp_path / "long.mp4", start=start, seconds=0.2, size=(96, 64))
        assert [number(f) for f in clip.frames] == [(round(start * 30) + k) % 60 for k in range(6)]
        assert np.allclose(clip.source_times, start + clip.times, atol=1e-3)


def test_a_recording_turned_by_its_header_is_read_upright(tmp_path):
    frames = numbered(6)
    frames[:, :16, :24] = 250  # the upper left corner
    write_video(tmp_path / "turned.mp4", frames, 30)
    turn_by_header(tmp_path / "turned.mp4", (0, 1, -1, 0))  # a quarter turn clockwise
    clip = read_clip(tmp_path / "turned.mp4", seconds=0.2, size=(64, 96))
    assert clip.source_size == (64, 96)
    assert clip.frames[0, :20, -12:].min() > 200  # now upper right
    assert clip.frames[0, :20, :12].max() < 60
    assert any("rotated by" in n for n in clip.notes)


@pytest.mark.parametrize("source", [(1080, 1920), (1920, 1080), (640, 480), (480, 320), (172, 1716), (90, 60)])
def test_a_picture_is_scaled_evenly(source):
    width, height = of_area(source, 480 * 320)
    assert width * height == pytest.approx(480 * 320, rel=0.01)
    assert width / height == pytest.approx(source[0] / source[1], rel=0.01)


@pytest.mark.parametrize("source", [(640, 480), (1920, 1080), (480, 320), (54, 96)])
def test_another_shape_is_kept_whole_between_bars(rng, source):
    letterbox = letterbox_for(source, (480, 320))
    left, top, width, height = letterbox.place
    assert width / height == pytest.approx(source[0] / source[1], rel=0.01)
    assert abs(2 * left + width - 480) <= 1
    assert abs(2 * top + height - 320) <= 1
    assert (letterbox.note is None) == (source == (480, 320))
    picture = rng.integers(0, 256, (source[1], source[0], 3), np.uint8)
    assert letterbox.apply(picture).shape == (320, 480, 3)


def test_a_missing_file_a_folder_and_an_empty_file_are_named(tmp_path):
    with pytest.raises(VideoError, match=r"none\.mp4: there is no such file"):
        read_clip(tmp_path / "none.mp4")
    with pytest.raises(VideoError, match="is a folder"):
        read_clip(tmp_path)
    (tmp_path / "empty.mp4").touch()
    with pytest.raises(VideoError, match=r"empty\.mp4 is empty"):
        read_clip(tmp_path / "empty.mp4")


def test_a_file_that_is_no_video_is_named(tmp_path, rng):
    (tmp_path / "noise.mp4").write_bytes(rng.bytes(5000))
    with pytest.raises(VideoError, match=r"noise\.mp4 is not a video|has no video|is broken"):
        read_clip(tmp_path / "noise.mp4")


def test_a_video_cut_short_gives_what_is_there_or_says_how_much(tmp_path, rng):
    frames = rng.integers(0, 256, (60, 64, 96, 3), np.uint8)
    write_video(tmp_path / "whole.mp4", frames, 30)
    data = (tmp_path / "whole.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: len(data) // 4])
    with pytest.raises(VideoError, match=r"cut\.mp4 .*(is 0\.\d+ s long before it breaks off|is broken|s long)"):
        read_clip(tmp_path / "cut.mp4")


def test_one_frame_is_no_clip(tmp_path):
    write_video(tmp_path / "one.mp4", numbered(1), 30)
    with pytest.raises(VideoError, match="one frame only"):
        read_clip(tmp_path / "one.mp4")
    cv2.imwrite(str(tmp_path / "picture.png"), numbered(1)[0])
    with pytest.raises(VideoError, match="one frame only"):
        read_clip(tmp_path / "picture.png")


def test_a_video_shorter_than_asked_says_how_long_it_is(tmp_path):
    write_video(tmp_path / "short.mp4", numbered(20), 30)
    with pytest.raises(VideoError, match=r"is 0\.67 s long: a clip of 1 s from 0 s on does not fit"):
        read_clip(tmp_path / "short.mp4")
    with pytest.raises(VideoError, match=r"at most 0\.17 s do"):
        read_clip(tmp_path / "short.mp4", start=0.5, seconds=0.5)


@pytest.mark.parametrize("start", [1.0, 5.0])
def test_a_start_after_the_end_is_an_error(tmp_path, start):
    write_video(tmp_path / "short.mp4", numbered(20), 30)
    with pytest.raises(VideoError, match=rf"{start:g} s is after its end"):
        read_clip(tmp_path / "short.mp4", start=start)


@pytest.mark.parametrize("asked", [{"seconds": 0}, {"seconds": -1}, {"start": -0.1}, {"assume_fps": 0}])
def test_a_clip_of_nothing_is_an_error(tmp_path, asked):
    write_video(tmp_path / "clip.mp4", numbered(40), 30)
    with pytest.raises(VideoError):
        read_clip(tmp_path / "clip.mp4", **asked)


@pytest.mark.parametrize(
    "text", ["#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nsound.mp4\n", "ffconcat version 1.0\nfile sound.mp4\n"]
)
def test_a_playlist_that_names_other_files_is_refused(tmp_path, text):
    write_video(tmp_path / "sound.mp4", np.zeros((10, 32, 48, 3), np.uint8))
    (tmp_path / "list.mp4").write_text(text)
    with pytest.raises(VideoError, match=r"list\.mp4 is not a video"):
        read_clip(tmp_path / "list.mp4", 0.0, 0.2)
