"""Verdicts on small worlds, and the files that the command leaves."""

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader
from ruamel.yaml import YAML
from small_world import KNOWN, effect, thrown

from pipeline.commands.main import main
from pipeline.discovery.discover import discover
from pipeline.discovery.report.html_page import sentence
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.track import Track, tracks_table
from pipeline.hidden.events import run_events
from pipeline.physics.simulate import compile_xml
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Scene, SceneObject
from pipeline.scene.text import load_scene
from pipeline.shards.content_hash import hash_files

ALL = tuple(effect_kinds())
STRONG = {
    "air_drag": {"coefficient": 0.01},
    "magnus_lift": {"coefficient": 0.002},
    "tilted_gravity": {"tilt": (0.05, 0.02)},
    "rotating_frame": {"angular_velocity": 0.3},
    "impulse": {"time": 0.4, "momentum": (0.1, 0.0, 0.1)},
}


@pytest.mark.parametrize("name", sorted(STRONG))
def test_a_strong_effect_is_named_and_the_gap_closes(name: str) -> None:
    rng = np.random.default_rng(sorted(STRONG).index(name))
    found = discover(thrown(rng, 8, (effect(name, **STRONG[name]),)), known_scene(KNOWN), 0.3, ALL, rng)
    assert found.verdict.effects == (name,)
    assert found.gap.before > 1.5 * found.gap.noise_floor
    assert found.gap.after == pytest.approx(found.gap.noise_floor, rel=0.15)


def test_where_nothing_is_hidden_nothing_is_claimed() -> None:
    rng = np.random.default_rng(5)
    found = discover(thrown(rng, 8), known_scene(KNOWN), 0.3, ALL, rng)
    assert found.verdict.effects == ()
    assert found.gap.after == pytest.approx(found.gap.noise_floor, rel=0.1)


def test_the_augmented_scene_has_the_friction_fitted_with_the_effect() -> None:
    rng = np.random.default_rng(12)
    friction, tracks = 0.3, []
    for c in range(8):
        angle = rng.uniform(-np.pi, np.pi)
        velocity = rng.uniform(0.8, 2.0) * np.array([np.cos(angle), np.sin(angle), 0.0])
        puck = SceneObject(
            "cylinder", (0.05, 0.02), 0.2, friction, position=(0, 0, 0.01), velocity=tuple(velocity), name="puck"
        )
        scene = Scene((puck,), effects=(effect("moving_ground", velocity=(0.4, 0.2)),))
        times = np.arange(61) / 60
        position = run_events(scene, times)[0][:, 0] + rng.normal(0, 0.002, (61, 3))
        tracks.append(Track(f"clip_{c}", "puck", times, position))
    puck = {"name": "puck", "shape": "cylinder", "radius": 0.05, "height": 0.02, "mass": 0.2}
    found = discover(tracks, known_scene({"objects": [puck], "fit": ["sliding_friction"]}), 0.3, ALL, rng)
    assert found.verdict.effects == ("moving_ground",)
    without = found.calibrated["puck.sliding_friction"].value
    assert isinstance(without, float) and abs(without - friction) > 0.02
    assert found.scene.objects[0].sliding_friction == pytest.approx(friction, abs=0.01)


def test_an_effect_that_the_scene_has_already_is_not_found_again() -> None:
    rng = np.random.default_rng(11)
    known = known_scene({**KNOWN, "effects": [{"name": "air_drag", "coefficient": 0.01}]})
    assert discover(thrown(rng, 8, (effect("air_drag", coefficient=0.01),)), known, 0.3, ALL, rng).verdict.effects == ()


def test_what_only_scales_gravity_is_one_set() -> None:
    rng = np.random.default_rng(6)
    found = discover(thrown(rng, 8, (effect("gravity_error", gravity=10.5),)), known_scene(KNOWN), 0.3, ALL, rng)
    (alike,) = found.verdict.equivalent
    assert {"gravity_error", "length_scale"} <= set(alike) and "air_drag" not in alike
    assert "pendulum" in found.verdict.experiment


