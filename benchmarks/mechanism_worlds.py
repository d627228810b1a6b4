"""Worlds for the blind benchmark of mechanisms: a log of a model with something hidden, and the model without it.

Models: of dm_control's suite, and an arm of three joints. Motion: from random initial states, driven by random sums
of sines with steps. The log is of an encoder, which rounds and has noise. MuJoCo simulates the hidden model with a
quarter of the known model's time step, and with its own elements for delay and lag, where the discovery changes the
controls.
"""

from __future__ import annotations

import importlib.resources
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from pipeline.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.mechanisms.law_model import Acting
from pipeline.mechanisms.log import ONE_CLIP, Channel, Clip, Log, Quantity
from pipeline.mechanisms.mechanism import Mechanism, read_mechanism
from pipeline.mechanisms.places import may_act, places_of
from pipeline.mechanisms.registry import mechanism_effects

SUITE = ("pendulum", "cartpole", "acrobot", "reacher", "finger")
ARM = "arm"
ARM_XML = """
<mujoco model="arm">
  <option timestep="0.002" integrator="implicitfast"><flag contact="disable"/></option>
  <default><joint damping="0.05" armature="0.01"/><geom type="capsule" size="0.03" density="800"/></default>
  <worldbody>
    <body name="base" pos="0 0 0.2">
      <joint name="turn" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.1"/>
      <body name="upper" pos="0 0 0.1">
        <joint name="shoulder" axis="0 1 0"/><geom fromto="0 0 0 0.3 0 0"/>
        <body name="fore" pos="0.3 0 0"><joint name="elbow" axis="0 1 0"/><geom fromto="0 0 0 0.25 0 0"/></body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="drive_turn" joint="turn" kp="30" kv="2" ctrlrange="-2 2"/>
    <position name="drive_shoulder" joint="shoulder" kp="60" kv="4" ctrlrange="-2 2"/>
    <position name="drive_elbow" joint="elbow" kp="30" kv="2" ctrlrange="-2 2"/>
  </actuator>
</mujoco>
"""
MODELS = (*SUITE, ARM)
CLIPS, SECONDS, RATE = 5, 4.0, 100.0
FINER = 4  # steps of the hidden model in one of the known one
TURN, WAY = 2 * np.pi / 16384, 1e-4  # steps of an encoder: of 14 bits, rad, and m
NOISE = 1.0  # of its steps
STRENGTHS = {"strong": 60.0, "medium": 20.0}
"""How far the effect moves the joints in a clip, root mean square, in units of the noise."""
DRIVE = 0.7  # of the range of a control
SPEED = 1.0  # rad/s or m/s, of initial states
HELD = 5  # rows for which a control is held


@dataclass(frozen=True)
class MechanismWorld:
    """A world.

    Attributes:
        seed: That made it.
        model: Its name.
        hidden: Name of the effect; "none".
        strength: A key of `STRENGTHS`; empty for none.
        place: On what the effect acts.
        values: Its numbers.
        mechanism: The known model.
        log: What was measured.
    """

    seed: int
    model: str
    hidden: str
    strength: str
    place: str
    values: Values
    mechanism: Mechanism
    log: Log


def model_path(name: str, folder: Path) -> Path:
    """The file of a model; the arm is written into the folder."""
    if name == ARM:
        path = folder / "arm.xml"
        path.write_text(ARM_XML)
        return path
    return Path(str(importlib.resources.files("dm_control.suite") / f"{name}.xml"))


def make_world(seed: int, model: str, hidden: str, strength: str, folder: Path) -> MechanismWorld | None:
    """The world of a seed; None where the effect cannot act in that model, or cannot move it so far.

    Args:
        seed: Of all that is random.
        model: A name of `MODELS`.
        hidden: Name of an effect, or "none".
        strength: A key of `STRENGTHS`.
        folder: For files of models.
    """
    rng = np.random.default_rng([seed, MODELS.index(model)])
    mechanism = read_mechanism(model_path(model, folder))
    controls, states = _drive(mechanism, rng), _states(mechanism, rng)
    sigma = np.array([WAY if j.slide else TURN for j in mechanism.joints]) * NOISE
    calm = _motion(mechanism, None, controls, states)
    if hidden == "none":
        return MechanismWorld(seed, model, hidden, "", "", {}, mechanism, _log(mechanism, calm, controls, sigma, rng))
    kind = mechanism_effects()[hidden]
    plain = _log(mechanism, calm, controls, sigma, rng)
    options = [p for p in places_of(mechanism, plain)[kind.target] if may_act(kind, mechanism, plain, p)]
    if not options:
        return None
    place = options[rng.integers(len(options))]
    starts = kind.starts(place)
    start = starts[rng.integers(len(starts))]
    acting = Acting(kind, place)
    low, high = 0.01, 100.0
    for _ in range(12):  # bisection of the size
        share = float(np.sqrt(low * high))
        moved = _motion(mechanism, (acting, scaled(acting, start, share)), controls, states)
        apart = np.sqrt(np.mean((np.stack(moved) - np.stack(calm)) ** 2 / sigma**2))
        low, high = (share, high) if apart < STRENGTHS[strength] else (low, share)
    if not 0.3 < apart / STRENGTHS[strength] < 3:
        return None
    values = scaled(acting, start, share)
    log = _log(mechanism, _motion(mechanism, (acting, values), controls, states), controls, sigma, rng)
    return MechanismWorld(seed, model, hidden, strength, place.name, values, mechanism, log)


