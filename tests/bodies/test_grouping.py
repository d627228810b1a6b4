"""Laws of the grouping of pixels into tracks, with the network's answers made from known discs."""

import numpy as np
import pytest

from pipeline.bodies.candidates import draw_masks
from pipeline.bodies.networks.inference import Prediction, steadied
from pipeline.bodies.networks.upsampling import enlarge, guided_filter
from pipeline.bodies.tracks.grouping import Piece, Track, follow
from pipeline.bodies.tracks.joining import joined
from pipeline.bodies.tracks.resting import resting, with_rests, without_ghosts
from pipeline.bodies.tracks.track_ends import with_all_ends
from pipeline.bodies.tracks.track_score import FIGURES, PLAIN, score, track_figures

HEIGHT, WIDTH = 80, 120
COLOURS = ((220, 40, 40), (40, 200, 60), (60, 80, 230))


def answers(paths, radius=8, hidden=()):
    """Frames (T, H, W, 3), a perfect Prediction and masks of discs on paths (N, T, 2) px; hidden: (body, frame)."""
    count = len(paths[0])
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    frames = np.full((count, HEIGHT, WIDTH, 3), 120, np.uint8)
    mask = np.zeros((count, HEIGHT, WIDTH), np.uint8)
    vote = np.stack([np.broadcast_to(x, mask.shape), np.broadcast_to(y, mask.shape)], -1).astype(np.float32)
    for i, path in enumerate(paths):
        for t, (cx, cy) in enumerate(path):
            if (i, t) in hidden:
                continue
            disc = np.hypot(x - cx, y - cy) < radius
            frames[t][disc] = COLOURS[i]
            mask[t][disc] = i + 1
            vote[t][disc] = (cx, cy)
    moving = np.where(mask > 0, 0.95, 0.02).astype(np.float32)
    zero = np.zeros_like(moving)
    size = np.full(mask.shape, radius, np.float32)
    return frames, Prediction(moving, moving, zero, vote, size), mask


def line(start, stop, count=12):
    return np.linspace(start, stop, count)


def piece_in(region, frame):
    rows, cols = np.nonzero(region)
    centre = np.array([cols.mean() + 0.5, rows.mean() + 0.5])
    return Piece(np.flatnonzero(region), centre, 8.0, frame[region].mean(0) / 255)


def tracks_of(frames, prediction):
    return joined(follow(prediction, prediction.moving, frames), prediction.moving)


def test_each_disc_becomes_one_track_with_its_own_pixels():
    frames, prediction, mask = answers([line((15, 20), (100, 25)), line((100, 60), (20, 55))])
    tracks = tracks_of(frames, prediction)
    assert len(tracks) == 2
    for track in tracks:
        ids = {int(i) for t, p in track.pieces.items() for i in np.unique(mask[t].ravel()[p.pixels])}
        assert len(ids) == 1 and len(track.pieces) == 12


def test_discs_that_pass_close_by_keep_their_tracks():
    frames, prediction, mask = answers([line((20, 36), (100, 36)), line((100, 46), (20, 46))], radius=5)
    tracks = tracks_of(frames, prediction)
    assert len(tracks) == 2
    first = tracks[0]
    ids = [np.bincount(mask[t].ravel()[p.pixels]).argmax() for t, p in sorted(first.pieces.items())]
    assert len(set(ids)) == 1


def test_a_track_split_by_a_one_frame_gap_is_joined():
    frames, prediction, _ = answers([line((15, 20), (100, 60))], hidden={(0, 5)})
    (track,) = tracks_of(frames, prediction)
    assert sorted(track.pieces) == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]


def test_a_track_split_by_a_long_gap_is_joined_where_it_was_expected():
    hidden = {(0, t) for t in range(4, 12)}
    frames, prediction, _ = answers([line((15, 20), (100, 60), 20)], hidden=hidden)
    assert len(tracks_of(frames, prediction)) == 1


def test_discs_of_other_places_and_colours_are_not_joined():
    hidden = {(0, t) for t in range(6, 12)} | {(1, t) for t in range(8)}
    frames, prediction, _ = answers([line((15, 20), (40, 20)), line((90, 60), (100, 60))], hidden=hidden)
    assert len(tracks_of(frames, prediction)) == 2


def test_nothing_gives_no_track():
    frames, prediction, _ = answers([line((15, 20), (40, 20))], hidden={(0, t) for t in range(12)})
    assert tracks_of(frames, prediction) == []


def test_figures_of_a_perfect_disc():
    frames, prediction, _ = answers([line((30, 40), (90, 40))])
    (track,) = tracks_of(frames, prediction)
    figures = dict(zip(FIGURES, track_figures(track, prediction), strict=True))
    assert figures["length"] == 1 and figures["other"] == 0 and figures["edge"] == 0
    assert figures["moving"] == pytest.approx(0.95, abs=1e-3)
    assert figures["fill"] == pytest.approx(1, abs=0.08)
    assert figures["spread"] < 1e-3
    assert score(track_figures(track, prediction), PLAIN) > 0.5