def test_of_two_effects_each_has_its_own_set_of_equals() -> None:
    rng = np.random.default_rng(13)
    both = (effect("gravity_error", gravity=10.5), effect("magnus_lift", coefficient=0.002))
    found = discover(thrown(rng, 8, both), known_scene(KNOWN), 0.3, ALL, rng)
    assert len(found.verdict.effects) == 2 and "magnus_lift" in found.verdict.effects
    (alike,) = found.verdict.equivalent
    assert {"gravity_error", "length_scale"} <= set(alike) and "magnus_lift" not in alike
    assert found.gap.after == pytest.approx(found.gap.noise_floor, rel=0.15)


def test_what_bends_the_end_of_one_flight_is_no_third_law() -> None:
    rng = np.random.default_rng(15)
    both = (effect("air_drag", coefficient=0.01), effect("tilted_gravity", tilt=(0.08, 0.03)))
    first, *others = thrown(rng, 8, both)
    late = np.maximum(first.time - 0.85, 0.0)
    bent = replace(first, position=first.position + late[:, None] ** 2 * (0.0, 0.0, 8.0))
    found = discover([bent, *others], known_scene(KNOWN), 0.3, ALL, rng)
    assert set(found.verdict.effects) == {"air_drag", "tilted_gravity"}


def test_a_spin_that_explains_nothing_does_not_earn_its_place() -> None:
    rng = np.random.default_rng(7)
    tracks = thrown(rng, 8, (effect("tilted_gravity", tilt=(0.05, 0.0)),))
    assert "magnus_lift" not in discover(tracks, known_scene(KNOWN), 0.3, ALL, rng).verdict.effects


def test_struck_off_the_list_lift_is_unknown_and_the_formula_finds_it() -> None:
    rng = np.random.default_rng(8)
    names = tuple(n for n in ALL if n != "magnus_lift")
    found = discover(thrown(rng, 8, (effect("magnus_lift", coefficient=0.004),)), known_scene(KNOWN), 0.3, names, rng)
    assert found.verdict.effects == ("unknown",)
    assert found.verdict.form is not None and "w x v" in found.verdict.form


def test_probabilities_sum_to_one_and_the_report_has_what_the_format_says() -> None:
    rng = np.random.default_rng(9)
    found = discover(thrown(rng, 4, (effect("linear_drag", coefficient=0.1),)), known_scene(KNOWN), 0.3, ALL, rng)
    content = report_dict(found)
    assert sum(found.probability.values()) == pytest.approx(1)
    needed = {"noise", "clips", "calibrated", "disagreement", "candidates", "verdict", "gap"}
    assert needed <= content.keys()
    assert {"effect", "probability", "delta_bic", "held_out_gain", "parameters"} == content["candidates"][0].keys()
    assert {"clip", "object", "t_start", "t_end", "regime", "residual", "unit", "z_score", "direction"} == content[
        "disagreement"
    ][0].keys()
    z = [d["z_score"] for d in content["disagreement"]]
    assert z == sorted(z, reverse=True)
    assert content["gap"]["metric"] == "position_rmse_m"
    assert "against the velocity" in " ".join(d["direction"] for d in content["disagreement"])


def files(tmp_path: Path) -> tuple[Path, Path]:
    rng = np.random.default_rng(10)
    measured, scene = tmp_path / "m.parquet", tmp_path / "scene.yaml"
    pq.write_table(tracks_table(thrown(rng, 4, (effect("air_drag", coefficient=0.01),))), measured)
    with scene.open("w") as file:
        YAML(typ="safe").dump(KNOWN, file)
    return measured, scene


def test_the_command_writes_a_report_and_a_scene_that_runs(tmp_path: Path) -> None:
    measured, scene = files(tmp_path)
    out = tmp_path / "out"
    assert main(["discover", str(measured), str(scene), "-o", str(out)]) == 0
    content = json.loads((out / "report.json").read_text())
    assert content["verdict"]["effects"] == ["air_drag"]
    assert content["verdict"]["parameters"]["coefficient"]["value"] == pytest.approx(0.01, rel=0.1)
    augmented = load_scene(out / "augmented.yaml")
    assert [e.name for e in augmented.effects] == ["air_drag"]
    compile_xml((out / "augmented.xml").read_text())
    page = (out / "report.html").read_text()
    assert "<svg" in page and "http" not in page.replace("http://www.w3.org", "").replace(
        "http://purl.org", ""
    ).replace("http://creativecommons.org", "").replace("https://matplotlib.org", "")
    assert {"residuals.parquet", "recording.rrd"} <= {p.name for p in out.iterdir()}


