"""Fixed boxes that a user points at: found by their colour, and in the scene instead of what bounces tell."""

import cv2
import numpy as np
import pytest

from pipeline.clips.overlap import overlap
from pipeline.clips.replay import masks_at, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import FixedBody, Scene, SceneObject
from pipeline.worlds.blocks import FixedMark, block_body, find_block
from pipeline.worlds.find_planar_scene import find_planar_scene, measure_motion
from pipeline.worlds.plane import Plane
from pipeline.worlds.table_view import TableView

SCHEDULE = Schedule()
TIMES = np.arange(SCHEDULE.frames) / SCHEDULE.fps
SIDE = Plane(480, 320, px_per_m=200.0)


def pictured(angle_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """A shaded box of 120x60 px in a picture with noise, and its corners (4, 2) px."""
    rng = np.random.default_rng(5)
    picture = np.full((320, 480, 3), (120, 130, 150), np.float32)
    corners = cv2.boxPoints(((260.0, 170.0), (120.0, 60.0), angle_deg))
    face = np.zeros((320, 480), np.uint8)
    cv2.fillConvexPoly(face, np.round(corners).astype(int), 1)
    shade = np.linspace(0.85, 1.15, 480, dtype=np.float32)[None, :, None]
    picture = np.where(face[..., None] > 0, np.array([190, 90, 40], np.float32) * shade, picture)
    return np.clip(picture + rng.normal(0, 3, picture.shape), 0, 255).astype(np.uint8), np.asarray(corners)


@pytest.mark.parametrize("angle_deg", [0.0, 20.0])
def test_a_click_finds_the_box_of_that_colour(angle_deg: float) -> None:
    picture, corners = pictured(angle_deg)
    block = find_block(picture, FixedMark((250, 172)))
    found = block_body(block, SIDE, radius=0.05, top=0.0, name="block")
    assert found.size[0] == pytest.approx(0.6, rel=0.05)
    assert found.size[2] == pytest.approx(0.3, rel=0.05)
    assert SIDE.to_picture(SIDE.in_plane(np.array(found.position))) == pytest.approx([260, 170], abs=3)
    assert max(block.outside(c) for c in corners) < 4


def test_two_corners_are_a_box_and_what_cannot_be_told_apart_is_refused() -> None:
    picture, _ = pictured(0.0)
    block = find_block(picture, FixedMark((300, 210, 220, 140)))
    assert block.corners[[0, 2]] == pytest.approx(np.array([[220, 140], [300, 210]]))
    with pytest.raises(ValueError, match="outside of the picture; valid: in 0,0,480,320"):
        find_block(picture, FixedMark((500, 10)))
    with pytest.raises(ValueError, match="no region of one colour"):
        find_block(picture, FixedMark((20, 20)))  # the background fills most of the picture


def test_a_ball_that_hits_a_known_box_needs_no_other_support() -> None:
    wall = FixedBody("box", (0.2, 1.2, 0.6), (0.5, 0.0, 0.3), damping=0.2, name="wall")
    rolling = SceneObject(
        "sphere", (0.08,), 0.5, damping=0.2, position=(-0.6, 0, 0.08), velocity=(2, 0, 0), angular_velocity=(0, 25, 0)
    )
    scene = Scene((rolling,), SIDE.camera(), ground=0.0, fixed=(wall,))
    shown = replay_poses(scene, SCHEDULE)
    pictures = shown.pictures("raycast")
    corners = SIDE.to_picture(np.array([[0.4, 0.6], [0.6, 0.0]])).ravel()
    block = find_block(pictures[0], FixedMark(tuple(corners)))
    motion = measure_motion(shown.masks, pictures, TIMES, view="side", blocks=[block])
    assert len(motion.supports) == 1  # the floor
    answer = find_planar_scene(motion)
    assert [b.name for b in answer.scene.fixed] == ["support_0", "block_0"]
    own = masks_at(answer.scene, TIMES, 480, 320)
    assert overlap(own, shown.masks, 1, 1).sequence > 0.85


def test_a_block_on_a_table_stands_on_its_lower_edge() -> None:
    table = TableView(Plane(480, 320, px_per_m=200.0, level=True), 30.0, 0.05)
    near = np.array([[-0.2, 0.1], [0.1, 0.1]])
    edge = table_px(table, near)
    block = find_block(np.zeros((320, 480, 3), np.uint8), FixedMark((edge[0, 0], edge[0, 1] - 40, *edge[1])))
    foot = table.plane.to_world(table.block_from_above(block).corners)
    assert foot[:2] == pytest.approx(near, abs=1e-6)
    assert foot[2:, 1].min() > 0.1


def table_px(table: TableView, places: np.ndarray) -> np.ndarray:
    """(N, 2) px of places (N, 2) m on a table, as its camera sees them."""
    from pipeline.vision.rendering.camera import pinhole, project

    places = np.column_stack([places, np.zeros(len(places))])
    return project(places, pinhole(table.camera()), 480, 320)[0]
