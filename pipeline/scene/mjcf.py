"""Scenes as MJCF documents, built with `dm_control.mjcf`. MuJoCo runs them without this package.

A document has one body per object, named as the object, with a free joint or that of the scene; the camera `camera`;
the ground plane `ground`; the fixed bodies as geoms of the world body, in geom group 1; and a keyframe `initial` with
the positions and velocities of the scene. Contacts follow docs/formats.md: objects have priority over ground and fixed
bodies, so their own friction and damping apply on them. A fixed body with contact numbers of its own has a contact pair
for each object.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # dm_control warns where there is no display; none is needed here
    from dm_control import mjcf

from pipeline.errors import SceneError
from pipeline.scene.joint import GUIDED, guided_parent, joint_velocity, motion_of
from pipeline.scene.mjcf_effects import add_effects
from pipeline.scene.mjcf_joints import add_joint, add_ropes
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import Camera, FixedBody, Scene, SceneObject, half_extents
from pipeline.scene.solid import geom_sizes, principal_moments
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.untrusted import MOST_MESH_BYTES, open_untrusted

#: Time constant of contacts, s; the damping ratio is each object's own (MuJoCo manual, "Solver parameters").
CONTACT_TIME_CONSTANT = 0.02
#: Smallest product of time constant and damping ratio, s. A contact oscillates with 1 / (0.9 of this product) rad/s.
#: With fewer than 7 steps of 1/240 s per period, bodies bounce higher than they fell (5 times at a damping of 0.1).
LEAST_SPRING_TIME = 0.0055
TORSIONAL_FRICTION = 0.005  # m, MuJoCo's default
OBJECT_PRIORITY = 1
#: Geom group of the fixed bodies, by which a model tells them from the ground and from what effects add.
FIXED_GROUP = 1
#: Initial tilt of cylinders, rad. Where a cylinder's axis is normal to a plane to within rounding, MuJoCo's
#: mjc_PlaneCylinder normalises a vector of rounding errors and reports a penetration as deep as the radius.
CYLINDER_TILT = 1e-7
#: Custom tuple of the objects' bodies in the order of the scene, where that of MuJoCo's tree differs.
OBJECT_ORDER = "objects"


def friction(obj: SceneObject) -> np.ndarray:
    """(sliding, torsional, rolling) friction coefficients."""
    return np.array([obj.sliding_friction, TORSIONAL_FRICTION, obj.rolling_friction])


def solref(damping: np.ndarray) -> np.ndarray:
    """Time constant, s, and damping ratio (..., 2) of the contacts of objects with the given damping (...)."""
    damping = np.asarray(damping, float)
    return np.stack([np.maximum(CONTACT_TIME_CONSTANT, LEAST_SPRING_TIME / damping), damping], -1)


def start_quaternion(shape: str, orientation: np.ndarray) -> np.ndarray:
    """Initial unit quaternions (..., 4) of bodies of one shape, from orientations (..., 4); cylinders are tilted."""
    if shape == "cylinder":
        orientation = quaternion_multiply(orientation, np.array([1.0, CYLINDER_TILT / 2, 0.0, 0.0]))
    return orientation / np.linalg.norm(orientation, axis=-1, keepdims=True)


def initial_qpos(objects: Sequence[SceneObject]) -> np.ndarray:
    """Coordinates of the objects: position, m, and unit quaternion of those that are free; zero of a joint, which is
    measured from the initial state."""
    rows: list[np.ndarray] = [np.zeros(0)]
    for o in objects:
        if o.joint is None or o.joint.kind not in GUIDED:
            rows.append(np.concatenate([o.position, start_quaternion(o.shape, np.array(o.orientation))]))
        else:
            rows.append(np.zeros(1) if o.joint.axis else np.array([1.0, 0.0, 0.0, 0.0]))
    return np.concatenate(rows)


def camera_quaternion(camera: Camera) -> np.ndarray:
    """Unit quaternion (4,) of the camera frame (x right, y up, looking along -z)."""
    if camera.orientation is not None:
        return np.array(camera.orientation)
    assert camera.pitch is not None
    half = np.radians(90 + camera.pitch) / 2  # a rotation about x; at a pitch of -90° the camera looks straight down
    return np.array([np.cos(half), np.sin(half), 0.0, 0.0])


def scene_mjcf(scene: Scene) -> mjcf.RootElement:
    """The scene as a `dm_control.mjcf` document. Raises `SceneError` for a mesh file that cannot be read."""
    root = mjcf.RootElement(model="scene")
    root.option.timestep = 1 / STEPS_PER_SECOND
    root.option.gravity = scene.gravity
    root.option.cone = "elliptic"
    if scene.ground is not None:
        root.worldbody.add("geom", name="ground", type="plane", size=[0, 0, 1], pos=[0, 0, scene.ground], condim=6)
    for fixed in scene.fixed:
        root.worldbody.add(
            "geom",
            name=fixed.name,
            pos=fixed.position,
            quat=fixed.orientation,
            condim=6,
            group=FIXED_GROUP,
            **_geom_shape(root, fixed),
        )
    if scene.camera is not None:
        c = scene.camera
        root.worldbody.add("camera", name="camera", pos=c.position, quat=camera_quaternion(c), fovy=c.fov)
    added = _add_objects(root, scene, root.worldbody, None)
    add_ropes(root, scene)
    if [o.name for o in added] != [o.name for o in scene.objects]:
        order = root.custom.add("tuple", name=OBJECT_ORDER)
        for obj in scene.objects:
            order.add("element", objtype="body", objname=obj.name, prm=0)
    velocities = [joint_velocity(scene, o) for o in added]
    root.keyframe.add("key", name="initial", qpos=initial_qpos(added), qvel=np.concatenate([np.zeros(0), *velocities]))
    add_effects(root, scene)
    for obj in scene.objects:
        body = root.find("body", obj.name)
        if obj.hollow and body.inertial is None:
            body.add("inertial", pos=[0, 0, 0], mass=obj.mass, diaginertia=principal_moments(obj))
    _add_pairs(root, scene)
    return root


def _add_objects(root: Any, scene: Scene, holder: Any, name: str | None) -> list[SceneObject]:
    """Add the objects that are parts of a body, and theirs, in the order of MuJoCo's bodies, which is returned.

    holder: The body's element; name: of its object, None for the world.
    """
    added = []
    held = motion_of(scene, name)
    for obj in scene.objects:
        if guided_parent(obj) != name:
            continue
        turn = np.array(obj.orientation)
        if name is not None:
            turn = quaternion_multiply(quaternion_conjugate(held.quaternion), turn)
        body = holder.add("body", name=obj.name, pos=held.inside(obj.position), quat=turn)
        add_joint(body, obj, motion_of(scene, obj.name))
        body.add(
            "geom",
            name=obj.name,
            mass=obj.mass,
            friction=friction(obj),
            solref=solref(np.array(obj.damping)),
            condim=6,
            priority=OBJECT_PRIORITY,
            **_geom_shape(root, obj),
        )
        added += [obj, *_add_objects(root, scene, body, obj.name)]
    return added


def _geom_shape(root: mjcf.RootElement, body: SceneObject | FixedBody) -> dict[str, Any]:
    """Attributes of a geom with the shape of a body; a mesh is added to the document's assets."""
    if body.shape != "mesh":
        return {"type": body.shape, "size": geom_sizes(body.shape, half_extents(body)[None])[0]}
    assert body.file is not None
    root.asset.add("mesh", name=body.name, vertex=(mesh_vertices(body.file) * body.size[0]).ravel())
    return {"type": "mesh", "mesh": body.name}


