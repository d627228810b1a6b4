"""Events on and against bodies that do not move."""

import numpy as np
import pytest

from pipeline.clips.events import DEFAULT_THRESHOLDS, ROLL, SLIDE, Event, find_events, regimes
from pipeline.clips.schedule import Schedule
from pipeline.errors import SceneError
from pipeline.model.language.completion import think_text, write_completion
from pipeline.physics.simulate import simulate
from pipeline.scene.rotation import quaternion_multiply
from pipeline.scene.scene import Camera, FixedBody, Scene, SceneObject

STEPS = Schedule().frame_steps
ANGLE = np.radians(30)
TILT = np.array([np.cos(ANGLE / 2), 0, np.sin(ANGLE / 2), 0])
NORMAL = np.array([np.sin(ANGLE), 0, np.cos(ANGLE)])
RAMP = FixedBody("box", (3.0, 1.0, 0.1), tuple(-0.05 * NORMAL), tuple(TILT), name="ramp")


def events(scene: Scene) -> list[Event]:
    areas = np.full((len(STEPS), len(scene.objects)), 1000.0)
    return find_events(simulate(scene), scene.shapes, areas, STEPS, DEFAULT_THRESHOLDS)


def test_a_ball_and_a_pipe_roll_down_a_ramp_and_a_block_slides() -> None:
    side = np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0])
    on = {"position": tuple(0.1 * NORMAL), "sliding_friction": 1.0, "mass": 1.0}
    ball = SceneObject("sphere", (0.1,), **on)
    pipe = SceneObject("cylinder", (0.1, 0.2), orientation=tuple(quaternion_multiply(TILT, side)), hollow=0.9, **on)
    block = SceneObject("box", (0.2, 0.2, 0.2), orientation=tuple(TILT), **{**on, "sliding_friction": 0.2})
    for obj, regime in ((ball, ROLL), (pipe, ROLL), (block, SLIDE)):
        trace = simulate(Scene((obj,), ground=None, fixed=(RAMP,)), 0.6)
        table = regimes(trace, (obj.shape,), DEFAULT_THRESHOLDS)
        assert (table[48:, 0] == regime).all(), obj.shape


def test_a_ball_hits_a_wall_and_no_other_object_is_taken_for_it() -> None:
    wall = FixedBody("box", (0.1, 2, 2), (1, 0, 0), name="wall")
    still = SceneObject("box", (0.2, 0.2, 0.2), 1.0, position=(-1, 0, 0.1))
    ball = SceneObject("sphere", (0.1,), 1.0, 0.0, position=(0, 0, 0.1), velocity=(2, 0, 0))
    found = [e for e in events(Scene((still, ball), fixed=(wall,))) if e.kind.startswith("hits")]
    assert [(e.kind, e.first, e.second, e.objects) for e in found] == [("hits_fixed", 1, 0, (1,))]
    assert found[0].time == pytest.approx(0.85 / 2, abs=0.02)


def test_words_name_fixed_bodies_and_an_answer_refuses_them() -> None:
    ball = SceneObject("sphere", (0.1,), 1.0, position=tuple(0.6 * NORMAL))
    scene = Scene((ball,), Camera((0, -2, 1), 40, pitch=-20), ground=None, fixed=(RAMP,))
    told = think_text(scene, events(scene), 1.0).splitlines()
    assert told[0] == "1 object: sphere."
    assert told[1].endswith("s: object 1 hits ramp.")
    with pytest.raises(SceneError, match="fixed: an answer"):
        write_completion(scene, None, 1.0)
    with pytest.raises(SceneError, match="hollow: an answer"):
        write_completion(Scene((SceneObject("sphere", (0.1,), 1.0, hollow=0.5),), scene.camera), None, 1.0)
