"""Real clips, one plain command each: bodies, view, overlap with drawn outlines, and what a teacher would check.

    python -m benchmarks.filmed [--search 2000] [--drawn-stretch] [--only NAME ...] [--out FOLDER]

Clips: benchmarks/outlines, whose videos are in DYNAMICS_DATA or ../shared/data. Each is asked for as `dynamics infer`
would be, with the frame rate at which it was shot, the length or size that its source gives, and at most one click. The
command chooses the stretch in which bodies move freely; --drawn-stretch gives it the one that has outlines, in which
somebody saw them move so. --out keeps each result's folder.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from benchmarks.drawn_outlines import DrawnClip, outline_mask, read_outlines
from benchmarks.mask_clips import OUTLINES
from pipeline.api.infer import Inference, infer
from pipeline.bodies.prompts import Prompts
from pipeline.clips.overlap import overlap
from pipeline.clips.replay import masks_at
from pipeline.errors import DynamicsError
from pipeline.inference.filmed_world import World
from pipeline.physics.simulate import simulate
from pipeline.report.markdown import heading, table_row
from pipeline.vision.recordings.letterbox import of_area
from pipeline.vision.recordings.video import AREA, frame_times
from training.data_folder import needed


@dataclass(frozen=True)
class Filmed:
    """What is known of a clip beside its outlines.

    Attributes:
        view: True view.
        size: Known size, as `World.of` takes it.
        length: Whether the length marks of the outlines' file are given.
        objects: How many bodies are asked for, where hands look like bodies, too.
        ignore: (x, y) px of what is no body: one click.
    """

    view: str
    size: tuple[int, str, float] | None = None
    length: bool = False
    objects: int | None = None
    ignore: tuple[float, float] | None = None


CLIPS = {
    "osp_BallTossOut": Filmed("flight", length=True, objects=1),
    "osp_airpucks_unequal": Filmed("top", length=True),
    "osp_ball_rolls_off_table": Filmed("side", length=True),
    "osp_cart_bounce_incline": Filmed("incline", length=True),
    "osp_pucks_collide": Filmed("top", length=True),
    "osp_pvcpipe_ramp17": Filmed("incline", length=True),
    "osp_pvcpipe_ramp42": Filmed("incline", length=True),
    "phys_CaromPuck_HeadOn": Filmed("top", objects=2),
    "phys_Projectile_Motion__45Deg_2_687mps": Filmed("flight", ignore=(38, 78)),  # its shadow on the wall
    "phys_RollingCylinder": Filmed("incline"),
    "phys_SlidingFriction_R1": Filmed("incline"),
    "physiq_ball_kettlebell": Filmed("table"),
    "redball_drop_120fps": Filmed("flight", length=True),
    "tennisball_toss_wall": Filmed("flight", size=(0, "radius", 0.0335)),
}


@dataclass(frozen=True)
class Check:
    """A number that a teacher would check: its clip, what it is, the value expected and its bound, both in `unit`.

    seconds: of the clip that the answer is fitted to; None: the whole stretch with drawn outlines.
    """

    clip: str
    what: str
    expected: float
    bound: float
    unit: str
    measure: Callable[[Inference], float]
    seconds: float | None = None


def gravity(found: Inference) -> float:
    return float(np.linalg.norm(found.scene.gravity))


def slope_deg(found: Inference) -> float:
    """Of the ramp in the scene."""
    (turn, *_) = (Rotation.from_quat(b.orientation, scalar_first=True) for b in found.scene.fixed)
    return abs(float(turn.as_euler("yxz", degrees=True)[0]))


def fitted_stretch(found: Inference) -> tuple[float, float]:
    """s of the recording, from where to where the stretch goes that the answer is fitted to."""
    times = found.clip.taken.clip.source_times
    return float(times[0]), float(2 * times[-1] - times[-2])


def acceleration(found: Inference) -> float:
    """m/s² of the scene's only body, from the parabola that is nearest to its simulated way."""
    begin, end = fitted_stretch(found)
    trace = simulate(found.scene, end - begin)
    times = np.arange(len(trace.position)) / trace.rate
    return float(np.linalg.norm(2 * np.polyfit(times, trace.position[:, 0], 2)[0]))


