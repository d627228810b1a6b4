"""Simulation of windows of the log: many models and many initial states at once, by `mujoco.rollout`."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from pipeline.discovery.mechanisms.held_control import held
from pipeline.discovery.mechanisms.law_model import Variant
from pipeline.discovery.mechanisms.log import Channel, Log, Quantity
from pipeline.discovery.mechanisms.mechanism import Mechanism

MOST_NUMBERS = 30_000_000  # of states in memory at once
SIMILAR = 1.25  # ratio of lengths of windows that are simulated in one batch
FULL = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
LARGEST = 1e9  # of a predicted number: where the motion diverges


@dataclass(frozen=True)
class Window:
    """A stretch of a clip with its own initial state.

    Attributes:
        clip: Index of the clip.
        rows: Of the clip, from the first to before the last.
        held: Whether it is not fitted, but for its initial state.
        ahead: Rows after these that are forecast, and not fitted at all; None: none.
    """

    clip: int
    rows: slice
    held: bool
    ahead: slice | None = None


@dataclass(frozen=True)
class States:
    """Initial states of W windows: positions (W, nq), velocities (W, nv), activations (W, na)."""

    position: np.ndarray
    velocity: np.ndarray
    activation: np.ndarray

    def __len__(self) -> int:
        return len(self.position)

    @property
    def size(self) -> int:
        """Number of their changes: of positions, velocities and activations."""
        return 2 * self.velocity.shape[1] + self.activation.shape[1]

    def moved(self, model: mujoco.MjModel, change: np.ndarray) -> States:
        """The states after changes (W, 2 nv + na); of a ball's or a free joint's turn it is a rotation vector."""
        nv = self.velocity.shape[1]
        position = self.position.copy()
        for row, step in zip(position, change[:, :nv], strict=True):
            mujoco.mj_integratePos(model, row, step, 1.0)
        return States(position, self.velocity + change[:, nv : 2 * nv], self.activation + change[:, 2 * nv :])

    def varied(self, model: mujoco.MjModel, steps: np.ndarray) -> States:
        """The W states, and then all of them after each of the steps (L,) alone, ((L + 1) W)."""
        changes = np.repeat(np.diag(steps)[:, None], len(self), axis=1)
        return joined([self, *(self.moved(model, change) for change in changes)])

    def put(self, row: int, state: States) -> None:
        """Replace one of the states by another one, of one row."""
        self.position[row], self.velocity[row] = state.position[0], state.velocity[0]
        self.activation[row] = state.activation[0]

    def of(self, rows: Sequence[int] | np.ndarray) -> States:
        """Some of the states."""
        return States(self.position[rows], self.velocity[rows], self.activation[rows])


def joined(parts: Sequence[States]) -> States:
    """Several sets of states, one after the other."""
    return States(
        np.concatenate([s.position for s in parts]),
        np.concatenate([s.velocity for s in parts]),
        np.concatenate([s.activation for s in parts]),
    )


@contextlib.contextmanager
def _without_warnings() -> Iterator[None]:
    """Trials that diverge are seen by their residuals; MuJoCo would write each into a file."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        mujoco.set_mju_user_warning(before)


