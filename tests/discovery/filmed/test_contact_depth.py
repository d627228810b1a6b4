"""How deep MuJoCo's bounces go."""

import numpy as np
import pytest

from pipeline.discovery.filmed.contact_depth import contact_depth
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Scene, SceneObject

RADIUS = 0.05


@pytest.mark.parametrize("damping", [0.05, 0.2, 0.4])
def test_flights_before_and_after_a_simulated_bounce_meet_as_deep(damping: float) -> None:
    depths, formula = [], []
    for height in np.linspace(0.40, 0.44, 8):  # other phases of the time step
        ball = SceneObject("sphere", (RADIUS,), 0.15, position=(0, 0, RADIUS + height), damping=damping, name="ball")
        trace = simulate(Scene((ball,)), 0.6)
        z = trace.position[:, 0, 2] - RADIUS
        low = int(np.argmax(z < 0))
        high = low + int(np.argmax(z[low:] > 0))
        time = np.arange(len(z)) / trace.rate
        before, after = (
            np.polynomial.Polynomial.fit(time[s], z[s], 2) for s in (slice(20, low), slice(high, high + 12))
        )
        times = np.linspace(time[low - 1], time[high], 500)
        at = times[np.abs(before(times) - after(times)).argmin()]
        depths.append(-before(at))
        formula.append(contact_depth(-before.deriv()(at), after.deriv()(at)))
    assert np.mean(depths) == pytest.approx(np.mean(formula), rel=0.2)


def test_a_body_that_does_not_rise_again_meets_the_ground_at_its_height() -> None:
    assert contact_depth(3.0, 0.0) == 0.0
