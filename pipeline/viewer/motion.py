"""A motion in the viewer: bodies and contact forces in the 3D view, plots of speed and height, and events."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
from scipy.spatial import ConvexHull

from pipeline.physics.trace import FIRST_FIXED, GROUND, Trace
from pipeline.scene.mjcf import mesh_vertices
from pipeline.scene.scene import FixedBody, SceneObject, half_extents
from pipeline.viewer.footage import MotionLayer, event_text
from pipeline.viewer.timeline import at_times, send_steps
from pipeline.vision.rendering.appearance import object_colour

ARROW_LENGTH = 0.01  # m per m/s² of acceleration by the force: the support of a ball at rest is about 10 cm long
LONGEST_ARROW = 0.5  # m
WIRE_RADIUS = 0.002  # m
FIXED_COLOUR = (178, 172, 165)
PLANE_HALF_WIDTH = 2.0  # m that is shown of a fixed plane about its position
#: Title of each plot.
PLOTS = {"speed": "speed, m/s", "height": "height above the ground, m"}


def body_path(motion: MotionLayer, index: int) -> str:
    return f"world/{motion.name}/{motion.scene.objects[index].name}"


def log_bodies(recording: rr.RecordingStream, motion: MotionLayer, clock: np.ndarray) -> None:
    """Log shapes (static), poses at every step, and contacts, under world/<motion>."""
    trace = motion.trace
    for i, obj in enumerate(motion.scene.objects):
        path = body_path(motion, i)
        recording.log(path, shape(obj, object_colour(i), motion.solid), static=True, strict=True)
        position, xyzw = trace.position[:, i], trace.quaternion[:, i][:, [1, 2, 3, 0]]

        def poses(rows: np.ndarray, position: np.ndarray = position, xyzw: np.ndarray = xyzw) -> rr.ComponentColumnList:
            return rr.Transform3D.columns(translation=position[rows], quaternion=xyzw[rows])

        send_steps(recording, path, trace.times, clock, poses)
        if motion.solid:
            path_of_centre = rr.LineStrips3D([position], colors=[(*object_colour(i), 110)], radii=WIRE_RADIUS)
            recording.log(f"world/{motion.name}/paths/{obj.name}", path_of_centre, static=True, strict=True)
    for body in motion.scene.fixed:
        log_fixed(recording, f"world/{motion.name}/{body.name}", body, motion.solid)
    if len(trace.contacts):
        log_contacts(recording, motion, clock)


def log_fixed(recording: rr.RecordingStream, path: str, body: FixedBody, solid: bool) -> None:
    """Log a body that does not move, at a path."""
    w, x, y, z = body.orientation
    recording.log(path, shape(body, FIXED_COLOUR, solid), static=True, strict=True)
    pose = rr.Transform3D(translation=body.position, quaternion=rr.Quaternion(xyzw=(x, y, z, w)))
    recording.log(path, pose, static=True, strict=True)


def shape(obj: SceneObject | FixedBody, rgb: tuple[int, int, int], solid: bool) -> rr.AsComponents:
    """The shape of a body about its centre, as a primitive of rerun where there is one."""
    if obj.shape == "mesh":
        assert obj.file is not None
        vertices = mesh_vertices(obj.file) * obj.size[0]
        triangles = ConvexHull(vertices).simplices  # the shape that MuJoCo uses for collisions
        return rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=[*rgb, 255])
    half = half_extents(obj)
    fill = rr.components.FillMode.Solid if solid else rr.components.FillMode.MajorWireframe
    style: dict[str, Any] = {"colors": [rgb], "fill_mode": fill, "labels": [obj.name], "show_labels": False}
    if obj.shape == "plane":
        return rr.Boxes3D(half_sizes=[[PLANE_HALF_WIDTH, PLANE_HALF_WIDTH, WIRE_RADIUS]], **style)
    if obj.shape == "box":
        return rr.Boxes3D(half_sizes=[half], **style)
    if obj.shape in ("sphere", "ellipsoid"):
        return rr.Ellipsoids3D(half_sizes=[half], **style)
    if obj.shape == "cylinder":
        return rr.Cylinders3D(lengths=[2 * half[2]], radii=[half[0]], **style)
    straight = 2 * (half[2] - half[0])
    return rr.Capsules3D(lengths=[straight], radii=[half[0]], translations=[[0, 0, -straight / 2]], **style)


def log_contacts(recording: rr.RecordingStream, motion: MotionLayer, clock: np.ndarray) -> None:
    """Log an arrow per contact point and step: the force on the first body, ending at the point."""
    trace = motion.trace
    c = trace.contacts
    origins, vectors, counts = contact_arrows(trace, np.array([o.mass for o in motion.scene.objects]))
    starts = np.concatenate([[0], np.cumsum(counts)])
    colours = np.array([object_colour(int(i)) for i in c.first], np.uint8).reshape(-1, 3)
    force = np.linalg.norm(c.force, axis=1)
    names = {i: o.name for i, o in enumerate(motion.scene.objects)} | {GROUND: "the ground"}
    names |= {FIRST_FIXED - k: b.name for k, b in enumerate(motion.scene.fixed)}
    labels = [f"{names[a]} on {names[b]}: {f:.2g} N" for a, b, f in zip(c.first, c.second, force, strict=True)]

    def arrows(rows: np.ndarray) -> rr.ComponentColumnList:
        points = np.concatenate([np.arange(starts[r], starts[r + 1]) for r in rows]).astype(int)
        columns = rr.Arrows3D.columns(
            vectors=vectors[points], origins=origins[points], colors=colours[points], labels=[labels[p] for p in points]
        )
        return columns.partition(counts[rows])

    path = f"world/{motion.name}/contacts"
    style = rr.Arrows3D.from_fields(radii=0.006, show_labels=False)
    recording.log(path, style, static=True, strict=True)
    send_steps(recording, path, trace.times, clock, arrows)


def contact_arrows(trace: Trace, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins and vectors (C, 3), m, of the arrows of all contacts, and the number of contacts at each step (S + 1,).

    mass: (N,) kg.
    """
    c = trace.contacts
    vectors = ARROW_LENGTH * c.force / mass[c.first][:, None]
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors = vectors * np.minimum(1, LONGEST_ARROW / np.maximum(length, 1e-12))
    return c.position - vectors, vectors, np.bincount(c.step, minlength=len(trace.position))