def test_a_hand_scores_less_than_a_body():
    figures = np.zeros(len(FIGURES))
    figures[FIGURES.index("moving")] = 0.7
    hand = figures.copy()
    hand[FIGURES.index("other")] = 0.9
    assert score(hand, PLAIN) < 0.5 < score(figures, PLAIN)


def test_masks_at_twice_the_size_follow_the_edge_in_the_frame():
    frames, prediction, _mask = answers([line((30, 40), (90, 40), 3)], radius=10)
    y, x = np.mgrid[: 2 * HEIGHT, : 2 * WIDTH] + 0.5
    large = np.full((3, 2 * HEIGHT, 2 * WIDTH, 3), 120, np.uint8)
    true = np.zeros((3, 2 * HEIGHT, 2 * WIDTH), bool)
    for t, (cx, cy) in enumerate(line((60, 80), (180, 80), 3)):
        true[t] = np.hypot(x - cx, y - cy) < 20
        large[t][true[t]] = COLOURS[0]
    tracks = tracks_of(frames, prediction)
    found = draw_masks(tracks, prediction.moving, large) > 0
    assert (found & true).sum() / (found | true).sum() > 0.97


def test_the_guided_filter_leaves_a_constant_as_it_is():
    guide = np.random.default_rng(0).random((30, 40, 3)).astype(np.float32)
    out = guided_filter(guide, np.full((30, 40), 0.7, np.float32), 3, 1e-3)
    np.testing.assert_allclose(out, 0.7, atol=2e-3)


def test_an_empty_mask_enlarges_to_nothing():
    values, window = enlarge(np.zeros((10, 15), np.float32), np.zeros((20, 30, 3), np.uint8))
    assert values.size == 0 and np.zeros((20, 30))[window].size == 0


def test_steadied_leaves_a_still_clip_its_mean():
    frames = np.full((4, 6, 8, 3), 90, np.uint8)
    probability = np.random.default_rng(0).random((4, 6, 8)).astype(np.float32)
    mean = probability.mean(0)
    np.testing.assert_allclose(steadied(probability, frames), 0.5 * probability + 0.5 * mean, atol=1e-5)


def test_a_body_that_stops_and_is_lost_is_kept_while_it_looks_the_same():
    path = np.concatenate([line((20, 30), (70, 30), 8), np.repeat([[70.0, 30.0]], 10, 0)])
    frames, prediction, mask = answers([path])
    prediction.moving[12:] = 0
    (track,) = tracks_of(frames, prediction)
    assert max(track.pieces) == 11
    whole = with_rests(track, frames)
    assert sorted(whole.pieces) == list(range(18))
    np.testing.assert_array_equal(np.sort(whole.pieces[17].pixels), np.flatnonzero(mask[17]))
    gone = frames.copy()
    gone[15:] = 120
    assert max(with_rests(track, gone).pieces) == 14


def test_a_body_that_leaves_while_it_moves_is_not_prolonged():
    frames, prediction, _ = answers([line((20, 30), (100, 30))])
    prediction.moving[8:] = 0
    (track,) = tracks_of(frames, prediction)
    assert max(with_rests(track, frames).pieces) == 7


def test_the_ends_of_one_stiff_body_are_joined_and_two_bodies_side_by_side_are_not():
    frames, prediction, mask = answers([line((10, 10), (60, 60)), line((50, 10), (100, 60))], radius=6)
    frames[mask == 2] = frames[mask == 1][0]
    assert len(tracks_of(frames, prediction)) == 2
    for t in range(len(frames)):
        row = int(10 + 50 * t / 11)
        left = int(10 + 50 * t / 11)
        prediction.moving[t, row - 2 : row + 3, left + 6 : left + 35] = 0.35
    (track,) = tracks_of(frames, prediction)
    assert track_figures(track, prediction)[FIGURES.index("spread")] < 0.5  # votes are for the ends' own centres


def test_two_bodies_of_different_colours_that_stay_side_by_side_are_not_joined():
    frames, prediction, _ = answers([line((10, 10), (60, 60)), line((21, 10), (71, 60))], radius=6)
    assert len(tracks_of(frames, prediction)) == 2


def test_two_balls_of_one_colour_that_touch_and_move_together_are_not_joined():
    frames, prediction, mask = answers([line((20, 20), (80, 60)), line((34, 20), (94, 60))])
    frames[mask == 2] = frames[mask == 1][0]
    assert len(tracks_of(frames, prediction)) == 2


