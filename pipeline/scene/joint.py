"""Joints of a scene: what they ask of its initial state, their velocities, and a joint after its bodies have moved."""

from __future__ import annotations

from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import SceneError, did_you_mean
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Joint, Scene, SceneObject

TOLERANCE = 2e-3  # of velocities, as a share: people write three digits
STRETCH = 0.05  # share of its length by which a rope is longer in the step in which it gets taut
#: Kinds whose body is a part of the body that it is joined to, with its own coordinates; a rope's body is free.
GUIDED = ("hinge", "slide", "ball", "rod")


class Motion(NamedTuple):
    """Position (3,) m, quaternion (4,), velocity (3,) m/s and angular velocity (3,) rad/s of a body, in the world."""

    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3), from the body frame to the world frame."""
        return matrix_from_quaternion(self.quaternion)

    def inside(self, point: Any) -> np.ndarray:
        """A point (3,) m of the world in the body frame."""
        return self.rotation.T @ (np.array(point) - self.position)

    def velocity_at(self, point: np.ndarray) -> np.ndarray:
        """(3,) m/s, of the body's material at a point (3,) m of the world."""
        return self.velocity + np.cross(self.spin, point - self.position)


WORLD = Motion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))


def motion_of(scene: Scene, name: str | None) -> Motion:
    """The initial motion of an object by its name; that of the world for None."""
    if name is None:
        return WORLD
    o = next(o for o in scene.objects if o.name == name)
    return Motion(np.array(o.position), np.array(o.orientation), np.array(o.velocity), np.array(o.angular_velocity))


def guided_parent(obj: SceneObject) -> str | None:
    """The object of which an object is a part in MuJoCo's tree of bodies; None for the world."""
    return obj.joint.to if obj.joint is not None and obj.joint.kind in GUIDED else None


def check_joints(scene: Scene) -> None:
    """Raise SceneError, which names the place, where an object's joint and its initial state do not agree."""
    names = [o.name for o in scene.objects]
    jointed = [(f"objects[{i}]", o, o.joint) for i, o in enumerate(scene.objects) if o.joint is not None]
    for place, o, joint in jointed:
        others = [n for n in names if n != o.name]
        if joint.to is not None and joint.to not in others:
            hint, valid = did_you_mean(joint.to, others), ", ".join(others) or "none, there is no other object"
            raise SceneError(f"{place}.joint.to: {joint.to!r} is no other object{hint}; valid: {valid}")
    try:
        TopologicalSorter({o.name: {joint.to} for _, o, joint in jointed if joint.to is not None}).prepare()
    except CycleError as error:
        raise SceneError(
            f"the joints of {', '.join(error.args[1][1:])} form a circle; valid: one ends at the world"
        ) from None
    for place, o, joint in jointed:
        if joint.kind in GUIDED:
            _check_velocity(scene, o, joint, place)
        elif span(o, joint) > rope_length(o, joint) * (1 + STRETCH):
            far = f"{span(o, joint):.4g}"
            raise SceneError(f"{place}.joint.length: the rope spans {far} m at first; valid: at least that")
        elif joint.spring is None and not rope_length(o, joint):
            raise SceneError(
                f"{place}.joint.length: the rope begins where it ends; valid: a length, or an anchor elsewhere"
            )


def end_point(obj: SceneObject, joint: Joint) -> np.ndarray:
    """(3,) m, where a rope or rod ends on its body, in the world."""
    return np.array(obj.position if joint.end is None else joint.end)


def span(obj: SceneObject, joint: Joint) -> float:
    """The distance of a rope's ends in the initial state, m."""
    return float(np.linalg.norm(end_point(obj, joint) - joint.anchor))


def rope_length(obj: SceneObject, joint: Joint) -> float:
    """The length of a rope, m: the stated one, else that of the initial state."""
    return span(obj, joint) if joint.length is None else joint.length


def unit_axis(joint: Joint) -> np.ndarray:
    """(3,) the direction of a hinge or slide."""
    axis = np.array(joint.axis)
    return axis / np.linalg.norm(axis)


