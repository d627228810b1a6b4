"""Plain MuJoCo has the effects, too: augmented.xml, with augmented_forces.py where MJCF cannot say one."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.api.discover import discover
from pipeline.discovery.report.forces_file import forces_file
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.region import Region
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Effect, Scene, SceneObject

SECONDS = 0.6
BALL = SceneObject(
    "sphere", (0.1,), 0.5, position=(0, 0, 3), velocity=(2, 0.5, 1), angular_velocity=(3, -20, 5), name="ball"
)
DIE = SceneObject(
    "box", (0.1, 0.1, 0.1), 0.2, position=(1, 1, 3), velocity=(-1, 0, 2), angular_velocity=(0, 9, 1), name="die"
)
PUCK = SceneObject("cylinder", (0.1, 0.04), 0.5, 0.3, position=(0, 0, 0.02), velocity=(1.5, 0.5, 0), name="puck")
ROLLING = SceneObject(
    "sphere", (0.1,), 0.5, position=(0, 1, 0.1), velocity=(1, 0, 0), angular_velocity=(0, 10, 4), name="rolling"
)
DROPPED = replace(BALL, position=(0, 0, 0.3), velocity=(1, 0, 0), damping=0.3)
AIR, GROUND = Scene((BALL, DIE)), Scene((PUCK, ROLLING))
HERE = Region(after=0.1, centre=(0.3, 0.2, 0.0), radius=0.6)
THERE = Region(normal=(1.0, 0.0, 0.0), offset=0.4)


def effect(name: str, only: Region | None = None, objects: tuple[str, ...] | None = None, **values: object) -> Effect:
    return Effect(name, tuple(values.items()), objects, only)


#: Scenes by the law that they have; a name after a blank tells variants apart.
LAWS = {
    "air_drag": (AIR, effect("air_drag", coefficient=0.02)),
    "linear_drag": (AIR, effect("linear_drag", coefficient=0.1)),
    "wind": (AIR, effect("wind", velocity=(1.0, 2.0, 0.0), coefficient=0.02)),
    "magnus_lift": (AIR, effect("magnus_lift", coefficient=0.002)),
    "buoyancy": (AIR, effect("buoyancy", fraction=0.2)),
    "gravity_error": (AIR, effect("gravity_error", gravity=8.0)),
    "tilted_gravity": (AIR, effect("tilted_gravity", tilt=(0.1, 0.05))),
    "off_center_mass": (AIR, effect("off_center_mass", offset=(0.01, 0.0, 0.02), objects=("die",))),
    "hidden_obstacle": (AIR, effect("hidden_obstacle", position=(0.6, 0.2, 3.2), size=0.2)),
    "hidden_attractor": (AIR, effect("hidden_attractor", position=(1.0, 1.0, 1.0), strength=0.3)),
    "pair_attraction": (AIR, effect("pair_attraction", strength=0.05)),
    "rotating_frame": (AIR, effect("rotating_frame", angular_velocity=0.4)),
    "impulse": (AIR, effect("impulse", time=0.2011, momentum=(0.1, 0.0, 0.2), objects=("ball",))),
    "rolling_resistance": (GROUND, effect("rolling_resistance", coefficient=0.003)),
    "spin_friction": (GROUND, effect("spin_friction", coefficient=0.01)),
    "viscous_friction": (GROUND, effect("viscous_friction", coefficient=0.3)),
    "anisotropic_friction": (GROUND, effect("anisotropic_friction", ratio=0.5, angle=0.4)),
    "friction_error": (GROUND, effect("friction_error", coefficient=0.1)),
    "moving_ground": (GROUND, effect("moving_ground", velocity=(0.3, 0.1))),
    "adhesion": (GROUND, effect("adhesion", force=2.0)),
    "restitution": (Scene((DROPPED,)), effect("restitution", coefficient=0.8)),
    "air_drag of one body": (AIR, effect("air_drag", coefficient=0.02, objects=("die",))),
    "air_drag in a part": (AIR, effect("air_drag", THERE, coefficient=0.05)),
    "gravity_error in a part": (AIR, effect("gravity_error", THERE, gravity=8.0)),
    "hidden_attractor in a part": (AIR, effect("hidden_attractor", THERE, position=(1.0, 1.0, 1.0), strength=0.3)),
    "friction_error in a part": (GROUND, effect("friction_error", HERE, coefficient=0.6)),
    "anisotropic_friction in a part": (GROUND, effect("anisotropic_friction", HERE, ratio=0.5, angle=0.4)),
    "moving_ground in a part": (GROUND, effect("moving_ground", HERE, velocity=(0.0, 0.6))),
    "viscous_friction in a part": (GROUND, effect("viscous_friction", HERE, coefficient=0.6)),
    "adhesion in a part": (GROUND, effect("adhesion", HERE, force=4.0)),
}
TOGETHER = {
    "drag, lift and wind": (
        effect("air_drag", coefficient=0.01),
        effect("linear_drag", coefficient=0.05),
        effect("magnus_lift", coefficient=0.002),
        effect("wind", velocity=(1.0, 2.0, 0.0), coefficient=0.02),
    ),
    "an attractor in a wind": (
        effect("wind", velocity=(1.0, 2.0, 0.0), coefficient=0.02),
        effect("hidden_attractor", position=(1.0, 1.0, 1.0), strength=0.3),
    ),
    "a linear drag that only some of the bodies with quadratic drag have": (
        effect("air_drag", coefficient=0.02),
        effect("linear_drag", coefficient=0.1, objects=("die",)),
        effect("wind", velocity=(1.0, 0.0, 0.0), coefficient=0.01),
    ),
}
#: In MuJoCo's own elements, to which no force has to be added.
ELEMENTS = (
    "adhesion",
    "air_drag",
    "buoyancy",
    "friction_error",
    "gravity_error",
    "hidden_obstacle",
    "linear_drag",
    "magnus_lift",
    "moving_ground",
    "off_center_mass",
    "restitution",
    "rolling_resistance",
    "spin_friction",
    "tilted_gravity",
    "wind",
)

PLAIN = """
import importlib.util, sys
from pathlib import Path
import mujoco, numpy as np
sys.modules["pipeline"] = None  # importing it is an error
for folder in sorted(Path(sys.argv[1]).iterdir()):
    mujoco.set_mjcb_passive(None)
    model = mujoco.MjModel.from_xml_path(str(folder / "augmented.xml"))
    data, path = mujoco.MjData(model), []
    mujoco.mj_resetDataKeyframe(model, data, 0)
    if (folder / "augmented_forces.py").exists():
        spec = importlib.util.spec_from_file_location("forces", folder / "augmented_forces.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        mujoco.set_mjcb_passive(module.forces)
    for _ in range(int(sys.argv[2])):
        mujoco.mj_step(model, data)
        path.append(data.qpos.copy())
    np.save(folder / "path.npy", path)
"""


def scenes() -> dict[str, tuple[Scene, Scene]]:
    """By name the scene without and with effects."""
    single = {name: (scene, replace(scene, effects=(law,))) for name, (scene, law) in LAWS.items()}
    return single | {name: (AIR, replace(AIR, effects=laws)) for name, laws in TOGETHER.items()}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """By name the motion (T, N, 7) in plain MuJoCo, in one process for all."""
    top = tmp_path_factory.mktemp("plain")
    for number, (_, scene) in enumerate(scenes().values()):
        folder = top / f"{number:03d}"
        folder.mkdir()
        (folder / "augmented.xml").write_text(scene_xml(scene))
        forces = forces_file(scene)
        if forces is not None:
            (folder / "augmented_forces.py").write_text(forces)
    subprocess.run([sys.executable, "-I", "-c", PLAIN, str(top), str(round(SECONDS * 240))], check=True)
    paths = (np.load(top / f"{i:03d}" / "path.npy") for i in range(len(scenes())))
    return {name: path.reshape(len(path), -1, 7) for name, path in zip(scenes(), paths, strict=True)}


def test_there_is_an_example_of_every_law_of_motion() -> None:
    assert {name for name in LAWS if " " not in name} == {k.name for k in effect_kinds().values() if not k.recording}


@pytest.mark.parametrize("name", scenes())
def test_plain_mujoco_moves_as_our_simulation_does(name: str, plain: dict[str, np.ndarray]) -> None:
    before, after = scenes()[name]
    without, ours = simulate(before, SECONDS), simulate(after, SECONDS)
    shown = np.concatenate([ours.position, ours.quaternion], -1)[1:]
    by_effect = np.abs(shown - np.concatenate([without.position, without.quaternion], -1)[1:]).max()
    assert by_effect > 0.01
    np.testing.assert_allclose(plain[name], shown, atol=0.002 * by_effect)


@pytest.mark.parametrize("name", [name for name in LAWS if " " not in name])
def test_a_file_of_forces_is_written_only_where_mjcf_cannot_say_the_law(name: str) -> None:
    assert (forces_file(scenes()[name][1]) is None) == (name in ELEMENTS)


@pytest.mark.parametrize("name", scenes())
def test_a_file_of_forces_is_short_and_imports_mujoco_and_numpy_alone(name: str) -> None:
    text = forces_file(scenes()[name][1]) or ""
    assert len(text.splitlines()) <= 100
    imported = {line.split()[1] for line in text.splitlines() if line.startswith(("import ", "from "))}
    assert imported <= {"mujoco", "numpy", "pathlib", "sys", "types"}


REPLAY = """
import csv, json, sys
import mujoco, numpy as np
sys.modules["pipeline"] = None
folder, table = sys.argv[1:]
model = mujoco.MjModel.from_xml_path(folder + "/augmented.xml")
report = json.load(open(folder + "/report.json"))
rows = [r for r in csv.DictReader(open(table))]

def path(start, times):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[:3], data.qvel[:3] = start[:3], start[3:]
    out, now = [start[:3]], [0.0]
    while now[-1] < times[-1]:
        mujoco.mj_step(model, data)
        out.append(data.qpos[:3].copy())
        now.append(data.time)
    return np.array([np.interp(times, now, column) for column in np.array(out).T]).T

def measured(clip):
    found = np.array([[float(r[k]) for k in ("time", "x", "y", "z")] for r in rows if r["clip"] == clip])
    return found[:, 0] - found[0, 0], found[:, 1:]

squares, count = 0.0, 0
for clip in report["gap"]["clips"]:
    times, shown = measured(clip)
    start = np.array([*shown[0], *((shown[5] - shown[0]) / times[5])])
    for _ in range(4):
        left = (path(start, times) - shown).ravel()
        slopes = np.array([(path(start + 1e-4 * e, times) - shown).ravel() - left for e in np.eye(6)]).T / 1e-4
        start = start - np.linalg.lstsq(slopes, left, rcond=None)[0]
    squares, count = squares + ((path(start, times) - shown) ** 2).sum(), count + shown.size - 6
times, shown = measured(rows[0]["clip"])
key = np.array([*model.key_qpos[0][:3], *model.key_qvel[0][:3]])
first = np.sqrt(((path(key, times) - shown) ** 2).mean())
print(json.dumps({"held_out": np.sqrt(squares / count), "from_keyframe": first}))
"""


def test_plain_mujoco_flies_as_the_ball_of_the_readme_was_measured_to(tmp_path: Path) -> None:
    table = Path("data/measured/thrown_ball.csv").resolve()
    found = discover(table, table.with_suffix(".yaml"), effects="air_drag,linear_drag")
    found.save(tmp_path / "found")
    command = [sys.executable, "-I", "-c", REPLAY, str(tmp_path / "found"), str(table)]
    gap = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert gap["held_out"] == pytest.approx(found.report["gap"]["after"], rel=0.05)
    assert gap["from_keyframe"] < 2 * found.report["gap"]["noise_floor"]


def test_the_file_of_forces_replays_a_recording_and_prints_its_gap(tmp_path: Path) -> None:
    law = effect("hidden_attractor", position=(1.0, 0.5, 3.5), strength=0.5)
    noise = np.random.default_rng(0).normal(size=(2, 36, 3)) * 0.002
    rows = ["clip,object,time,x,y,z"]
    for clip, speed in enumerate((1.0, 3.0)):
        scene = Scene((replace(BALL, velocity=(speed, 1.0, 2.0)),), effects=(law,))
        path = simulate(scene, SECONDS).position[::4, 0][:36] + noise[clip]
        rows += [f"clip_{clip},ball,{k / 60},{','.join(map(str, place))}" for k, place in enumerate(path)]
    (tmp_path / "measured.csv").write_text("\n".join(rows))
    (tmp_path / "augmented.xml").write_text(scene_xml(scene))
    (tmp_path / "augmented_forces.py").write_text(forces_file(scene) or "")

    def run(*arguments: str) -> list[str]:
        command = [sys.executable, "-I", str(tmp_path / "augmented_forces.py"), *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True, cwd=tmp_path).stdout.splitlines()

    said = [re.fullmatch(r"(clip_\d): gap (\S+) mm (with|without) the forces", line) for line in run("measured.csv")]
    gaps = {(m[1], m[3]): float(m[2]) for m in said if m}
    assert len(gaps) == 4
    for clip in ("clip_0", "clip_1"):
        assert gaps[clip, "with"] == pytest.approx(2.0, abs=0.6)  # four standard errors of 102 degrees of freedom
        assert gaps[clip, "without"] > 10
    assert [line.split(":")[0] for line in run()] == ["after 1 s without the forces", "after 1 s with the forces"]