def _add_pairs(root: mjcf.RootElement, scene: Scene) -> None:
    """Add a contact pair for each object and fixed body with contact numbers of its own.

    A pair has the numbers of the object's geom, as effects have left them, but for those that the fixed body has.
    """
    for f, fixed in enumerate(scene.fixed):
        if not fixed.has_contact_numbers:
            continue
        for i, obj in enumerate(scene.objects):
            geom = root.find("body", obj.name).geom[0]
            slide, spin, roll = geom.friction
            slide = slide if fixed.sliding_friction is None else fixed.sliding_friction
            roll = roll if fixed.rolling_friction is None else fixed.rolling_friction
            root.contact.add(
                "pair",
                name=pair_name(f, i),
                geom1=fixed.name,
                geom2=geom,
                condim=6,
                friction=[slide, slide, spin, roll, roll],
                solref=geom.solref if fixed.damping is None else solref(np.array(fixed.damping)),
            )


def pair_name(fixed: int, index: int) -> str:
    """Name of the contact pair of a fixed body and an object, from their indices."""
    return f"pair_{fixed}_{index}"


def scene_xml(scene: Scene) -> str:
    """The scene as MJCF text. MuJoCo loads it without this package."""
    return scene_mjcf(scene).to_xml_string(precision=17)


@functools.cache
def mesh_vertices(file: str) -> np.ndarray:
    """Vertices (V, 3) of a mesh file (STL, OBJ, MSH), with the centre of their bounding box at the origin.

    Raises SceneError where the file is missing or cannot be read.
    """
    try:
        with open_untrusted(Path(file), SceneError, MOST_MESH_BYTES):
            pass
    except SceneError as error:
        raise SceneError(f"mesh file {error}") from None
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(Path(file).resolve()))
    try:
        model = spec.compile()
    except ValueError as error:
        raise SceneError(f"mesh file {file}: MuJoCo cannot read it: {error}") from None
    rotation = matrix_from_quaternion(model.mesh_quat[0])
    vertices = model.mesh_vert @ rotation.T + model.mesh_pos[0]
    return vertices - (vertices.max(0) + vertices.min(0)) / 2