def content(recording: Path) -> list[tuple[str, str]]:
    """The chunks of a recording without the numbers that rerun draws at random."""
    chunks = (chunk.to_record_batch() for chunk in RrdReader(str(recording)).stream().to_chunks())
    rows = [(b.schema.metadata[b"rerun:entity_path"].decode(), b.to_pydict()) for b in chunks]
    return sorted((path, repr({k: v for k, v in row.items() if k != "rerun.controls.RowId"})) for path, row in rows)


def test_two_runs_on_one_input_give_the_same_files_but_for_their_times(tmp_path: Path) -> None:
    measured, scene = files(tmp_path)
    for out in ("one", "two"):
        assert main(["discover", str(measured), str(scene), "-o", str(tmp_path / out)]) == 0
    one, two = hash_files(tmp_path / "one"), hash_files(tmp_path / "two")
    assert {name for name in one if one[name] != two[name]} <= {"times.json", "recording.rrd"}
    assert content(tmp_path / "one" / "recording.rrd") == content(tmp_path / "two" / "recording.rrd")
    assert "seconds" not in json.loads((tmp_path / "one" / "result.json").read_text())


@pytest.mark.parametrize(
    ("effects", "equivalent", "words"),
    [
        ([], [], "Nothing is missing"),
        (["unknown"], [], "no listed effect explains"),
        (["unknown"], [["air_drag", "gravity_error"]], "do not tell which of these: air_drag, gravity_error."),
        (
            ["air_drag"],
            [["air_drag", "wind"]],
            "air_drag (confidence {}). These measurements cannot tell it from wind.",
        ),
    ],
)
def test_a_doubtful_verdict_says_so_and_a_sure_one_does_not(
    effects: list[str], equivalent: list[list[str]], words: str
) -> None:
    for confidence in (0.5, 0.95):
        verdict = {"effects": effects, "equivalent": equivalent, "confidence": confidence}
        verdict |= {"form": "F/m = 0.1 v", "remainder": None, "named": []}
        gap = {"before": 0.01, "after": 0.002, "noise_floor": 0.002, "unit": "m"}
        said = sentence({"verdict": verdict, "gap": gap, "where": None, "faults": [], "clips": {"held_out": ["c"]}})
        assert said.startswith("Doubtful. ") == (confidence == 0.5)
        assert words.format(f"{confidence:.2f}") in said and f"(confidence {confidence:.2f})" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--effects", "telepathy"], "unknown effect 'telepathy'; valid: all"),
        (["--held-out", "1.5"], "held_out is 1.5; valid"),
    ],
)
def test_bad_words_are_said_in_one_line_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    measured, scene = files(tmp_path)
    out = tmp_path / "deep" / "out"
    assert main(["discover", str(measured), str(scene), "-o", str(out), *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not out.parent.exists()


def test_a_bad_file_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, scene = files(tmp_path)
    (tmp_path / "bad.csv").write_text("clip,object,time,x,y\n")
    assert main(["discover", str(tmp_path / "bad.csv"), str(scene), "-o", str(tmp_path / "out")]) == 2
    assert "no column 'z'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


KILLED = """
import os, signal, sys
import pipeline.api.discover as command
from pipeline.commands.main import main
command.html_page = lambda *_: os.kill(os.getpid(), signal.SIGKILL)  # some files are written by then
main(sys.argv[1:])
"""


def test_a_run_that_is_killed_while_it_writes_leaves_no_half_report(tmp_path: Path) -> None:
    measured, scene = files(tmp_path)
    words = ["discover", str(measured), str(scene), "-o", str(tmp_path / "out")]
    killed = subprocess.run([sys.executable, "-c", KILLED, *words], capture_output=True)
    assert killed.returncode == -signal.SIGKILL
    assert not (tmp_path / "out").exists()
    assert main(words) == 0
    assert json.loads((tmp_path / "out" / "report.json").read_text())["verdict"]["effects"] == ["air_drag"]
