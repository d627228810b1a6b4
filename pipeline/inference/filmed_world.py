"""The scene of a clip whose bodies move in a plane parallel to the picture, from their tracks in all filmed frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.bodies.user_clip import UserClip
from pipeline.errors import ParamsError
from pipeline.inference.trust import Forecast, fitted_frames, forecast, gravity_doubt
from pipeline.vision.recordings.mask_file import only
from pipeline.worlds.blocks import Block, FixedMark, find_block
from pipeline.worlds.board import Board, board_scale
from pipeline.worlds.find_planar_scene import (
    KNOWN_ERROR,
    ClipMotion,
    KnownSize,
    PlanarAnswer,
    background,
    find_planar_scene,
    measure_motion,
)
from pipeline.worlds.scale import GRAVITY, KNOWN, Scale

WORSE = 1.5  # factor of the errors of two fits


@dataclass(frozen=True)
class KnownLength:
    """A length that is known in the plane in which bodies move.

    Attributes:
        ends: (x0, y0, x1, y1) px of the video's own picture.
        m: Its length.
    """

    ends: tuple[float, ...]
    m: float

    @property
    def px_per_m(self) -> float:
        x0, y0, x1, y1 = self.ends
        return float(np.hypot(x1 - x0, y1 - y0)) / self.m


@dataclass(frozen=True)
class World:
    """What a user knows of the world that was filmed.

    Attributes:
        view: Of `pipeline.worlds.view.VIEWS`; None: the tracks decide.
        gravity: m/s².
        length: A known length.
        size: A known size of a body.
        board: A board of known size in the plane of motion.
        fixed: Fixed boxes that the user points at, px of the video's own picture.
    """

    view: str | None = None
    gravity: float = GRAVITY
    length: KnownLength | None = None
    size: KnownSize | None = None
    board: Board | None = None
    fixed: tuple[FixedMark, ...] = ()

    @property
    def measured(self) -> bool:
        """Whether lengths or fixed bodies are known, which tracks alone can use."""
        return not (self.length is None and self.size is None and self.board is None and not self.fixed)

    @staticmethod
    def of(
        view: str = "auto",
        gravity: float = GRAVITY,
        length: Sequence[float] | None = None,
        size: tuple[int, str, float] | None = None,
        board: tuple[tuple[int, int] | None, float] | None = None,
        fixed: Sequence[Sequence[float]] = (),
    ) -> World:
        """A world from plain values.

        Args:
            view: Of `pipeline.worlds.view.VIEWS`, or "auto".
            gravity: m/s².
            length: (x0, y0, x1, y1, m).
            size: (body, "radius", m).
            board: (inner corners across and down, or None for AprilTags; m, the side of a square or tag).
            fixed: (x, y) or (x0, y0, x1, y1) of each fixed box.
        """
        if length is not None and tuple(length[:2]) == tuple(length[2:4]):
            raise ParamsError("--length: the two points are one; valid: two points of the picture")
        return World(
            view=None if view == "auto" else view,
            gravity=gravity,
            length=None if length is None else KnownLength(tuple(length[:4]), length[4]),
            size=None if size is None else KnownSize(*size),
            board=None if board is None else Board(*board),
            fixed=tuple(FixedMark(tuple(at)) for at in fixed),
        )


@dataclass(frozen=True)
class FilmedWorld:
    """What the tracks of a clip tell of the world.

    Attributes:
        followed: The bodies, in the frames in which they were looked for.
        answer: The planar scene; None where none was asked for, or none can be fitted.
        forecast: Of frames that were not fitted; None where it could not be tried.
        doubts: What disagrees with what the user knows, a sentence each.
    """

    followed: Followed
    answer: PlanarAnswer | None
    forecast: Forecast | None
    doubts: tuple[str, ...]

    @property
    def motion(self) -> ClipMotion:
        """Tracks, view and scale, in px of the frames in which bodies were looked for."""
        return self.followed.motion

    @property
    def masks(self) -> np.ndarray:
        """(T, H, W) ids of the bodies in these frames."""
        return self.followed.masks


def filmed_world(taken: UserClip, world: World) -> FilmedWorld:
    """The world that the tracks of a clip tell of, as yet without a scene.

    Raises:
        ParamsError: The tracks do not fit what the user knows.
    """
    frames, masks, times = filmed_frames(taken)
    pictured, doubts = _pictured(taken, world, frames)
    followed = follow(masks, frames, times, world, pictured)
    doubt = _gravity_doubt(followed.motion, world, taken.clip.source_fps)
    return FilmedWorld(
        followed=followed,
        answer=None,
        forecast=None,
        doubts=(*doubts, *([] if doubt is None else [doubt])),
    )


def with_scene(filmed: FilmedWorld, threads: int = 1, quick: bool = False) -> FilmedWorld:
    """That world with the scene that fits the tracks, where one can be fitted. Arguments as of `fitted_scene`."""
    answer = fitted_scene(filmed.followed, threads, quick)
    if answer is None:
        unused = "--fixed is not used: tracks give no scene, and the search knows no fixed bodies"
        return replace(filmed, doubts=(*filmed.doubts, unused)) if filmed.followed.world.fixed else filmed
    return replace(filmed, answer=answer)


def with_forecast(filmed: FilmedWorld, threads: int = 1) -> FilmedWorld:
    """That world, which has a scene, with the forecast of its last part. threads: for simulations."""
    assert filmed.answer is not None
    answer, told = forecast_scene(filmed.followed, filmed.answer, threads)
    return replace(filmed, answer=answer, forecast=told)


def seen_as(filmed: FilmedWorld, kind: str) -> FilmedWorld | None:
    """That world with its clip seen from another view, of `pipeline.worlds.view.VIEWS`; None where the tracks cannot
    show that view."""
    f, told = filmed.followed, filmed.motion.view.kind
    try:
        again = follow(f.masks, f.frames, f.times, replace(f.world, view=kind), f.pictured)
    except ParamsError:
        return None
    view = replace(again.motion.view, reason=f"its replay fits better than that of a {told}, which the tracks tell of")
    return replace(filmed, followed=replace(again, motion=replace(again.motion, view=view)), answer=None, forecast=None)


@dataclass(frozen=True)
class Pictured:
    """What a user knows of the picture, in px of the frames in which bodies are followed.

    Attributes:
        scale: Of the plane of motion; None where it is not known.
        blocks: Fixed bodies.
    """

    scale: Scale | None = None
    blocks: tuple[Block, ...] = ()


NOTHING = Pictured()


def _pictured(taken: UserClip, world: World, frames: np.ndarray) -> tuple[Pictured, list[str]]:
    """What a user knows of the picture, and doubts about it. frames: (T, H, W, 3), in which bodies are followed.

    Raises:
        ParamsError: A board is not seen, or a fixed body cannot be told apart.
    """
    box = taken.clip.letterbox
    px, place = box.scale, np.array(box.place[:2])
    if taken.found is not None:  # these frames have their own size
        px, place = frames.shape[2] / taken.clip.source_size[0], np.zeros(2)
    scale, doubts = None, []
    if world.length is not None:
        ends = px * np.array(world.length.ends).reshape(2, 2) + place
        scale = Scale(px * world.length.px_per_m, "length", KNOWN_ERROR, ends)
    elif world.board is not None:
        scale, doubt = board_scale(frames, world.board)
        doubts += [] if doubt is None else [doubt]
    blocks = []
    for mark in world.fixed:
        at = px * np.array(mark.at).reshape(-1, 2) + place
        try:
            blocks.append(find_block(background(frames), FixedMark(tuple(at.ravel().tolist()))))
        except ValueError as error:
            raise ParamsError(f"--fixed {mark}: {error}") from None
    return Pictured(scale, tuple(blocks)), doubts


@dataclass(frozen=True)
class Followed:
    """Bodies that were followed through frames.

    Attributes:
        masks: (T, H, W) their ids, from 1.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s, from 0.
        world: What is known of it.
        pictured: What is known of the picture; the world's own length, board and fixed bodies are not looked at.
        motion: What their tracks tell.
    """

    masks: np.ndarray
    frames: np.ndarray
    times: np.ndarray
    world: World
    pictured: Pictured
    motion: ClipMotion

    def first(self, count: int) -> Followed | None:
        """The first frames alone, seen from the same view; None where they do not show it."""
        same_view = replace(self.world, view=self.motion.view.kind)
        try:
            return follow(self.masks[:count], self.frames[:count], self.times[:count], same_view, self.pictured)
        except ParamsError:
            return None


def follow(
    masks: np.ndarray, frames: np.ndarray, times: np.ndarray, world: World, pictured: Pictured = NOTHING
) -> Followed:
    """Follow bodies through frames. Arguments as the attributes of `Followed`.

    Raises:
        ParamsError: The tracks do not fit what is known.
    """
    try:
        motion = measure_motion(
            masks,
            frames,
            times,
            view=world.view,
            gravity=world.gravity,
            scale=pictured.scale,
            size=world.size,
            blocks=pictured.blocks,
        )
    except ValueError as error:
        raise ParamsError(f"--view {world.view}, --size: {error}") from None
    return Followed(masks, frames, times, world, pictured, motion)


def fitted_scene(followed: Followed, threads: int = 1, quick: bool = False) -> PlanarAnswer | None:
    """The planar scene whose motion follows the tracks; None where these give none.

    Args:
        followed: The tracks.
        threads: For simulations.
        quick: A scene that is good enough to compare worlds.
    """
    motion = followed.motion
    if not motion.tracks or (motion.view.kind == "table" and motion.table is None):
        return None
    return find_planar_scene(motion, followed.world.gravity, threads, quick=quick)


def forecast_scene(followed: Followed, answer: PlanarAnswer, threads: int = 1) -> tuple[PlanarAnswer, Forecast | None]:
    """The forecast of the last part by the scene that fits the first, where that can be fitted.

    Args:
        followed: The tracks.
        answer: The scene that fits all of them.
        threads: For simulations.

    Returns:
        The scene, fitted again from that of the first part where it fits the whole much worse; and the forecast.
    """
    motion, gravity = followed.motion, followed.world.gravity
    seen = fitted_frames(followed.times, renumbered_by_track(followed.masks, motion))
    early = followed.first(seen) if seen else None
    if early is None or not early.motion.tracks:
        return answer, None
    first = find_planar_scene(early.motion, gravity, threads)
    told = forecast(first.scene, renumbered_by_track(followed.masks, motion), followed.times, seen)
    alike = first.fit.scene.shapes == answer.fit.scene.shapes
    if alike and answer.fit.rms_px > WORSE * first.fit.rms_px:  # beyond an impact it may have ended in another one
        again = find_planar_scene(motion, gravity, threads, first)
        answer = min(answer, again, key=lambda a: a.fit.rms_px)
    return answer, told


def _gravity_doubt(motion: ClipMotion, world: World, fps: float) -> str | None:
    """A sentence on free fall that disagrees with gravity, where a length or a size is known."""
    view, scale = motion.view, motion.scale
    if view.gravity_px is None or scale.by not in KNOWN:
        return None
    found = float(np.linalg.norm(view.gravity_px))
    return gravity_doubt(found / scale.px_per_m, world.gravity, view.gravity_error + scale.error, fps)


def filmed_frames(taken: UserClip) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames (T, H, W, 3), masks (T, H, W) and times (T,) s in which the bodies of a clip can be followed."""
    if taken.found is not None:
        clip = taken.found.clip
        return clip.frames, taken.found.masks, np.asarray(clip.times)
    clip = taken.clip
    return clip.frames, taken.masks, np.asarray(clip.source_times - clip.source_times[0])


def renumbered_by_track(masks: np.ndarray, motion: ClipMotion) -> np.ndarray:
    """The masks (T, H, W) of the bodies that have a track, numbered from 1 in the order of the scene's objects."""
    return only(masks, [track.body for track in motion.tracks])
