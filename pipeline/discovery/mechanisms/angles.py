"""The unit of angles in an MJCF document, which may be degrees."""

from __future__ import annotations

import mujoco
import numpy as np


def angle_unit(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> float:
    """What a position of the joint, rad or m, is multiplied by where it is written into the document."""
    slide = int(joint.type) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    return float(np.degrees(1.0)) if spec.compiler.degree and not slide else 1.0