def joint_velocity(scene: Scene, obj: SceneObject) -> np.ndarray:
    """The initial velocity of an object's coordinates: (1,) of a hinge or slide, (3,) in its own frame of a ball or
    rod, (6,) of a free body or one on a rope, as MuJoCo has them."""
    own = motion_of(scene, obj.name)
    joint = obj.joint
    if joint is None or joint.kind not in GUIDED:
        return np.concatenate([own.velocity, own.rotation.T @ own.spin])
    held = motion_of(scene, joint.to)
    if joint.kind == "slide":
        return np.array([unit_axis(joint) @ (own.velocity - held.velocity_at(own.position))])
    if joint.kind == "hinge":
        return np.array([unit_axis(joint) @ (own.spin - held.spin)])
    return own.rotation.T @ (own.spin - held.spin)


#: What the velocities of guided bodies are, relative to what they are joined to.
_LAWS = {("slide", "velocity"): "along the axis", ("slide", "angular_velocity"): "that of what holds it"}
_LAWS |= {(kind, "velocity"): "angular_velocity × (position - anchor)" for kind in ("hinge", "ball", "rod")}
_LAWS["hinge", "angular_velocity"] = "along the axis"


def _check_velocity(scene: Scene, obj: SceneObject, joint: Joint, place: str) -> None:
    """Raise SceneError where the velocities of a guided object are not those that its joint allows."""
    own, held = motion_of(scene, obj.name), motion_of(scene, joint.to)
    speed = joint_velocity(scene, obj)
    if joint.kind == "slide":
        spin, velocity = held.spin, held.velocity_at(own.position) + speed * unit_axis(joint)
    else:
        spin = held.spin + (speed * unit_axis(joint) if joint.kind == "hinge" else own.rotation @ speed)
        anchor = np.array(joint.anchor)
        velocity = held.velocity_at(anchor) + np.cross(spin, own.position - anchor)
    for key, needed in (("angular_velocity", spin), ("velocity", velocity)):
        stated = np.array(getattr(obj, key))
        if np.linalg.norm(stated - needed) > TOLERANCE * (np.linalg.norm(stated) + np.linalg.norm(needed)):
            shown = ", ".join(f"{v:.4g}" for v in needed + 0.0)
            raise SceneError(f"{place}.{key}: of a {joint.kind} it is {_LAWS[joint.kind, key]}; valid here: [{shown}]")


def joints_after(before: Scene, after: Scene) -> Scene:
    """A later state of a scene as an initial one: its joints are described as they are then.

    Args:
        before: The scene.
        after: The same with the poses and velocities of a later state, and the joints as they were at first.
    """
    return replace(
        after,
        objects=tuple(
            replace(o, joint=_joint_after(first, before, after))
            for first, o in zip(before.objects, after.objects, strict=True)
        ),
    )


def _joint_after(obj: SceneObject, before: Scene, after: Scene) -> Joint | None:
    joint = obj.joint
    if joint is None:
        return None
    own, held = ((motion_of(before, name), motion_of(after, name)) for name in (obj.name, joint.to))
    moved = replace(joint, anchor=_carried(joint.anchor, *held))
    turn = held[1].rotation @ held[0].rotation.T
    if joint.axis is not None:
        moved = replace(moved, axis=tuple(turn @ joint.axis))
    if joint.end is not None:
        moved = replace(moved, end=_carried(joint.end, *own))
    if joint.kind == "rope" and joint.spring is None:
        moved = replace(moved, length=rope_length(obj, joint))
    if joint.kind == "hinge" and joint.spring is not None:
        angle = unit_axis(joint) @ Rotation.from_matrix(turn.T @ own[1].rotation @ own[0].rotation.T).as_rotvec()
        moved = replace(moved, spring=replace(joint.spring, rest=joint.spring.rest - float(angle)))
    return moved


def _carried(point: tuple[float, ...], old: Motion, new: Motion) -> tuple[float, ...]:
    """Where a point (3,) m of a body has gone."""
    return tuple(new.position + new.rotation @ old.inside(point))