def scaled(acting: Acting, start: Values, share: float) -> Values:
    """Numbers of an effect, as far from none as a share of those with which fits begin."""
    out = {}
    for p in acting.kind.parameters:
        low, high = acting.bounds(p)
        if p.name in (acting.kind.linear, acting.kind.parameters[0].name) and p.name not in ("limit", "position"):
            neutral = acting.neutral(p)
            out[p.name] = np.clip(neutral + share * (np.asarray(start[p.name]) - neutral), low, high)
        elif p.name in ("limit", "position") and acting.kind.target is not Target.BODY:
            middle = 0.0 if p.name == "limit" else acting.place.middle
            out[p.name] = middle + (np.asarray(start[p.name]) - middle) / (1 + 0.3 * share)
        else:
            out[p.name] = np.asarray(start[p.name])
    return out


def _drive(mechanism: Mechanism, rng: np.random.Generator) -> list[np.ndarray]:
    """The controls of each clip, (T, nu): sums of sines, of which a third of the clips has steps instead."""
    model, time = mechanism.model, np.arange(int(SECONDS * RATE)) / RATE
    out = []
    for clip in range(CLIPS):
        u = np.zeros((len(time), model.nu))
        for k in range(model.nu):
            low, high = model.actuator_ctrlrange[k] if model.actuator_ctrllimited[k] else (-1.0, 1.0)
            if low == high:
                low, high = -1.0, 1.0
            waves = sum(
                rng.uniform(0.3, 1.0) * np.sin(2 * np.pi * f * time + rng.uniform(0, 2 * np.pi))
                for f in rng.uniform(0.2, 2.0, 3)
            )
            shape = np.sign(waves) if clip % 3 == 0 else waves / np.abs(waves).max()
            u[:, k] = (low + high) / 2 + DRIVE * (high - low) / 2 * shape
        out.append(np.repeat(u[::HELD], HELD, axis=0)[: len(time)])
    return out


def _states(mechanism: Mechanism, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    model, out = mechanism.model, []
    for _ in range(CLIPS):
        position, velocity = mechanism.rest.copy(), np.zeros(model.nv)
        for j in mechanism.joints:
            k = model.joint(j.name).id
            low, high = model.jnt_range[k] if model.jnt_limited[k] else (-1.0, 1.0)
            position[j.position] += rng.uniform(0.5 * low, 0.5 * high)
            velocity[j.velocity] = rng.normal(0, SPEED)
        out.append((position, velocity))
    return out


def _motion(
    mechanism: Mechanism,
    hidden: tuple[Acting, Values] | None,
    controls: Sequence[np.ndarray],
    states: Sequence[tuple[np.ndarray, np.ndarray]],
) -> list[np.ndarray]:
    """Positions of the joints in each clip, (T, joints), as their sensors show them."""
    spec = mechanism.physics.copy()
    spec.option.timestep /= FINER
    kind, values, place = None, {}, None
    if hidden is not None:
        kind, values, place = hidden[0].kind, hidden[1], hidden[0].place
        if kind.edit is not None:
            kind.edit(spec, place.name, values)
    model = spec.compile()
    clock = kind.clock(values) if kind is not None and kind.clock is not None else 1.0
    lag = kind.sensor_lag(values) if kind is not None and kind.sensor_lag is not None else 0.0
    columns = [j.position for j in mechanism.joints]
    out = []
    for u, (position, velocity) in zip(controls, states, strict=True):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = position, velocity
        if model.na:
            data.act[:] = u[0, : model.na]
        path, count = [data.qpos[columns].copy()], int(np.ceil(SECONDS / clock / model.opt.timestep)) + 1
        for k in range(count):
            row = int((k * model.opt.timestep * clock + 1e-9) * RATE)
            data.ctrl[:] = u[min(row, len(u) - 1)]
            if kind is not None and kind.friction is not None and place is not None:
                _rub(model, data, kind, values, mechanism.joint(place.name).velocity)
            mujoco.mj_step(model, data)
            path.append(data.qpos[columns].copy())
        at, grid = np.arange(len(u)) / RATE / clock, np.arange(len(path)) * model.opt.timestep
        seen = np.stack(
            [
                np.interp(at - (lag if place is not None and j.name == place.name else 0.0), grid, x)
                for j, x in zip(mechanism.joints, np.array(path).T, strict=True)
            ],
            1,
        )
        if kind is not None and kind.measured is not None and place is not None:
            c = [j.name for j in mechanism.joints].index(place.name)
            seen[:, c] = kind.measured(values, seen[:, c])
        out.append(seen)
    return out


def _rub(model: mujoco.MjModel, data: mujoco.MjData, kind: MechanismEffect, values: Values, dof: int) -> None:
    assert kind.friction is not None
    model.dof_frictionloss[dof] = kind.friction(values, float(data.qvel[dof]), float(data.qfrc_actuator[dof]))


def _log(
    mechanism: Mechanism,
    motion: Sequence[np.ndarray],
    controls: Sequence[np.ndarray],
    sigma: np.ndarray,
    rng: np.random.Generator,
) -> Log:
    """What the encoders write of a motion. sigma: (joints,) of their noise; they round to steps of that size."""
    channels = tuple(Channel(j.name, Quantity.JOINT, j.name, 0, j.unit) for j in mechanism.joints)
    clips = []
    for k, (x, u) in enumerate(zip(motion, controls, strict=True)):
        step = sigma / NOISE
        seen = np.round((x + rng.normal(0, 1, x.shape) * sigma) / step) * step
        clips.append(Clip(f"{ONE_CLIP}_{k}", np.arange(len(u)) / RATE, seen, u, None))
    return Log(channels, tuple(clips), mechanism.actuators)
