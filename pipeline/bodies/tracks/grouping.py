"""Pixels to tracks: each frame's pixels go to the live track that votes and colours fit; the rest start tracks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from pipeline.bodies.networks.inference import Prediction
from pipeline.bodies.tracks.image_track import LEAST_PIXELS
from pipeline.compiled import kernel

KEEP, BEGIN = 0.4, 0.5  # probability from which a pixel may go to a live track; may start one
GAP = 6  # frames for which a track that is not seen stays live
LEAST_MASS = 0.08  # of a disc of the predicted radius, that must be seen for a track to go on
LEAST_START = 0.12  # and to start
NEAR_VOTE, NEAR_COLOUR = 0.55, 0.10  # a vote's distance in radii, a colour's in [0, 1], that cost 1
MOST_COLOUR, MOST_COST = 3.0, 3.5
PALETTE, FRESH = 48, 8  # colours that a track remembers, and of which so many are renewed in each frame
MARGIN = 60  # px beyond the picture where a centre may be
RADIUS = (1.5, 60.0)  # px; what the network may say
MOST_STARTS = 14  # in one frame
LOST = 2  # frames after which a lost track is not looked for far away
LEAP = 7.0  # radii between two frames that a body may move whose velocity is not known


@dataclass
class Piece:
    """A track in one frame. pixels: (M,) flat indices into the picture. centre: (2,) px, the median vote. radius: px.
    colour: (3,) in [0, 1]."""

    pixels: np.ndarray
    centre: np.ndarray
    radius: float
    colour: np.ndarray

    def at_border(self, height: int, width: int) -> bool:
        """Whether it touches the border of the picture."""
        rows, cols = np.divmod(self.pixels, width)
        return bool(rows.min() == 0 or cols.min() == 0 or rows.max() == height - 1 or cols.max() == width - 1)


@dataclass
class Track:
    """One body's pieces by frame, and what is expected of it in the next: centre (2,) px, velocity (2,) px a frame,
    radius px, palette (PALETTE, 3). ends: (2,) px each, from the centre of a stiff body's first end to its others."""

    centre: np.ndarray
    radius: float
    palette: np.ndarray
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(2))
    pieces: dict[int, Piece] = field(default_factory=dict)
    ends: list[np.ndarray] = field(default_factory=list)

    @property
    def last(self) -> int:
        return max(self.pieces)

    @property
    def first(self) -> int:
        return min(self.pieces)

    @property
    def typical_radius(self) -> float:
        """px: the median over its pieces."""
        return float(np.median([p.radius for p in self.pieces.values()]))

    @property
    def typical_area(self) -> float:
        """px²: the median over its pieces."""
        return float(np.median([len(p.pixels) for p in self.pieces.values()]))

    def add(self, t: int, piece: Piece) -> None:
        """Add a piece of frame t, or its pixels where the track has one there."""
        whole = self.pieces.get(t)
        self.pieces[t] = piece if whole is None else replace(whole, pixels=np.union1d(whole.pixels, piece.pixels))


@dataclass(frozen=True)
class Pixels:
    """The foreground pixels of one frame. index: (M,) flat. vote: (M, 2) px. colour: (M, 3) in [0, 1]. radius: (M,) px.
    probability: (M,)."""

    index: np.ndarray
    vote: np.ndarray
    colour: np.ndarray
    radius: np.ndarray
    probability: np.ndarray

    @property
    def mass(self) -> np.ndarray:
        """(M,): the share that each pixel is of a disc of its radius."""
        return 1 / (np.pi * self.radius**2)


@kernel
def _assign(
    vote: np.ndarray,
    colour: np.ndarray,
    centres: np.ndarray,
    radii: np.ndarray,
    palettes: np.ndarray,
    owner: np.ndarray,
) -> None:
    """Fill owner (M,): the track that each pixel fits best, -1 where none."""
    for m in range(vote.shape[0]):
        best, owner[m] = MOST_COST, -1
        for k in range(centres.shape[0]):
            dx, dy = vote[m, 0] - centres[k, 0], vote[m, 1] - centres[k, 1]
            reach = NEAR_VOTE * max(radii[k], 3.0) + 1.5
            cost = (dx * dx + dy * dy) / (reach * reach)
            if cost >= best:
                continue
            nearest = np.inf
            for j in range(palettes.shape[1]):
                apart = max(
                    abs(colour[m, 0] - palettes[k, j, 0]),
                    abs(colour[m, 1] - palettes[k, j, 1]),
                    abs(colour[m, 2] - palettes[k, j, 2]),
                )
                nearest = min(nearest, apart)
            cost += min((nearest / NEAR_COLOUR) ** 2, MOST_COLOUR)
            if cost < best:
                best, owner[m] = cost, k


