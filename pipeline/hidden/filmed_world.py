"""A hidden world that is filmed: clips of one camera, what is known of the scene, and, apart from them, the truth.

Balls roll and pucks slide on the ground, filmed obliquely from above; balls that bounce are filmed from the side and
move across the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.discovery.tracks.track import Track
from pipeline.hidden.engine import run_mujoco
from pipeline.hidden.law_perturbation import NO_PERTURBATION
from pipeline.hidden.recipe import Recipe
from pipeline.hidden.scenario import BOUNCING, Scenario, draw_scenario
from pipeline.hidden.strength import scaled_effect
from pipeline.hidden.world import known_scene_of
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.vision.rendering.appearance import Appearance, apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.render import render_rgb

FPS, SECONDS = 30, 1.0
SIZE = (480, 320)  # px
SCENARIOS = (BOUNCING, "roll", "puck")
NOTHING = "none"
SEEN = 1.6, 2.2  # m, height of the picture in the middle of the scene


@dataclass(frozen=True)
class FilmedClip:
    """frames (T, H, W, 3) uint8; times (T,) s; truth: the tracks without any error, which only a judge may see."""

    name: str
    frames: np.ndarray
    times: np.ndarray
    truth: tuple[Track, ...]


@dataclass(frozen=True)
class FilmedWorld:
    """A world before it is filmed.

    Attributes:
        scenes: Of the clips, all of one camera, with what is hidden.
        look: Of the bodies, the ground and the light.
        known: Content of the scene file, without a camera.
        truth: What only the judge may see.
    """

    scenes: tuple[Scene, ...]
    look: Appearance
    known: dict[str, Any]
    truth: dict[str, Any]

    def clips(self, rng: np.random.Generator, backend: str) -> tuple[FilmedClip, ...]:
        """Film it.

        Args:
            rng: Draws the sensor's errors.
            backend: That renders: "mujoco" or "raycast".
        """
        times, filmed = frame_times(), []
        for number, scene in enumerate(self.scenes):
            motion = run_mujoco(scene, times, NO_PERTURBATION)
            frames = render_rgb(scene, motion.position, motion.quaternion, self.look, *SIZE, backend)
            frames = apply_sensor(frames, sample_sensor(rng, noise=(0.0, 0.01), blur=(0.0, 0.6)), rng)
            truth = tuple(
                Track(f"clip_{number}", body.name, times, motion.position[:, i], quaternion=motion.quaternion[:, i])
                for i, body in enumerate(scene.objects)
            )
            filmed.append(FilmedClip(f"clip_{number}", frames, times, truth))
        return tuple(filmed)


def frame_times() -> np.ndarray:
    """(T,) s, of a clip's frames."""
    return np.arange(round(SECONDS * FPS) + 1) / FPS


def make_filmed_world(
    name: str, scenario_name: str, strength: float, clips: int, rng: np.random.Generator, *, noise: float = 0.002
) -> FilmedWorld:
    """The filmed world of an effect.

    Args:
        name: Of the effect, or NOTHING.
        scenario_name: Of SCENARIOS.
        strength: In detection limits at `noise`.
        clips: How many.
        rng: Draws everything.
        noise: m, to which the strength refers.
    """
    hidden = () if name == NOTHING else (name,)
    scenario = replace(draw_scenario(scenario_name, hidden, rng), spin=False, orientation=False)
    launches = [_launch(scenario, number, rng) for number in range(clips)]
    recipe = Recipe(0, hidden, strength, noise, clips)
    effects = tuple(scaled_effect(e, recipe, scenario, launches, frame_times(), rng=rng) for e in hidden)
    camera = _camera(scenario_name, rng)
    look = sample_appearance(rng, len(scenario.bodies), n_fixed=0)
    scenes = tuple(Scene(bodies, camera, effects=effects) for bodies in launches)
    told = {
        "effects": [
            {"name": e.name, **{k: list(v) if isinstance(v, tuple) else v for k, v in e.parameters}} for e in effects
        ],
        "hidden": name,
        "unlisted": None,
        "wrong": None,
        "engine": "mujoco",
        "scenario": scenario_name,
        "strength": strength,
        "noise": noise,
        "clips": clips,
        "camera": {"position": camera.position, "fov": camera.fov, "orientation": camera.orientation},
    }
    return FilmedWorld(scenes, look, known_scene_of(scenario), told)


def _launch(scenario: Scenario, number: int, rng: np.random.Generator) -> tuple[SceneObject, ...]:
    """The body of one clip, which stays in the picture; directions differ between clips."""
    (body,) = scenario.bodies
    if scenario.name == BOUNCING:
        way = 1 if number % 2 else -1
        speed = rng.uniform(0.4, 1.6)
        start = (-way * speed * SECONDS / 2 + rng.normal(0, 0.1), 0.0, body.size[0] + rng.uniform(0.35, 0.9))
        velocity = (way * speed, 0.0, rng.uniform(-0.5, 1.0))
        return (replace(body, position=start, velocity=velocity),)
    angle = 2 * np.pi * (number + rng.uniform(0, 0.6)) / 4 + rng.uniform(0, 0.4)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    speed = rng.uniform(0.5, 1.6)
    height = body.size[0] if body.shape == "sphere" else body.size[1] / 2
    start = -along * speed * SECONDS / 2 * rng.uniform(0.6, 1.0) + [*rng.normal(0, 0.1, 2), height]
    spin = np.array([-along[1], along[0], 0.0]) * speed / height if body.shape == "sphere" else np.zeros(3)
    return (
        replace(
            body,
            position=tuple(map(float, start)),
            velocity=tuple(speed * along),
            angular_velocity=tuple(map(float, spin)),
        ),
    )


def _camera(scenario: str, rng: np.random.Generator) -> Camera:
    """A phone's camera, held nearly level to the side of a bounce or looking down at the ground."""
    longer = np.radians(rng.uniform(52, 70))
    fov = 2 * np.arctan(np.tan(longer / 2) * SIZE[1] / SIZE[0])
    distance = rng.uniform(*SEEN) / 2 / np.tan(fov / 2)
    side = scenario == BOUNCING
    pitch = rng.uniform(-6, 2) if side else rng.uniform(-50, -25)
    yaw, roll = rng.normal(0, 2.0 if side else 0.0), rng.normal(0, 0.7)
    turn = np.array([1.0, 0.0, 0.0, 0.0])
    for angle, axis in ((yaw, (0, 0, 1)), (90 + pitch, (1, 0, 0)), (roll, (0, 0, 1))):
        turn = quaternion_multiply(turn, quaternion_from_rotation_vector(np.radians(angle) * np.array(axis, float)))
    target = np.array([0.0, 0.0, 0.55 if side else 0.0])
    place = target + distance * matrix_from_quaternion(turn)[:, 2]
    return Camera(tuple(map(float, place)), float(np.degrees(fov)), orientation=tuple(map(float, turn)))