def launched(found: Inference) -> np.ndarray:
    """(2,) m/s of a thrown body LET_GO s after the recording begins, where the launcher lets it go."""
    velocity, pull = np.array(found.scene.objects[0].velocity), np.array(found.scene.gravity)
    return np.asarray((velocity - (fitted_stretch(found)[0] - LET_GO) * pull)[[0, 2]])


def momentum_kept(found: Inference) -> float:
    """Sum of the velocities after a collision of equal bodies over that before, along the latter."""
    sums = []
    for own in found.scenes.filmed.motion.arcs:
        sums.append((own[0].velocity, own[-1].velocity))
    before, after = np.sum([b for b, _ in sums], 0), np.sum([a for _, a in sums], 0)
    return float(after @ before / (before @ before))


def mass_ratio(found: Inference) -> float:
    masses = [o.mass for o in found.scene.objects]
    return max(masses) / min(masses)


def bounce_after(found: Inference, seconds: float, count: int) -> float:
    """s, when the scene's only body, simulated on, has its `count`-th turn at the lower end after a time, s."""
    trace = simulate(found.scene, seconds + 4.0)
    x = trace.position[:, 0, 0]
    turns = [k / trace.rate for k in range(1, len(x) - 1) if x[k] < x[k - 1] and x[k] <= x[k + 1]]
    return [t for t in turns if t > seconds][count - 1]


CHECKS = [
    Check(clip="osp_BallTossOut", what="gravity", expected=9.8, bound=0.69, unit="m/s²", measure=gravity),
    Check(clip="osp_ball_rolls_off_table", what="gravity", expected=9.8, bound=0.69, unit="m/s²", measure=gravity),
    Check(clip="redball_drop_120fps", what="gravity", expected=9.8, bound=0.69, unit="m/s²", measure=gravity),
    Check(clip="tennisball_toss_wall", what="gravity", expected=9.8, bound=0.69, unit="m/s²", measure=gravity),
    Check(
        clip="phys_Projectile_Motion__45Deg_2_687mps",
        what="speed of the throw",
        expected=2.687,
        bound=0.134,
        unit="m/s",
        measure=lambda f: float(np.linalg.norm(launched(f))),
    ),
    Check(
        clip="phys_Projectile_Motion__45Deg_2_687mps",
        what="angle of the throw",
        expected=45,
        bound=2,
        unit="deg",
        measure=lambda f: float(np.degrees(np.arctan2(launched(f)[1], abs(launched(f)[0])))),
    ),
    Check(clip="osp_pvcpipe_ramp17", what="slope", expected=17.6, bound=1.5, unit="deg", measure=slope_deg),
    Check(clip="osp_pvcpipe_ramp42", what="slope", expected=42.4, bound=1.5, unit="deg", measure=slope_deg),
    Check(
        clip="osp_pvcpipe_ramp17", what="acceleration", expected=1.59, bound=0.159, unit="m/s²", measure=acceleration
    ),
    Check(clip="osp_pvcpipe_ramp42", what="acceleration", expected=4.6, bound=0.46, unit="m/s²", measure=acceleration),
    Check(clip="phys_SlidingFriction_R1", what="slope", expected=22.0, bound=1.5, unit="deg", measure=slope_deg),
    Check(
        clip="osp_pucks_collide",
        what="momentum after over before",
        expected=1.0,
        bound=0.1,
        unit="",
        measure=momentum_kept,
    ),
    Check(clip="osp_airpucks_unequal", what="mass ratio", expected=1.35, bound=0.2, unit="", measure=mass_ratio),
    # Expected: the frames of the file, 138 and 173, in which the cart is nearest to the magnet, less the first one, 14.
    *(
        Check(
            clip="osp_cart_bounce_incline",
            what=what,
            expected=expected,
            bound=0.15,
            unit="s",
            measure=partial(bounce_after, seconds=4.0, count=count),
            seconds=4.0,
        )
        for count, what, expected in ((1, "next bounce after the first 4 s", 4.13), (2, "bounce after the next", 5.3))
    ),
]
LET_GO = 162 / 240  # s of phys_Projectile_Motion, where the launcher lets the ball go
CLICKED_PX = 3.0
# Tables of clicked centres, and the frame of this file that frame k of the table shows: k times the first number plus
# the second. Those of osp_airpucks_unequal are of another file.
CLICKED = {"osp_pucks_collide": ("osp_pucks_collide", 1, 0), "osp_BallTossOut": ("osp_balltoss_meterstick", 2, 6)}


