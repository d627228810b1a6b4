"""What the shipped weights have learned. Skipped where models/raft-small is missing."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.raft import load_raft
from training.raft.flow_scores import cross_engine, cross_engine_folder, held_out, score
from training.raft.pair_stream import Batch

WEIGHTS = Path(__file__).resolve().parents[2] / "models" / "raft-small"
pytestmark = pytest.mark.skipif(not (WEIGHTS / "model.safetensors").exists(), reason=f"no weights in {WEIGHTS}")


@pytest.fixture(scope="module")
def raft():
    return load_raft(WEIGHTS)


def test_equal_frames_have_next_to_no_flow(raft, rng):
    frames = held_out(int(rng.integers(1 << 31)), 6).frames_a
    flow = raft.flow(frames, frames, 4)
    assert np.quantile(np.linalg.norm(flow, axis=-1), 0.95) < 0.3


def test_raft_is_nearer_to_the_exact_flow_than_dis_over_the_whole_frame(raft, rng):
    pairs = held_out(int(rng.integers(1 << 31)), 24)
    assert score(raft, pairs, 4).frame < score(DIS("medium"), pairs, 4).frame


@pytest.mark.slow
def test_raft_is_nearer_than_dis_over_the_whole_frame_on_another_engines_clips(raft):
    folder = cross_engine_folder()
    if folder is None:
        pytest.skip("no clips of another engine in DYNAMICS_DATA or ../shared/data")
    pairs: Batch = cross_engine(folder, every=9)
    assert score(raft, pairs, 4).frame < score(DIS("medium"), pairs, 4).frame