def test_halves_whose_votes_disagree_are_one_body_where_their_radius_says_so():
    frames, prediction, mask = answers([line((30, 40), (80, 40))], radius=14)
    x = np.mgrid[:HEIGHT, :WIDTH][1] + 0.5
    for t, cx in enumerate(line(30, 80)):  # each half, of its own colour, votes for itself
        for side, colour in ((-1, COLOURS[0]), (1, COLOURS[1])):
            half = (mask[t] == 1) & (side * (x - cx) > 0)
            prediction.vote[t][half] = (cx + 7 * side, 40)
            frames[t][half] = colour
    (track,) = tracks_of(frames, prediction)
    assert all(len(p.pixels) == (mask[t] == 1).sum() for t, p in track.pieces.items())
    prediction.radius[:] = 9.0  # now each half is as large as the network says of its body
    assert len(tracks_of(frames, prediction)) == 2


def test_two_bodies_of_one_colour_that_meet_and_rest_are_not_one_stiff_body():
    paths = [
        np.concatenate([line(a, b, 6), np.repeat([b], 24, 0)])
        for a, b in (((10.0, 30.0), (50.0, 30.0)), ((110.0, 30.0), (63.0, 30.0)))
    ]
    frames, prediction, mask = answers(paths, radius=6)
    frames[mask == 2] = frames[mask == 1][0]
    assert len(tracks_of(frames, prediction)) == 2


def test_a_body_that_rests_behind_another_is_kept_while_parts_of_it_are_seen():
    paths = [np.repeat([[60.0, 30.0]], 16, 0), line((10, 30), (54, 30), 16)]
    frames, _, mask = answers(paths)
    behind = Track(paths[0][0], 8.0, np.zeros((1, 3)), pieces={0: piece_in(mask[0] == 1, frames[0])})
    front = Track(
        paths[1][0], 8.0, np.zeros((1, 3)), pieces={t: piece_in(mask[t] == 2, frames[t]) for t in range(len(frames))}
    )
    assert max(with_rests(behind, frames).pieces) < 15
    whole = resting([behind, front], frames)[0]
    assert sorted(whole.pieces) == list(range(16))
    np.testing.assert_array_equal(np.sort(whole.pieces[15].pixels), np.flatnonzero(mask[15] == 1))


def track_of(path, frames, mask, body, shown):
    pieces = {t: piece_in(mask[t] == body, frames[t]) for t in shown}
    return Track(np.array(path[0]), 6.0, np.zeros((1, 3)), pieces=pieces)


def test_a_body_that_rests_in_the_background_has_no_ghost_before_it_comes():
    path = np.concatenate([line((20, 40), (55, 40), 5), np.repeat([[60.0, 40.0]], 11, 0)])
    frames, _, mask = answers([path])
    background = np.median(frames, axis=0).astype(np.uint8)
    place = mask[-1] == 1
    pieces = {t: piece_in(place, frames[t]) for t in range(len(frames))}  # frames 0 to 3: its empty place
    ghost = Track(path[-1], 8.0, np.zeros((1, 3)), pieces=pieces)
    assert sorted(without_ghosts(ghost, frames, background).pieces) == list(range(4, 16))
    moving = Track(path[0], 8.0, np.zeros((1, 3)), pieces={t: piece_in(mask[t] == 1, frames[t]) for t in range(3)})
    assert without_ghosts(moving, frames, background) is moving


def changed(frames):
    return (frames != 120).any(-1)


def test_a_body_is_followed_to_the_first_and_the_last_frame_and_out_of_the_picture():
    path = line((30, 40), (118, 40), 12)
    frames, _, mask = answers([path], radius=6)
    track = track_of(path, frames, mask, 1, range(2, 9))
    track.palette = np.array([COLOURS[0]]) / 255
    (whole,) = with_all_ends([track], frames, changed(frames))
    assert sorted(whole.pieces) == list(range(12))
    for t, piece in whole.pieces.items():
        np.testing.assert_array_equal(np.sort(piece.pixels), np.flatnonzero(mask[t]))


@pytest.mark.parametrize("what", ["nothing", "another colour", "another body"])
def test_what_is_no_body_at_the_expected_place_ends_its_track(what):
    path = line((30, 40), (96, 40), 12)
    frames, _, mask = answers([path], radius=6)
    track = track_of(path, frames, mask, 1, range(2, 12))
    track.palette = np.array([COLOURS[0]]) / 255
    frames[:2] = 120
    others = []
    if what != "nothing":
        frames[:2][mask[:2] > 0] = COLOURS[what == "another colour"]
    if what == "another body":
        others = [track_of(path, frames, mask, 1, range(2))]
    assert min(with_all_ends([track, *others], frames, changed(frames))[0].pieces) == 2


def test_a_part_of_a_body_at_the_end_of_its_track_becomes_the_whole_body():
    path = line((30, 40), (96, 40), 12)
    frames, _, mask = answers([path], radius=6)
    track = track_of(path, frames, mask, 1, range(12))
    track.palette = np.array([COLOURS[0]]) / 255
    for t in (10, 11):
        track.pieces[t].pixels = track.pieces[t].pixels[:20]
    (whole,) = with_all_ends([track], frames, changed(frames))
    assert all(len(p.pixels) == (mask[t] > 0).sum() for t, p in whole.pieces.items())