def asked(clip: DrawnClip, video: Path, search: int, stretch: tuple[float | None, float | None]) -> Inference:
    """The answer to one plain command. stretch: begin and length, s; None: the command chooses."""
    known = CLIPS[video.stem]
    marks = clip.length_marks if known.length else None
    # Pixel centres have integer coordinates in the outlines, half integers in the library.
    length = None if marks is None else (*(marks.px + 0.5).ravel().tolist(), marks.m)
    return infer(
        video,
        start=stretch[0],
        seconds=stretch[1],
        fps=clip.fps if in_slow_motion(clip) else None,
        prompts=Prompts.of(objects=known.objects, ignore=() if known.ignore is None else (known.ignore,)),
        world=World.of(length=length, size=known.size),
        search=search,
    )


def drawn_stretch(clip: DrawnClip) -> tuple[float, float]:
    """Begin and length, s, of the stretch with drawn outlines, in which the bodies move freely."""
    first, last = clip.stretch_frames
    return first / clip.fps, (last - first) / clip.fps


def in_slow_motion(clip: DrawnClip) -> bool:
    """Whether the file's header has another frame rate than the film."""
    return abs(clip.fps / clip.file_fps - 1) > 0.05


def drawn_iou(clip: DrawnClip, found: Inference, video: Path) -> float | None:
    """Sequence IoU of the answer's replay with the outlines drawn in its stretch; None where that has no outlines."""
    names = [name for name, _ in clip.objects]
    stamps = frame_times(video, clip.fps if in_slow_motion(clip) else None)
    begin, end = fitted_stretch(found)
    within = (stamps >= begin - 0.5 / clip.fps) & (stamps <= end)
    frames = sorted(k for k in clip.frames if within[k])
    if not frames:
        return None
    size = of_area((clip.width, clip.height), AREA)
    masks = np.zeros((len(frames), size[1], size[0]), np.uint8)
    for mask, k in zip(masks, frames, strict=True):
        for outline in clip.frames[k]:
            whole = outline_mask([outline.polygon], clip.width, clip.height)
            mask[cv2.resize(whole, size, interpolation=cv2.INTER_NEAREST) > 0] = names.index(outline.object) + 1
    times = np.maximum(stamps[frames] - begin, 0)
    return overlap(masks_at(found.scene, times, *size), masks, len(found.scene.objects), len(names)).sequence


def clicked_distance(
    clip: DrawnClip, found: Inference, stamps: np.ndarray, clicks: pd.DataFrame
) -> tuple[float, float]:
    """Median and largest distance, px of the video, of the tracks from clicked centres, bodies as they are nearest.

    Args:
        clip: The clip.
        found: The answer.
        stamps: (N,) s, of the file's frames.
        clicks: With the columns object, frame (of the file), x_px and y_px.
    """
    filmed = found.scenes.filmed
    px = clip.width / filmed.masks.shape[2]
    distances = []
    for _, rows in clicks.groupby("object"):
        each = []
        for track in filmed.motion.tracks:
            times = stamps[rows["frame"].to_numpy()] - fitted_stretch(found)[0]
            inside = (times >= track.times[0] - 1e-6) & (times <= track.times[-1] + 1e-6)
            place = np.stack([np.interp(times[inside], track.times, px * track.centre[:, k]) for k in (0, 1)], 1)
            each.append(np.linalg.norm(place - rows[["x_px", "y_px"]].to_numpy()[inside], axis=1))
        distances.append(min(each, key=lambda d: float(np.median(d)) if len(d) else np.inf))
    every = np.concatenate(distances)
    return float(np.median(every)), float(every.max())


