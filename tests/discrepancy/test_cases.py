"""Measurements that once went wrong, each of a kind; they lie beside the project and are not part of it."""

import pytest

from benchmarks.mask_clips import data_folder
from pipeline.api.discover import discover
from pipeline.discrepancy.report.discovery import Discovery

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
