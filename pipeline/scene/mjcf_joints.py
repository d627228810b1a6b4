"""Joints in an MJCF document: MuJoCo's own joints, and tendons for ropes."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.scene.joint import GUIDED, Motion, end_point, motion_of, rope_length, unit_axis
from pipeline.scene.scene import Scene, SceneObject
from pipeline.scene.time_step import STEPS_PER_SECOND

#: Time constant, s, and damping ratio of a taut rope's limit: MuJoCo's stiffest. A rope that gets taut takes the speed
#: along it but for a tenth; one that swings from level loses 1 % of its energy in 10 s.
ROPE_SOLREF = (2 / STEPS_PER_SECOND, 1.0)
HARDEST = (0.9999, 0.9999, 0.001)  # of MuJoCo's constraints; by default what friction holds creeps by 5 mm/s


def add_joint(body: Any, obj: SceneObject, own: Motion) -> None:
    """Add an object's joint, or a free one, to the element of its body. own: its initial motion."""
    joint = obj.joint
    if joint is None or joint.kind not in GUIDED:
        body.add("freejoint", name=obj.name)
        return
    values: dict[str, Any] = {"type": "ball"}
    if joint.axis is not None:
        values = {"type": joint.kind, "axis": own.rotation.T @ unit_axis(joint)}
    if joint.spring is not None:
        rest = joint.spring.rest
        if joint.kind == "slide":
            rest -= float(unit_axis(joint) @ np.subtract(obj.position, joint.anchor))
        else:
            rest = float(np.degrees(rest))  # as MJCF has angles
        values |= {"stiffness": joint.spring.stiffness, "springref": rest}
    body.add(
        "joint",
        name=obj.name,
        pos=own.inside(joint.anchor),
        damping=joint.damping,
        frictionloss=joint.friction,
        solimpfriction=HARDEST,
        **values,
    )


def add_ropes(root: Any, scene: Scene) -> None:
    """Add a tendon for each rope: one that pulls at its length, or an elastic one that pulls beyond its rest."""
    for obj in scene.objects:
        joint = obj.joint
        if joint is None or joint.kind in GUIDED:
            continue
        holder = root.worldbody if joint.to is None else root.find("body", joint.to)
        body, own = root.find("body", obj.name), motion_of(scene, obj.name)
        sites = [
            holder.add("site", name=f"{obj.name}_anchor", pos=motion_of(scene, joint.to).inside(joint.anchor)),
            body.add("site", name=f"{obj.name}_end", pos=own.inside(end_point(obj, joint))),
        ]
        values: dict[str, Any] = {"range": [0, rope_length(obj, joint)], "limited": True}
        if joint.spring is not None:
            values = {"stiffness": joint.spring.stiffness, "springlength": [0, joint.spring.rest]}
        tendon = root.tendon.add(
            "spatial",
            name=obj.name,
            damping=joint.damping,
            frictionloss=joint.friction,
            solreflimit=ROPE_SOLREF,
            solimplimit=HARDEST,
            solimpfriction=HARDEST,
            **values,
        )
        for site in sites:
            tendon.add("site", site=site)