def row(clip: DrawnClip, found: Inference, video: Path, seconds: float) -> tuple[list[str], float | None]:
    """A row of the table, and the IoU with the drawn outlines, where there are any."""
    kinds = "+".join(sorted(shape for _, shape in clip.objects))
    iou = drawn_iou(clip, found, video)
    view, true = found.scenes.view.kind, CLIPS[Path(clip.clip).stem].view
    seen_right = view == true or {view, true} == {"side", "flight"}
    marks = f"{'' if found.scene.composition == kinds else 'not '}{kinds}", f"{'' if seen_right else 'not '}{true}"
    begin, end = fitted_stretch(found)
    seen = [
        f"{found.scene.composition} ({marks[0]})",
        f"{view} ({marks[1]})",
        "no outlines" if iou is None else f"{iou:.2f}",
    ]
    graded = [found.grade.name, found.best.name, f"{begin:.2f} to {end:.2f}", f"{seconds:.0f}"]
    return [Path(clip.clip).stem, *seen, *graded], iou


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--search", type=int, default=2000)
    parser.add_argument("--drawn-stretch", action="store_true", help="give the stretch that has outlines")
    parser.add_argument("--only", nargs="*", default=[], choices=sorted(CLIPS), metavar="NAME")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args(argv)
    folder = needed("real_video")
    answers: dict[str, Inference] = {}
    ious = []
    print(heading(["clip", "bodies", "view", "IoU, drawn outlines", "grade", "by", "stretch, s", "time, s"]))
    clips = {Path(clip.clip).stem: clip for clip in read_outlines(OUTLINES)}
    for name, clip in clips.items():
        if arguments.only and name not in arguments.only:
            continue
        start = time.monotonic()
        try:
            stretch = drawn_stretch(clip) if arguments.drawn_stretch else (None, None)
            found = asked(clip, folder / clip.clip, arguments.search, stretch)
        except DynamicsError as error:
            print(table_row([name, str(error), "", "0", "", "", "", ""]), flush=True)
            ious.append(0.0)
            continue
        cells, iou = row(clip, found, folder / clip.clip, time.monotonic() - start)
        print(table_row(cells), flush=True)
        ious += [] if iou is None else [iou]
        answers[name] = found
        if arguments.out is not None:
            found.save(arguments.out / name, force=True)
    print(f"\nmean IoU {np.mean(ious):.3f} of {len(ious)} clips whose stretch has outlines\n")
    print(heading(["clip", "what", "expected", "bound", "found", ""]))
    shorter: dict[tuple[str, float], Inference] = {}
    for check in CHECKS:
        if check.clip not in answers:
            continue
        found = answers[check.clip]
        if check.seconds is not None:
            key = check.clip, check.seconds
            if key not in shorter:
                start = drawn_stretch(clips[check.clip])[0]
                video = folder / clips[check.clip].clip
                shorter[key] = asked(clips[check.clip], video, arguments.search, (start, check.seconds))
            found = shorter[key]
        try:
            value = check.measure(found)
        except (AssertionError, ValueError, IndexError):
            value = float("nan")
        within = "within" if abs(value - check.expected) <= check.bound else "missed"
        bounds = f"{check.expected:g} {check.unit}", f"{check.bound:g}"
        print(table_row([check.clip, check.what, *bounds, f"{value:.3g}", within]))
    for name, (table, every, offset) in CLICKED.items():
        if name in answers:
            clicks = pd.read_csv(folder / "truth" / f"{table}.csv")
            clicks["frame"] = every * clicks["frame"] + offset
            stamps = frame_times(folder / clips[name].clip)
            middle, most = clicked_distance(clips[name], answers[name], stamps, clicks)
            within = "within" if middle <= CLICKED_PX else "missed"
            what = f"clicked centres, median distance (largest {most:.1f} px)"
            print(table_row([name, what, "0 px", f"{CLICKED_PX:g}", f"{middle:.2g}", within]))


if __name__ == "__main__":
    main()
