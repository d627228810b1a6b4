"""Drawn pendulums swing about their points, ever less, and stay in view."""

import numpy as np
import pytest

from benchmarks.hanging_scenes import VISIBLE_PX, draw_hanging_scene
from pipeline.clips.draw import in_view
from pipeline.physics.simulate import simulate


@pytest.mark.parametrize("seed", range(4))
def test_pendulums_swing_about_their_points_and_stay_in_view(seed: int) -> None:
    scene = draw_hanging_scene(np.random.default_rng(seed), 3.0)
    trace = simulate(scene, 3.0)
    for i, body in enumerate(scene.objects):
        assert body.joint is not None
        arm = np.linalg.norm(trace.position[:, i] - body.joint.anchor, axis=1)
        assert np.ptp(arm) < 0.01 * arm[0]
        height = trace.position[:, i, 2] - body.joint.anchor[2] + arm[0]
        energy = height * 9.81 + 0.5 * (np.gradient(trace.position[:, i], 1 / trace.rate, axis=0) ** 2).sum(1)
        assert energy[-5] < energy[5]
    assert in_view(scene, trace.position, trace.quaternion, VISIBLE_PX).mean() > 0.95
