"""`from pipeline import infer, masks, simulate, edit, discover, discover_clips`."""

import inspect
import os
import subprocess
import sys
from dataclasses import asdict

import pytest
from sampled_scenes import params

import pipeline
from pipeline.api import infer as infer_module
from pipeline.clips.events import DEFAULT_THRESHOLDS
from pipeline.errors import SceneError
from pipeline.inference import asking, find_scenes
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene, SceneObject

NAMES = ("discover", "discover_clips", "edit", "export", "infer", "masks", "simulate")
BALL = SceneObject("sphere", (0.1,), 1.0, position=(0.0, 0.0, 1.0), name="ball")


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = {"torch", "transformers", "mujoco", "numba", "rerun", "cv2", "numpy"}
    code = f"import sys, pipeline\nprint({heavy} & set(sys.modules), sorted(pipeline.__all__))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    assert done.stdout.split("\n")[0] == f"set() {sorted(NAMES)}"


def test_the_functions_are_those_of_the_commands() -> None:
    assert pipeline.infer is infer_module.infer
    for function in (getattr(pipeline, name) for name in NAMES):
        assert inspect.isfunction(function)
        assert "Args:" in (function.__doc__ or "")
    with pytest.raises(AttributeError, match="no attribute 'inver'"):
        _ = pipeline.inver  # type: ignore[attr-defined]


def test_a_scene_in_memory_is_simulated_with_an_edit() -> None:
    run = pipeline.simulate(Scene((BALL,), gravity=(0, 0, -9.81)), seconds=0.2, edits=["gravity=0"])
    assert isinstance(run.trace, Trace)
    (ball,) = run.departures
    assert ball.name == "ball"
    assert ball.end == pytest.approx(0.5 * 9.81 * 0.2**2, rel=0.03)  # semi-implicit Euler goes a step further
    assert run.scene.gravity == (0, 0, 0)


def test_what_infer_assumes_is_what_the_graph_has_in_params_yaml() -> None:
    graph, here = params(), find_scenes
    assert (graph.search.width, graph.search.height) == here.SEARCH_SIZE
    assert graph.search.starts == here.STARTS
    assert (graph.flow.width, graph.flow.height) == asking.FLOW_SIZE
    assert graph.flow.iterations == asking.FLOW_ITERATIONS
    assert graph.infer.decode_batch_size == asking.DECODE_BATCH_SIZE
    signature = inspect.signature(pipeline.infer).parameters
    for name in ("samples", "temperature", "top_p", "middle"):
        assert signature[name].default == getattr(graph.infer, name)
    assert signature["model"].default == graph.model.base
    assert signature["raft"].default == graph.flow.raft


def test_the_thresholds_of_events_are_those_of_params_yaml() -> None:
    graph = params()
    assert asdict(DEFAULT_THRESHOLDS) == graph.events.model_dump() | {"visible_px": graph.sample.filters.visible_px}


def test_videos_without_a_scene_are_told_what_to_run_first() -> None:
    with pytest.raises(SceneError, match=r"nothing is known of its bodies; .*`dynamics infer throw.mp4 -o inferred`"):
        pipeline.discover_clips(["throw.mp4"])