class Simulator:
    """Simulates windows of one log with variants of one mechanism.

    Args:
        mechanism: The user's model.
        log: The log.
        spec: The document that variants are made of, with sensors for the measured sites and bodies.
    """

    def __init__(self, mechanism: Mechanism, log: Log, spec: mujoco.MjSpec) -> None:
        self.mechanism, self.log, self.spec = mechanism, log, spec
        model = spec.compile()
        self.model, self.step = model, float(model.opt.timestep)
        self._threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._data = [mujoco.MjData(model) for _ in range(self._threads)]
        self._rollout = Rollout(nthread=self._threads)
        self._blank = np.zeros(mujoco.mj_stateSize(model, FULL))
        mujoco.mj_getState(model, self._data[0], self._blank, FULL)

    def predict(
        self, windows: Sequence[Window], variants: Sequence[Variant], jobs: Sequence[tuple[int, int]], states: States
    ) -> list[np.ndarray]:
        """What each job would measure, (rows, C); not finite where the motion diverges.

        Args:
            windows: Stretches of the log.
            variants: Models.
            jobs: For each, the indices of its window and of its variant.
            states: For each, where it begins.
        """
        return self._read(windows, variants, jobs, states, self._measured)

    def ends(self, windows: Sequence[Window], variant: Variant, states: States) -> States:
        """The states at the last rows of windows, of a model. states: where they begin; all windows, once or again."""
        jobs = [(k % len(windows), 0) for k in range(len(states))]
        rows = np.stack(self._read(windows, [variant], jobs, states, self._last))
        nq, nv = self.model.nq, self.model.nv
        return States(*np.split(rows[:, 1 : 1 + nq + nv + self.model.na], [nq, nq + nv], axis=1))

    @_without_warnings()
    def _read(
        self,
        windows: Sequence[Window],
        variants: Sequence[Variant],
        jobs: Sequence[tuple[int, int]],
        states: States,
        reading: Callable[[Window, Variant, np.ndarray, np.ndarray], np.ndarray],
    ) -> list[np.ndarray]:
        """What is read of each job's motion. reading: (window, model, states (steps + 1, n), sensors (steps, s))."""
        out: list[np.ndarray] = [np.zeros(0)] * len(jobs)
        steps = np.array([self._steps(windows[w], variants[v]) for w, v in jobs])
        plain = [k for k, (_, v) in enumerate(jobs) if not variants[v].frictions]
        order = sorted(plain, key=lambda k: steps[k])
        while order:
            most = int(max(1, MOST_NUMBERS // ((steps[order[-1]] + 1) * (len(self._blank) + self.model.nu))))
            batch = [k for k in order if SIMILAR * steps[k] >= steps[order[-1]]][-most:]
            order = order[: len(order) - len(batch)]
            count = int(steps[batch].max())
            begin = self._initial(states.of(batch))
            control = np.zeros((len(batch), count, self.model.nu))
            if self.model.nu:
                known: dict[tuple[int, int], np.ndarray] = {}
                for i, k in enumerate(batch):
                    w, v = jobs[k]
                    key = (w, v if variants[v].controls or variants[v].clock != 1 else -1)
                    if key not in known:
                        known[key] = self._controls(windows[w], variants[v], count)
                    control[i] = known[key]
            models = [variants[jobs[k][1]].model for k in batch]
            path, sensed = self._rollout.rollout(
                models, self._data, begin, control if self.model.nu else None, nstep=count
            )
            path = np.concatenate([begin[:, None], path], 1)
            for i, k in enumerate(batch):
                w, v = jobs[k]
                out[k] = reading(windows[w], variants[v], path[i], sensed[i])
        for k in set(range(len(jobs))) - set(plain):
            w, v = jobs[k]
            path_k, sensed_k = self._stepwise(windows[w], variants[v], states.of([k]), int(steps[k]))
            out[k] = reading(windows[w], variants[v], path_k, sensed_k)
        return out

    def _steps(self, window: Window, variant: Variant) -> int:
        time = self.log.clips[window.clip].time[window.rows]
        return int(np.ceil((time[-1] - time[0]) / variant.clock / self.step - 1e-6)) + 1

    def _initial(self, states: States) -> np.ndarray:
        out = np.tile(self._blank, (len(states), 1))
        nq, nv, na = self.model.nq, self.model.nv, self.model.na
        out[:, 1 : 1 + nq], out[:, 1 + nq : 1 + nq + nv] = states.position, states.velocity
        out[:, 1 + nq + nv : 1 + nq + nv + na] = states.activation
        return out

    def _controls(self, window: Window, variant: Variant, count: int) -> np.ndarray:
        """The controls of each step, (count, nu)."""
        clip = self.log.clips[window.clip]
        begin = clip.time[window.rows][0]
        at = begin + np.arange(count + 1) * self.step * variant.clock
        out = np.stack([held(clip.time, clip.controls[:, k], at) for k in range(self.model.nu)], 1)
        for k, values, law in variant.controls:
            out[:, k] = law(values, clip.time, clip.controls[:, k], at)
        return out

    def _stepwise(self, window: Window, variant: Variant, state: States, count: int) -> tuple[np.ndarray, np.ndarray]:
        """States (count + 1, n) and sensors (count, s) of a model whose dry friction changes at each step."""
        model, data = variant.model, mujoco.MjData(variant.model)
        begin = self._initial(state)[0]
        mujoco.mj_setState(model, data, begin, FULL)
        controls = self._controls(window, variant, count) if model.nu else np.zeros((count, 0))
        path, sensed = np.empty((count + 1, len(begin))), np.empty((count, model.nsensordata))
        path[0] = begin
        loss, speed, force = model.dof_frictionloss, data.qvel, data.qfrc_actuator  # views: each access makes one
        ctrl, sensors = data.ctrl, data.sensordata
        laws = [(d, v, law, float(loss[d])) for d, v, law in variant.frictions]
        for k in range(count):
            ctrl[:] = controls[k]
            for d, values, law, own in laws:
                loss[d] = own + law(values, float(speed[d]), float(force[d]))
            mujoco.mj_step(model, data)
            sensed[k] = sensors
            mujoco.mj_getState(model, data, path[k + 1], FULL)
        for d, _, _, own in laws:
            loss[d] = own
        return path, sensed

    def _measured(self, window: Window, variant: Variant, path: np.ndarray, sensed: np.ndarray) -> np.ndarray:
        """What the columns of the log would be, (rows, C).

        Args:
            window: Which rows.
            variant: The model.
            path: (steps + 1, n) states.
            sensed: (steps, s) sensors, each of the state before its step.
        """
        time = self.log.clips[window.clip].time[window.rows]
        since = (time - time[0]) / variant.clock
        channels = self.log.channels
        out = np.empty((len(time), len(channels)))
        nq = self.model.nq
        for c, channel in enumerate(channels):
            late = variant.sensor_lag.get(channel.name, 0.0)
            at = since - late
            if channel.quantity in (Quantity.JOINT, Quantity.VELOCITY):
                joint = self.mechanism.joint(channel.name)
                q, v = path[:, 1 + joint.position], path[:, 1 + nq + joint.velocity]
                x = _hermite(q, v, self.step, at) if channel.quantity is Quantity.JOINT else _linear(v, self.step, at)
                for values, law in variant.measured.get(channel.name, []):
                    x = law(values, x) if channel.quantity is Quantity.JOINT else law(values, x) - law(values, 0 * x)
                out[:, c] = x
            else:
                out[:, c] = _linear(sensed[:, self._sensor(channel)], self.step, at)
        return np.clip(out, -LARGEST, LARGEST)

    def _last(self, window: Window, variant: Variant, path: np.ndarray, sensed: np.ndarray) -> np.ndarray:
        """The state (n,) at the last row of a window. Arguments as of `_measured`."""
        time = self.log.clips[window.clip].time[window.rows]
        return _linear(path, self.step, (time[-1] - time[0]) / variant.clock)

    def _sensor(self, channel: Channel) -> int:
        name = channel.name if channel.quantity is Quantity.SENSOR else sensor_name(channel)
        return int(self.model.sensor(name).adr[0]) + channel.component


def sensor_name(channel: Channel) -> str:
    """Of the sensor that measures the position of a site or a body."""
    return f"__position of {channel.quantity} {channel.name}"


def with_sensors(spec: mujoco.MjSpec, channels: Sequence[Channel]) -> mujoco.MjSpec:
    """A copy of a document that measures the sites and bodies of the log, and in which a motion that diverges goes on.

    Where the log has no sensors none are computed.
    """
    out = spec.copy()
    sensed = False
    for channel in channels:
        sensed |= channel.quantity not in (Quantity.JOINT, Quantity.VELOCITY)
        if channel.quantity in (Quantity.SITE, Quantity.BODY):
            name, site = sensor_name(channel), channel.quantity is Quantity.SITE
            if name not in [s.name for s in out.sensors]:
                out.add_sensor(
                    name=name,
                    type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
                    objtype=mujoco.mjtObj.mjOBJ_SITE if site else mujoco.mjtObj.mjOBJ_XBODY,
                    objname=channel.name,
                )
    out.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    if not sensed:
        out.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    return out


def _place(count: int, step: float, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The step before each time, and the share of the step since it; negative before the beginning."""
    k = np.clip(np.floor(at / step + 1e-9).astype(int), 0, count - 2)
    return k, at / step - k


def _linear(x: np.ndarray, step: float, at: np.ndarray) -> np.ndarray:
    k, s = _place(len(x), step, at)
    return np.asarray(x[k] * (1 - s) + x[k + 1] * s)


def _hermite(x: np.ndarray, v: np.ndarray, step: float, at: np.ndarray) -> np.ndarray:
    """Between the steps of a path x (n,) with velocities v (n,) by Hermite's cubic; before it straight on."""
    k, s = _place(len(x), step, at)
    h00, h10 = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2
    h01, h11 = s * s * (3 - 2 * s), s * s * (s - 1)
    inside = h00 * x[k] + h10 * step * v[k] + h01 * x[k + 1] + h11 * step * v[k + 1]
    return np.where(s < 0, x[k] + s * step * v[k], inside)
