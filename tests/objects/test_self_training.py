"""Labels of the search, and clips of another look as examples."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks, pair_view, trace_pairs
from pipeline.objects.fields import NOTHING
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import BASIC_SHAPES, Camera, Scene, SceneObject
from pipeline.scene.solid import reach_below
from pipeline.search.evaluator import Evaluator
from pipeline.search.target import make_target
from training.objects.other_looks import LabelledClip, read_clip, write_clip
from training.objects.self_training import example_of_clip, true_pairs
from training.objects.simplest_scene import simplest_scene

SCHEDULE = Schedule()
BOX = SceneObject("box", (0.3, 0.2, 0.25), 1.0, position=(-0.4, 0.0, 0.1255), velocity=(0.6, 0.0, 0.0))
LYING = SceneObject(
    "cylinder",
    (0.1, 0.3),
    1.0,
    position=(0.4, 0.1, 0.1005),
    velocity=(-0.5, 0.0, 0.0),
    orientation=(np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0),
)
SCENE = Scene((BOX, LYING), Camera((0.0, -2.0, 1.0), fov=40.0, pitch=-25.0))


def masks_and_flow(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Of all frames, and of the model's pairs."""
    trace = simulate(scene, SCHEDULE.seconds)
    view = pair_view(scene, *trace_pairs(trace, SCHEDULE), 240, 160)
    return frame_masks(scene, trace, SCHEDULE, 240, 160), view.flow


def clip_of(scene: Scene, found: np.ndarray, true: np.ndarray, flow: np.ndarray) -> LabelledClip:
    """A clip whose label is its true scene."""
    return LabelledClip(
        found=found,
        true=true,
        flow=flow.astype(np.float16),
        label=scene,
        pairs=np.array([[0, 0], [1, 1]]),
        reward=0.75,
        greedy=scene,
        greedy_reward=0.5,
        scene=scene,
    )


def test_small_tilts_and_gaps_become_zero_and_a_lying_cylinder_keeps_lying() -> None:
    masks, flow = masks_and_flow(SCENE)
    evaluator = Evaluator(make_target(masks[SCHEDULE.pairs[:, 0]], flow, 120, 80), SCHEDULE, 1)
    off = replace(
        BOX,
        position=(*BOX.position[:2], 0.129),
        velocity=(0.6, 0.0, 0.02),
        orientation=(np.sqrt(1 - 0.02**2), 0.02, 0.0, 0.0),
        angular_velocity=(0.0, 0.05, 0.0),
    )
    box, cylinder = simplest_scene(evaluator, replace(SCENE, objects=(off, LYING))).objects
    assert box.orientation[1:3] == (0.0, 0.0)
    assert box.velocity[2] == 0.0
    assert box.angular_velocity[1] == 0.0
    assert box.position[2] - reach_below(box) < 0.001
    assert abs(cylinder.orientation[1]) > 0.6


def test_a_found_body_gets_the_label_of_its_true_one_and_another_is_nothing() -> None:
    true, flow = masks_and_flow(SCENE)
    found = np.array([0, 3, 1], np.uint8)[true]  # the box is instance 3, the cylinder instance 1
    found[:, :12, :12] = 2  # nobody
    clip = clip_of(SCENE, found, true, flow)
    pairs = true_pairs(clip)
    assert sorted(map(tuple, pairs.tolist())) == [(0, 2), (1, 0)]
    example = example_of_clip(clip, SCENE, pairs, SCHEDULE)
    kinds = [BASIC_SHAPES.index("box"), BASIC_SHAPES.index("cylinder"), NOTHING]
    assert example.shapes.tolist() == kinds
    assert example.values[2].tolist() == [0.0] * example.values.shape[1]
    box, cylinder, _ = example.instances.places[:, 0]
    assert box[5] < cylinder[5]  # x of the centroids, px


def test_a_clip_is_read_as_it_was_written(tmp_path: Path) -> None:
    true, flow = masks_and_flow(SCENE)
    clip = clip_of(SCENE, true, true, flow)
    write_clip(clip, tmp_path / "00000.npz")
    again = read_clip(tmp_path / "00000.npz")
    for name in ("found", "true", "flow", "pairs"):
        np.testing.assert_array_equal(getattr(again, name), getattr(clip, name))
    assert (again.reward, again.greedy_reward) == (0.75, 0.5)
    assert again.scene.shapes == SCENE.shapes
    assert list(tmp_path.glob("*.part*")) == []
