"""Worlds for the blind benchmark of mechanisms: a log of a model with something hidden, and the model without it.

Models: six of dm_control's suite, an arm of three joints whose drives hold positions, and a crane with motors.
Hidden: one effect, two, or a law that no effect states. Motion: from random initial states, driven by random sums of
sines with steps. The log is of an encoder, which rounds and has noise. MuJoCo simulates the hidden model by Runge and
Kutta's method with steps of 0.2 ms at most, since a real mechanism has none, and with its own elements for delay and
lag, where the discovery changes the controls.
"""

from __future__ import annotations

import functools
import importlib.resources
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.held_control import held
from pipeline.discovery.mechanisms.kind import Target, Values
from pipeline.discovery.mechanisms.law_model import Acting
from pipeline.discovery.mechanisms.log import ONE_CLIP, Channel, Clip, Log, Quantity
from pipeline.discovery.mechanisms.mechanism import Mechanism, read_mechanism
from pipeline.discovery.mechanisms.places import may_act, places_of
from pipeline.discovery.mechanisms.registry import mechanism_effects

SUITE = ("pendulum", "cartpole", "acrobot", "reacher", "finger", "point_mass")
OWN = {
    "arm": """
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
""",
    "crane": """
<mujoco model="crane">
  <option timestep="0.002" integrator="implicitfast"><flag contact="disable"/></option>
  <default><geom type="capsule" size="0.02" density="1000"/></default>
  <worldbody>
    <body name="trolley" pos="0 0 1">
      <joint name="travel" type="slide" axis="1 0 0" damping="4"/><geom type="box" size="0.1 0.05 0.05" mass="2"/>
      <body name="boom">
        <joint name="swing" axis="0 1 0" damping="0.02"/><geom fromto="0 0 0 0 0 -0.5"/>
        <body name="hook" pos="0 0 -0.5">
          <joint name="wrist" axis="0 1 0" damping="0.01"/><geom fromto="0 0 0 0 0 -0.2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="pull" joint="travel" gear="12" ctrlrange="-1 1"/>
    <motor name="turn" joint="wrist" gear="0.3" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
""",
}
MODELS = (*SUITE, *OWN)
CLIPS, SECONDS, RATE = 5, 4.0, 100.0
STEP = 2e-4  # s, of the hidden model at most: a real mechanism has none
TURN, WAY = 2 * np.pi / 16384, 1e-4  # steps of an encoder: of 14 bits, rad, and m
NOISE = 1.0  # of its steps
STRENGTHS = {"strong": 60.0, "medium": 20.0}
"""How far the effect moves the joints in a clip, root mean square, in units of the noise."""
DRIVE = 0.7  # of the range of a control
SPEED = 1.0  # rad/s or m/s, of initial states
SIZING = 2  # clips in which the size of an effect is chosen
HELD = 5  # rows for which a control is held
NONE, TWO, UNLISTED = "none", "two effects", "unlisted"
Law = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
"""Time, positions (J,) and velocities (J,) of the joints -> forces on them (J,)."""
Hidden = tuple[Acting, Values]


@dataclass(frozen=True)
class MechanismWorld:
    """A world.

    Attributes:
        seed: That made it.
        model: Its name.
        hidden: Names of the effects; of a law that is not listed its own.
        places: On what each acts.
        values: Their numbers.
        mechanism: The known model.
        log: What was measured.
    """

    seed: int
    model: str
    hidden: tuple[str, ...]
    places: tuple[str, ...]
    values: tuple[Values, ...]
    mechanism: Mechanism
    log: Log


def model_path(name: str, folder: Path) -> Path:
    """The file of a model; our own are written into the folder."""
    if name in OWN:
        path = folder / f"{name}.xml"
        path.write_text(OWN[name])
        return path
    return Path(str(importlib.resources.files("dm_control.suite") / f"{name}.xml"))


def make_world(seed: int, model: str, hidden: str, strength: str, folder: Path) -> MechanismWorld | None:
    """The world of a seed; None where what is hidden cannot act in that model, or cannot move it so far.

    Args:
        seed: Of all that is random.
        model: A name of `MODELS`.
        hidden: Name of an effect, `NONE`, `TWO` or `UNLISTED`.
        strength: A key of `STRENGTHS`, of each effect alone.
        folder: For files of models.
    """
    rng = np.random.default_rng([seed, MODELS.index(model)])
    mechanism = read_mechanism(model_path(model, folder))
    controls, states = _drive(mechanism, rng), _states(mechanism, rng)
    sigma = np.array([WAY if j.slide else TURN for j in mechanism.joints]) * NOISE
    calm = _motion(mechanism, (), None, controls, states)
    plain = _log(mechanism, calm, controls, sigma, rng)

    def apart(some: Sequence[Hidden], law: Law | None) -> float:
        moved = _motion(mechanism, some, law, controls[:SIZING], states[:SIZING])
        return float(np.sqrt(np.mean((np.stack(moved) - np.stack(calm[:SIZING])) ** 2 / sigma**2)))

    def sized(distance: Callable[[float], float]) -> float | None:
        """The share of an effect that has the strength, by bisection."""
        low, high = 0.01, 100.0
        for _ in range(7):
            share = float(np.sqrt(low * high))
            low, high = (share, high) if distance(share) < STRENGTHS[strength] else (low, share)
        return share if 0.3 < distance(share) / STRENGTHS[strength] < 3 else None

    some: list[Hidden] = []
    names: list[str] = []
    numbers: list[Values] = []
    law: Law | None = None
    if hidden == UNLISTED:
        name, unit = _unlisted(mechanism, plain, rng)
        share = sized(lambda s: apart((), _times(unit, s)))
        if share is None:
            return None
        law, names, numbers = _times(unit, share), [name], [{"share": np.array([share])}]
    elif hidden != NONE:
        kinds = list(mechanism_effects()) if hidden == TWO else [hidden]
        for name in rng.permutation(kinds)[: 2 if hidden == TWO else 1].tolist():
            kind = mechanism_effects()[name]
            options = [p for p in places_of(mechanism, plain)[kind.target] if may_act(kind, mechanism, plain, p)]
            if not options:
                return None
            place = options[rng.integers(len(options))]
            starts = kind.starts(place)
            start, acting = starts[int(rng.integers(len(starts)))], Acting(kind, place)
            law_of = functools.partial(scaled, acting, start)
            share = sized(lambda s: apart([(acting, law_of(s))], None))  # noqa: B023
            if share is None:
                return None
            some.append((acting, law_of(share)))
        names, numbers = [a.kind.name for a, _ in some], [values for _, values in some]
    log = _log(mechanism, _motion(mechanism, some, law, controls, states), controls, sigma, rng)
    places = tuple(a.place.name for a, _ in some)
    return MechanismWorld(seed, model, tuple(names), places, tuple(numbers), mechanism, log)


