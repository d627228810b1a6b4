"""Small mechanisms for tests: a pendulum and a cart on a spring, integrated here, and logs of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.discovery.mechanisms.discovery import MechanismDiscovery, discover_mechanism
from pipeline.discovery.mechanisms.log import read_log
from pipeline.discovery.mechanisms.mechanism import read_mechanism
from pipeline.discovery.mechanisms.registry import mechanism_effects

PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.005" integrator="RK4"/>
  <worldbody>
    <body name="bob"><joint name="hinge" axis="0 1 0"/>
      <inertial pos="0 0 -0.5" mass="0.4" diaginertia="1e-6 1e-6 1e-6"/></body>
  </worldbody>
</mujoco>
"""
CART = """
<mujoco model="cart">
  <option timestep="0.005" integrator="RK4" gravity="0 0 0"/>
  <worldbody>
    <body name="cart"><joint name="slide" type="slide" axis="1 0 0" stiffness="20"/>
      <geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
  </worldbody>
  <actuator><motor name="push" joint="slide"/></actuator>
</mujoco>
"""
GRAVITY, LENGTH, MASS = 9.81, 0.5, 0.4
Acceleration = Callable[[float, float, float], float]
"""(position, velocity, control) -> acceleration."""


def path_of(
    acceleration: Acceleration, start: tuple[float, float], time: np.ndarray, control: np.ndarray
) -> np.ndarray:
    """Positions (T,) at regular times, by Runge and Kutta's method with steps of 1 ms; the control is held."""
    q, v = start
    out, step = [q], 1e-3
    for k in range(len(time) - 1):
        for _ in range(round((time[k + 1] - time[k]) / step)):
            u = float(control[k])
            a1 = acceleration(q, v, u)
            a2 = acceleration(q + step / 2 * v, v + step / 2 * a1, u)
            a3 = acceleration(q + step / 2 * (v + step / 2 * a1), v + step / 2 * a2, u)
            a4 = acceleration(q + step * (v + step / 2 * a2), v + step * a3, u)
            q, v = q + step * v + step**2 / 6 * (a1 + a2 + a3), v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        out.append(q)
    return np.array(out)


def write_log(
    path: Path,
    column: str,
    acceleration: Acceleration,
    noise: float,
    rng: np.random.Generator,
    *,
    clips: int = 4,
    actuator: str | None = None,
) -> None:
    """A log of clips of 4 s at 50 Hz from random states, driven by steps of the control where there is an actuator."""
    time, parts = np.arange(200) / 50, []
    for clip in range(clips):
        control = np.repeat(rng.normal(0, 2.0, 10), 20) if actuator else np.zeros(200)
        start = (rng.uniform(0.6, 1.4), rng.normal(0, 1)) if not actuator else (rng.normal(0, 0.2), 0.0)
        q = path_of(acceleration, start, time, control) + rng.normal(0, noise, 200)
        columns = {"clip": f"clip_{clip}", "time": time, column: q}
        parts.append(pd.DataFrame(columns | ({actuator: control} if actuator else {})))
    pd.concat(parts).to_csv(path, index=False)


def discovered(log: Path, model: Path, fit: tuple[str, ...] = (), held_out: float = 0.3) -> MechanismDiscovery:
    mechanism = read_mechanism(model)
    names = tuple(mechanism_effects())
    return discover_mechanism(read_log(log, mechanism), mechanism, held_out, names, fit, np.random.default_rng(0))
