"""Arcs of one kind (in the air, or on the ground) as padded arrays, which are integrated and fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.tracks.arc import FAR_AWAY, Arc
from pipeline.discovery.tracks.camera_error import CameraError, stacked
from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import half_extents

FLIGHT_RATE, GROUND_RATE = 36, 60  # integration steps per second
LEAST_FREE = 0.25  # of the coordinates of an arc whose parameters nearly fit its filtered noise
SPIN_SIGMA_SHARE = 0.03  # standard deviation of a measured spin, relative to its size


@dataclass(frozen=True)
class ArcStack:
    """A arcs of up to n samples, integrated in K steps each.

    Attributes:
        grounded: On the ground, else in the air.
        steps: K.
        index: (A,) which arcs they are.
        clip: (A,) names of the clips.
        object: (A,) indices of the objects.
        time: (A, n) s, since the arc's start.
        start: (A,) s.
        duration: (A,) s.
        position: (A, n, 3) m.
        weight: (A, n, 3) 1/m, inverse standard deviation; 0 where there is no sample.
        mass: (A,) kg.
        radius: (A,) m; 0 for bodies that do not roll.
        inertia: (A,) kg m².
        friction: (A,) stated sliding friction.
        rolling: (A,) m, stated rolling friction.
        gravity: (A, 3) m/s².
        spin: (A, 3) rad/s, mean over the arc; 0 where it was not measured.
        has_spin: (A,) bool.
        spin_rows: (A, n, 3) rad/s, measured spins of arcs on the ground.
        spin_weight: (A, n, 3) s/rad, inverse standard deviation; 0 where there is none.
        others: (A, 2 K + 1, M, 3) m, centres of the other objects at half steps.
        rotation: (A, n, 3, 3) of the body; identity where it was not measured.
        length_scale_sigma: Standard deviation of each arc's own length scale, relative; 0: lengths are exact.
        friction_sigma: Standard deviation of the sliding friction of each slide, relative; 0: all have the same.
        spin_sigma: rad/s, standard deviation of the spins of balls in the air that were not measured; 0: they are 0.
        camera_error: What is not known of the camera that all arcs share.
        tied: (A,) bool, balls whose spin was not measured and is tied to their velocity: they are assumed to roll.
    """

    grounded: bool
    steps: int
    index: np.ndarray
    clip: np.ndarray
    object: np.ndarray
    time: np.ndarray
    start: np.ndarray
    duration: np.ndarray
    position: np.ndarray
    weight: np.ndarray
    mass: np.ndarray
    radius: np.ndarray
    inertia: np.ndarray
    friction: np.ndarray
    rolling: np.ndarray
    gravity: np.ndarray
    spin: np.ndarray
    has_spin: np.ndarray
    spin_rows: np.ndarray
    spin_weight: np.ndarray
    others: np.ndarray
    rotation: np.ndarray
    length_scale_sigma: float = 0.0
    friction_sigma: float = 0.0
    spin_sigma: float = 0.0
    tied: np.ndarray | None = None
    camera_error: CameraError | None = None

    def __len__(self) -> int:
        return len(self.index)

    @property
    def own(self) -> int:
        """Parameters of each arc that positions determine."""
        nuisances = int(self.length_scale_sigma > 0) + int(self.friction_sigma > 0) + 3 * (self.spin_sigma > 0)
        return (4 if self.grounded else 6) + nuisances

    @property
    def slides(self) -> np.ndarray:
        """(A,) bool, bodies on the ground that do not roll."""
        return (self.radius == 0) & self.grounded

    @property
    def unmeasured_spin(self) -> np.ndarray:
        """(A,) bool, balls in the air whose spin was not measured."""
        return ~self.has_spin & (self.radius > 0) & (not self.grounded)

    @property
    def samples(self) -> np.ndarray:
        """(A,) number of samples of each arc."""
        return (self.weight.max(2) > 0).sum(1)

    def free_rows(self, information: float) -> np.ndarray:
        """(A,) number of coordinates of each arc less those that its own parameters fit. information: independent
        samples per sample: a parameter fits as much as one of them."""
        count = (self.weight > 0).sum((1, 2))
        return np.where(
            self.samples > 0, np.maximum(count - self.own / information, LEAST_FREE * (1 - information) * count), 0.0
        )


def stack_arcs(arcs: Sequence[Arc], known: KnownScene, grounded: bool) -> ArcStack:
    """The arcs of one kind."""
    index = np.array([i for i, a in enumerate(arcs) if a.grounded == grounded], int)
    chosen = [arcs[i] for i in index]
    count, n = len(chosen), max((len(a.time) for a in chosen), default=0)
    most = max((len(known.scene.objects) - 1, 0))
    duration = np.array([a.time[-1] - a.time[0] for a in chosen])
    rate = GROUND_RATE if grounded else FLIGHT_RATE
    steps = int(np.clip(np.ceil(rate * duration.max(initial=0.0)), 8, 1500))
    time, position, weight = np.zeros((count, n)), np.zeros((count, n, 3)), np.zeros((count, n, 3))
    rotation = np.tile(np.eye(3), (count, n, 1, 1))
    spin_rows, spin_weight = np.zeros((count, n, 3)), np.zeros((count, n, 3))
    others = np.full((count, 2 * steps + 1, most, 3), FAR_AWAY)
    bodies = [known.of_clip(a.clip).objects[a.object] for a in chosen]
    scenes = [known.of_clip(a.clip) for a in chosen]
    # A two-dimensional recording has no depth; in a body that rests no coordinate may vary.
    measured = np.any([np.ptp(a.position, axis=0) > 0 for a in arcs], axis=0)
    for i, arc in enumerate(chosen):
        m = len(arc.time)
        time[i, :m], position[i, :m] = arc.time - arc.time[0], arc.position
        time[i, m:] = time[i, m - 1]
        weight[i, :m] = (1 / arc.sigma)[:, None] * measured
        if arc.quaternion is not None and np.isfinite(arc.quaternion).all():
            rotation[i, :m] = matrix_from_quaternion(arc.quaternion)
        if grounded and arc.spin is not None:
            there = np.isfinite(arc.spin).all(1)
            size = np.linalg.norm(arc.spin[there], axis=1).mean() if there.any() else 0.0
            rough = np.abs(np.diff(arc.spin[there], axis=0)).mean() if there.sum() > 1 else 0.0
            spin_rows[i, :m] = np.nan_to_num(arc.spin)
            spin_weight[i, :m][there] = 1 / (SPIN_SIGMA_SHARE * size + rough + 0.05)
        grid = np.linspace(arc.time[0], arc.time[-1], 2 * steps + 1)
        for j in range(arc.others.shape[1]):
            others[i, :, j] = np.stack([np.interp(grid, arc.time, c) for c in arc.others[:, j].T], 1)
    if grounded:
        weight[..., 2] = 0.0
    half = np.array([half_extents(o) if o.shape != "mesh" else np.zeros(3) for o in bodies]).reshape(count, 3)
    radius = np.array([h[0] if o.shape == "sphere" else 0.0 for h, o in zip(half, bodies, strict=True)])
    mass = np.array([o.mass for o in bodies])
    spins = [a.mean_spin for a in chosen]
    return ArcStack(
        grounded=grounded,
        steps=steps,
        index=index,
        clip=np.array([a.clip for a in chosen], str),
        object=np.array([a.object for a in chosen], int),
        time=time,
        start=np.array([a.time[0] for a in chosen]),
        duration=duration,
        position=position,
        weight=weight,
        mass=mass,
        radius=radius,
        inertia=0.4 * mass * np.where(radius > 0, radius, 1.0) ** 2,
        friction=np.array([o.sliding_friction for o in bodies]),
        rolling=np.array([o.rolling_friction for o in bodies]),
        gravity=np.array([s.gravity for s in scenes]).reshape(count, 3),
        spin=np.array([np.zeros(3) if s is None else s for s in spins]).reshape(count, 3),
        has_spin=np.array([s is not None for s in spins], bool),
        spin_rows=spin_rows,
        spin_weight=spin_weight,
        others=others,
        rotation=rotation,
        camera_error=stacked([a.camera_error for a in chosen]),
        tied=np.array([grounded and a.rolling and a.mean_spin is None for a in chosen], bool),
    )