def _unlisted(mechanism: Mechanism, log: Log, rng: np.random.Generator) -> tuple[str, Law]:
    """Name of a law that no effect states, and the law, at one joint or between two.

    Ripple: a force that repeats along the joint, as of a motor's magnets. Shaking: a force of an unseen machine that
    repeats in time. Gyration: each of two joints is pushed by the other's speed, without loss.
    """
    places = places_of(mechanism, log)[Target.JOINT]
    k, phase = int(rng.integers(len(places))), rng.uniform(0, 2 * np.pi)
    place, other = places[k], int((k + 1) % len(places))
    size, push = place.torque, np.eye(len(places))[k]
    waves = 2 * np.pi * 3 / place.spread
    laws: dict[str, Law] = {
        "ripple": lambda t, q, v: size * push * np.sin(waves * q[k] + phase),
        "shaking": lambda t, q, v: size * push * np.sin(2 * np.pi * 1.3 * t + phase),
    }
    if other != k:
        way = np.eye(len(places))[other]
        laws["gyration"] = lambda t, q, v: size / places[other].speed * (push * v[other] - way * v[k])
    name = sorted(laws)[rng.integers(len(laws))]
    return name, laws[name]


def _times(law: Law, share: float) -> Law:
    return lambda t, q, v: share * law(t, q, v)


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
    hidden: Sequence[Hidden],
    law: Law | None,
    controls: Sequence[np.ndarray],
    states: Sequence[tuple[np.ndarray, np.ndarray]],
) -> list[np.ndarray]:
    """Positions of the joints in each clip, (T, joints), as their sensors show them."""
    spec = mechanism.physics.copy()
    spec.option.timestep, spec.option.integrator = min(spec.option.timestep / 4, STEP), mujoco.mjtIntegrator.mjINT_RK4
    for acting, values in hidden:
        if acting.kind.edit is not None:
            acting.kind.edit(spec, acting.place.name, values)
    model = spec.compile()
    clock = float(np.prod([a.kind.clock(v) for a, v in hidden if a.kind.clock is not None]))
    columns, speeds = [j.position for j in mechanism.joints], [j.velocity for j in mechanism.joints]
    own = model.dof_frictionloss.copy()
    rubbing = [(a.kind.friction, v, mechanism.joint(a.place.name).velocity) for a, v in hidden if a.kind.friction]
    out = []
    for u, (position, velocity) in zip(controls, states, strict=True):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = position, velocity
        if model.na:
            data.act[:] = u[0, : model.na]
        path, count = [data.qpos[columns].copy()], int(np.ceil(SECONDS / clock / model.opt.timestep)) + 1
        times = np.arange(count + 1) * model.opt.timestep * clock
        commands = [held(np.arange(len(u)) / RATE, x, times) for x in u.T]
        for k in range(count):
            data.ctrl[:] = [x[k] for x in commands]
            for friction, values, dof in rubbing:
                rubbed = friction(values, float(data.qvel[dof]), float(data.qfrc_actuator[dof]))
                model.dof_frictionloss[dof] = own[dof] + rubbed
            if law is not None:
                data.qfrc_applied[speeds] = law(data.time, data.qpos[columns], data.qvel[speeds])
            mujoco.mj_step(model, data)
            path.append(data.qpos[columns].copy())
        at, grid, moved = np.arange(len(u)) / RATE / clock, np.arange(len(path)) * model.opt.timestep, np.array(path)
        seen = np.empty((len(u), len(columns)))
        for c, joint in enumerate(mechanism.joints):
            mine = [(a.kind, v) for a, v in hidden if a.place.name == joint.name]
            late = sum(kind.sensor_lag(v) for kind, v in mine if kind.sensor_lag is not None)
            seen[:, c] = np.interp(at - late, grid, moved[:, c])
            for kind, values in mine:
                if kind.measured is not None:
                    seen[:, c] = kind.measured(values, seen[:, c])
        out.append(seen)
    return out


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