def foreground_pixels(prediction: Prediction, probability: np.ndarray, frames: np.ndarray, t: int) -> Pixels:
    index = np.flatnonzero(probability[t].ravel() > KEEP)
    return Pixels(
        index,
        prediction.vote[t].reshape(-1, 2)[index],
        frames[t].reshape(-1, 3)[index].astype(np.float32) / 255,
        np.clip(prediction.radius[t].ravel()[index], *RADIUS),
        probability[t].ravel()[index],
    )


def follow(prediction: Prediction, probability: np.ndarray, frames: np.ndarray) -> list[Track]:
    """Tracks of the clip's bodies. probability: (T, H, W) that a pixel shows one; frames: (T, H, W, 3) uint8."""
    rng = np.random.default_rng(0)  # only picks which of a track's colours are remembered
    tracks: list[Track] = []
    for t in range(len(frames)):
        pixels = foreground_pixels(prediction, probability, frames, t)
        live = [k for k in tracks if t - k.last <= GAP]
        owner = _owners(live, pixels, t)
        for i, track in enumerate(live):
            mine = owner == i
            if mine.sum() < LEAST_PIXELS or pixels.mass[mine].sum() < LEAST_MASS:
                owner[mine] = -1
                continue
            _extend(track, t, pixels, mine, rng)
        free = (owner < 0) & (pixels.probability > BEGIN)
        _adopt(tracks, live, pixels, clusters(pixels, free, frames.shape[1:3]), t, rng)
    return tracks


def _adopt(
    tracks: list[Track], live: list[Track], pixels: Pixels, groups: list[np.ndarray], t: int, rng: np.random.Generator
) -> None:
    """Give each group of pixels (M,) bool of frame t to the body of which it is a part, to a live track that was lost
    because it moves fast, or to a new track."""
    pieces = [piece_of(pixels, mine) for mine in groups]
    hosts = [_host(live, piece, t) for piece in pieces]
    for piece, host in zip(pieces, hosts, strict=True):
        if host is not None:
            whole = host.pieces[t]
            host.pieces[t] = replace(whole, pixels=np.concatenate([whole.pixels, piece.pixels]))
    rest = [k for k, host in enumerate(hosts) if host is None]
    lost = [k for k in live if 0 < t - k.last <= LOST]
    costs = sorted(
        (cost, i, k) for i, track in enumerate(lost) for k in rest if (cost := leap_cost(track, pieces[k], t)) < 1
    )
    taken: set[int] = set()
    for _, i, k in costs:
        if k not in taken and lost[i].last < t:
            taken.add(k)
            _extend(lost[i], t, pixels, groups[k], rng)
    for k in rest:
        if k not in taken:
            palette = pixels.colour[groups[k]][rng.integers(0, groups[k].sum(), PALETTE)]
            tracks.append(Track(pieces[k].centre, pieces[k].radius, palette, pieces={t: pieces[k]}))


def leap_cost(track: Track, piece: Piece, t: int) -> float:
    """What it costs to take a piece of frame t for a track's next, 1 or more where it cannot be.

    A track of one or two pieces may leap by LEAP radii, since its velocity is not known; an older one, as at a bounce,
    by 1.5 times its last step.
    """
    gap = t - track.last
    radius = max(track.radius, piece.radius) + 2
    expected = track.centre + track.velocity * gap
    reach = LEAP * radius if len(track.pieces) < 3 else 2.5 * radius + 1.5 * float(np.linalg.norm(track.velocity))
    colour = np.abs(np.median(track.palette, axis=0) - piece.colour).max()
    size = abs(np.log(max(track.radius, 1.0) / max(piece.radius, 1.0)))
    apart = float(np.linalg.norm(expected - piece.centre)) / (reach * gap)
    return 0.5 * apart + float(colour) / 0.4 + 0.5 * float(size) if apart < 1 else 1.0


def _owners(live: list[Track], pixels: Pixels, t: int) -> np.ndarray:
    """(M,) index of the live track that takes each pixel, or -1: twice, since votes may say where a track has gone."""
    owner = np.full(len(pixels.index), -1)
    if not live or not len(pixels.index):
        return owner
    centres = np.array([k.centre + k.velocity * (t - k.last) for k in live])
    radii, palettes = np.array([k.radius for k in live]), np.stack([k.palette for k in live])
    for _ in range(2):
        _assign(pixels.vote, pixels.colour, centres, radii, palettes, owner)
        for i in range(len(live)):
            mine = owner == i
            if mine.sum() >= LEAST_PIXELS:
                centres[i] = np.median(pixels.vote[mine], axis=0)
    return owner


