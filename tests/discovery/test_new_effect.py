"""A new effect is one file, the one in docs/discovery.md: simulated, hidden in a world, discovered, judged."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pipeline.discovery.discover import discover
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.hidden.judge import judge
from pipeline.hidden.recipe import Recipe
from pipeline.hidden.world import make_world
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.registry import effect_kinds, extra_effects
from pipeline.scene.scene import Effect
from pipeline.scene.text import read_scene, write_scene

DOCS = Path(__file__).resolve().parents[2] / "docs" / "discovery.md"
SCENE = """\
camera: null
gravity: 9.81
ground: null
objects:
- {name: ball, shape: sphere, radius: 0.1, mass: 0.5, sliding_friction: 0.5, rolling_friction: 0, damping: 1,
   position: [0, 0, 1], velocity: [3, 0, 0], angular_velocity: [0, 0, 0], orientation: [1, 0, 0, 0]}
effects:
- {name: cubic_drag, coefficient: 0.02}
"""


@pytest.fixture
def cubic_drag(tmp_path: Path) -> Iterator[None]:
    (example,) = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "cubic_drag.py").write_text(example)
    with extra_effects(tmp_path):
        yield
    assert "cubic_drag" not in effect_kinds()


@pytest.mark.usefixtures("cubic_drag")
def test_it_is_read_and_written_and_mujoco_simulates_it() -> None:
    scene = read_scene(SCENE.replace("9.81", "0.0"))
    assert scene.effects == (Effect("cubic_drag", (("coefficient", 0.02),)),)
    assert read_scene(write_scene(scene)) == scene
    speed = np.linalg.norm(simulate(scene, 1.0).velocity[-1, 0])
    assert speed == pytest.approx((3**-2 + 2 * 0.02 / 0.5) ** -0.5, rel=3e-3)  # of dv/dt = -c/m v³


@pytest.mark.usefixtures("cubic_drag")
@pytest.mark.parametrize("engine", ["mujoco", "events"])
def test_hidden_in_a_world_it_is_discovered_by_name_and_judged_right(engine: str) -> None:
    recipe = Recipe(1, ("cubic_drag",), strength=30.0, clips=6, engine=engine)
    world = make_world(recipe, np.random.default_rng(5))
    assert world.truth["engine"] == engine and world.truth["effects"][0]["name"] == "cubic_drag"
    found = discover(world.tracks, known_scene(world.known), 0.3, tuple(effect_kinds()), np.random.default_rng(0))
    verdict = report_dict(found)["verdict"]
    judged = judge(verdict, world.truth)
    assert verdict["effects"] == ["cubic_drag"] and judged.right
    assert judged.errors["cubic_drag.coefficient"] < 0.1
    assert [e.name for e in found.scene.effects] == ["cubic_drag"]