def log_plots(recording: rr.RecordingStream, motion: MotionLayer, clock: np.ndarray) -> None:
    """Log scalars under plots/speed/<motion>/<object> and plots/height/<motion>/<object>."""
    trace = motion.trace
    values = {
        "speed": np.linalg.norm(trace.velocity, axis=-1),
        "height": trace.position[..., 2] - (motion.scene.ground or 0.0),
    }
    for plot, table in values.items():
        for i, obj in enumerate(motion.scene.objects):
            path = f"plots/{plot}/{motion.name}/{obj.name}"
            style = rr.SeriesLines(
                colors=[object_colour(i)], names=[f"{obj.name} ({motion.name})"], widths=[2.0 if motion.solid else 1.0]
            )
            recording.log(path, style, static=True, strict=True)

            def scalars(rows: np.ndarray, series: np.ndarray = table[:, i]) -> rr.ComponentColumnList:
                return rr.Scalars.columns(scalars=series[rows])

            send_steps(recording, path, trace.times, clock, scalars)


def log_events(recording: rr.RecordingStream, motion: MotionLayer, clock: np.ndarray, named: bool) -> None:
    """Log a line of text for each event under events/<motion>. named: begin it with the name of the motion."""
    if not motion.events:
        return
    columns = rr.TextLog.columns(
        text=[f"{motion.name}: " * named + event_text(e, motion.scene) for e in motion.events],
        level=["INFO"] * len(motion.events),
        color=[object_colour(e.first) for e in motion.events],
    )
    times = at_times(np.array([e.time for e in motion.events]), clock)
    recording.send_columns(f"events/{motion.name}", times, columns, strict=True)