def piece_of(pixels: Pixels, mine: np.ndarray) -> Piece:
    centre = np.median(pixels.vote[mine], axis=0).astype(float)
    return Piece(pixels.index[mine], centre, float(np.median(pixels.radius[mine])), pixels.colour[mine].mean(0))


def _extend(track: Track, t: int, pixels: Pixels, mine: np.ndarray, rng: np.random.Generator) -> None:
    """Add the pixels `mine` (M,) of frame t to a track."""
    piece = piece_of(pixels, mine)
    velocity = (piece.centre - track.centre) / (t - track.last)
    track.velocity = velocity if len(track.pieces) == 1 else 0.6 * track.velocity + 0.4 * velocity
    track.radius = 0.7 * track.radius + 0.3 * piece.radius
    track.centre = piece.centre
    core = mine & (np.linalg.norm(pixels.vote - piece.centre, axis=1) < 0.4 * track.radius + 1)
    if core.sum() >= FRESH:
        fresh = pixels.colour[core][rng.integers(0, core.sum(), FRESH)]
        track.palette = np.concatenate([track.palette[FRESH:], fresh])
    track.pieces[t] = piece


def _host(live: list[Track], piece: Piece, t: int) -> Track | None:
    """The track of this frame of which the piece is a part, if any."""
    for track in live:
        if track.last == t and np.linalg.norm(track.centre - piece.centre) < 0.5 * max(track.radius, piece.radius):
            return track
    return None


def clusters(pixels: Pixels, free: np.ndarray, shape: tuple[int, int]) -> list[np.ndarray]:
    """The free pixels (M,) bool in groups (M,) bool whose votes agree; shape: (H, W) of the picture."""
    free = free.copy()
    mass, votes = pixels.mass, pixels.vote
    height, width = shape[0] + 2 * MARGIN, shape[1] + 2 * MARGIN
    col = np.clip(votes[:, 0] + MARGIN, 1, width - 2).astype(int)
    row = np.clip(votes[:, 1] + MARGIN, 1, height - 2).astype(int)
    found: list[np.ndarray] = []
    for _ in range(MOST_STARTS):
        if free.sum() < LEAST_PIXELS or mass[free].sum() < LEAST_START:
            break
        left, top = max(col[free].min() - 6, 0), max(row[free].min() - 6, 0)
        across, down = col[free].max() + 7 - left, row[free].max() + 7 - top
        cells = (row[free] - top) * across + col[free] - left
        heap = np.bincount(cells, mass[free], across * down).reshape(down, across).astype(np.float32)
        smooth = cv2.GaussianBlur(heap, (0, 0), 1.5)
        y, x = np.unravel_index(int(np.argmax(smooth)), heap.shape)
        centre = np.array([x + left + 0.5 - MARGIN, y + top + 0.5 - MARGIN])
        for _ in range(2):
            near = free & (np.linalg.norm(votes - centre, axis=1) < np.maximum(3.0, 0.45 * pixels.radius))
            if near.sum() < LEAST_PIXELS:
                break
            centre = np.average(votes[near], axis=0, weights=mass[near])
        away = np.linalg.norm(votes - centre, axis=1)
        mine = free & (away < np.maximum(4.0, 0.6 * pixels.radius))
        if not mine.any():
            free &= away >= 4
            continue
        free &= ~mine
        if mine.sum() >= LEAST_PIXELS and mass[mine].sum() > LEAST_START:
            found.append(mine)
    return _with_rest(pixels, free, found)


def _with_rest(pixels: Pixels, free: np.ndarray, found: list[np.ndarray]) -> list[np.ndarray]:
    """The groups with the free pixels that lie near one, in its radii."""
    if not found or not free.any():
        return found
    centres = np.array([np.median(pixels.vote[m], axis=0) for m in found])
    radii = np.array([max(np.median(pixels.radius[m]), 4.0) for m in found])
    away = np.linalg.norm(pixels.vote[:, None] - centres, axis=-1) / radii
    nearest = away.argmin(1)
    close = free & (away.min(1) < 1.5)
    return [m | (close & (nearest == k)) for k, m in enumerate(found)]
