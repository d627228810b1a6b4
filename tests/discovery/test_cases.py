"""Measurements that once went wrong, each of a kind; they lie beside the project and are not part of it."""

import numpy as np
import pytest

from pipeline.api.discover import discover
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.where.path_evidence import smooth_velocity
from pipeline.scene.effects.region import Region
from training.data_folder import data_folder

CASES = data_folder() / "cases"


def answer(case: str) -> Discovery:
    if not (CASES / case).is_dir():
        pytest.skip(f"there is no {CASES / case}: set DYNAMICS_DATA to the folder that has cases")
    return discover(CASES / case / "tracks.csv", CASES / case / "scene.yaml").found


def test_hits_by_an_unseen_post_are_not_the_grounds() -> None:
    found = answer("unseen_post")
    assert found.verdict.effects == ("hidden_obstacle",)
    assert found.verdict.parameters["position"].value[:2] == pytest.approx([0.5, -0.15], abs=0.06)


def test_a_body_that_rests_in_one_recording_is_measured_all_the_same() -> None:
    assert answer("cart_rests").verdict.effects == ()


def friction(found: Discovery) -> float:
    value = found.calibrated["puck.sliding_friction"].value
    assert isinstance(value, float)
    return value


def test_a_rough_patch_is_found_where_it_is_and_has_no_pull_elsewhere() -> None:
    found = answer("rough_patch")
    assert found.verdict.effects == ("friction_error",)
    assert Region.of(found.verdict.named[0].only or {}).centre is not None
    says, acts = [], []
    for arc in found.selection.baseline.problem.arcs:
        rows = [d for d in found.disagreement if d.clip == arc.clip]
        says.append(np.any([(d.start <= arc.time) & (arc.time <= d.end) for d in rows] or [arc.time < 0], axis=0))
        moves = np.linalg.norm(smooth_velocity(arc.time, arc.position), axis=1) > 0.05
        acts.append(moves & (np.linalg.norm(arc.position[:, :2] - (0.35, 0.1), axis=1) < 0.3))
    said, true = np.concatenate(says), np.concatenate(acts)
    assert 2 * (said & true).sum() / (said.sum() + true.sum()) >= 0.85
    assert found.verdict.parameters["coefficient"].value == pytest.approx(0.34, rel=0.05)
    assert friction(found) == pytest.approx(0.092, rel=0.03)


def test_a_table_that_bends_down_is_tilted_beyond_the_bend_only() -> None:
    found = answer("bent_table")
    assert found.verdict.effects == ("tilted_gravity",)
    region = Region.of(found.verdict.named[0].only or {})
    assert region.normal is not None and region.normal[0] > 0.99
    assert region.offset == pytest.approx(0.25, abs=0.03)
    assert friction(found) == pytest.approx(0.149, rel=0.03)


def test_a_parachute_drags_after_it_opened() -> None:
    found = answer("late_parachute")
    assert found.verdict.effects == ("air_drag",)
    assert Region.of(found.verdict.named[0].only or {}).after == pytest.approx(0.5, abs=0.03)


def test_a_pull_of_short_reach_is_named_there_or_unknown_and_nothing_elsewhere() -> None:
    found = answer("short_magnet")
    where = report_dict(found)["where"]
    assert found.verdict.effects in {("unknown",), ("hidden_attractor",)}
    assert where["only"]["within"]["center"][:2] == pytest.approx([-0.4, 0.3], abs=0.12)
    assert friction(found) == pytest.approx(0.158, rel=0.03)


def test_a_recording_that_is_too_large_is_a_fault_and_no_law() -> None:
    found = answer("larger_recording")
    assert found.verdict.effects == ()
    (fault,) = found.faults
    assert (fault.fault, fault.clip) == ("recording_scale", "clip_03")
    assert fault.size == pytest.approx(1.05, abs=0.01)


def test_dropped_frames_are_faults_and_no_law() -> None:
    found = answer("dropped_frames")
    assert found.verdict.effects == ()
    dropped = [f for f in found.faults if f.fault == "dropped_frames"]
    assert sum(f.size for f in dropped) == 36


def test_cups_that_get_narrower_have_drag_and_a_remainder() -> None:
    found = answer("stacked_filters_shrinking")
    assert found.verdict.effects == ("air_drag",)
    assert 0.0012 <= found.verdict.parameters["coefficient"].value <= 0.0015
    assert found.verdict.remainder is not None


def test_a_text_of_numbers_is_a_table() -> None:
    if not (CASES / "txt_table").is_dir():
        pytest.skip(f"there is no {CASES / 'txt_table'}: set DYNAMICS_DATA to the folder that has cases")
    found = discover(
        CASES / "txt_table" / "drop.txt", CASES / "txt_table" / "scene.yaml", effects="air_drag,wind"
    ).found
    assert found.notes[0] == "read as text with tabs between columns and decimal commas"
    assert any(note.startswith("y is up (bodies fall along it") for note in found.notes)
