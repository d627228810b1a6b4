"""Tables of scores, of models compared, and of checkpoints."""

import numpy as np
import pytest

from pipeline.evaluation.summary import Summary
from pipeline.evaluation.tables import (
    CHECKPOINT,
    differences_table,
    samples_table,
    scaling_table,
)
from pipeline.metrics.intervals import MeanInterval


def share(n: float, slope: float) -> float:
    """A share whose odds are a power of n."""
    odds = 0.1 * (float(n) / 1e3) ** slope
    return odds / (1 + odds)


def checkpoints(counts: list[int], slope: float) -> list[dict[str, str]]:
    return [
        {"clips_seen": str(n), "minutes": "1.5", "metric": m, **MeanInterval(share(n, slope), 0, 1, 9).row()}
        for n in counts
        for m in CHECKPOINT
    ]


def test_scores_that_follow_the_line_are_extrapolated_exactly(rng: np.random.Generator) -> None:
    slope = float(rng.uniform(0.1, 0.5))
    header, lines = scaling_table(checkpoints([4000, 1000, 2000], slope))
    assert [line[0] for line in lines] == ["1,000", "2,000", "4,000", "40,000 (extrapolated)", "400,000 (extrapolated)"]
    for line, n in zip(lines[3:], (4e4, 4e5), strict=True):
        for cell in line[2:]:
            mean, rest = cell.split(" (")
            found = [float(v) for v in (mean, *rest.rstrip(")").split(" to "))]
            assert found == pytest.approx([share(n, slope)] * 3, rel=0.01)
    assert len(header) == len(lines[0])


def test_nothing_is_extrapolated_from_two_checkpoints() -> None:
    assert len(scaling_table(checkpoints([1000, 2000], 0.5))[1]) == 2


def test_a_pair_of_models_is_one_line() -> None:
    rows = [
        {"suite": "id", "first": "a", "second": "b", "what": what, **MeanInterval(v, v - 0.1, v + 0.1, 7).row()}
        for what, v in (("first", 0.5), ("second", 0.3), ("difference", 0.2))
    ]
    _, (line,) = differences_table(rows)
    assert line == ["id", "a", "b", "7", "0.5 (0.4–0.6)", "0.3 (0.2–0.4)", "0.2 (0.1–0.3)"]


def test_only_methods_with_samples_are_in_the_table_of_samples() -> None:
    some, none = MeanInterval(0.5, 0.4, 0.6, 3), MeanInterval(np.nan, np.nan, np.nan, 0)
    keys = [("id", "tiny"), ("id", "tiny, best of 2")]
    found = {keys[0]: {"iou": some, "iou@1": none}, keys[1]: {"iou": some, "iou@1": some, "iou@2": some}}
    _, (line,) = samples_table(Summary(found, dict.fromkeys(keys, 2.0), dict.fromkeys(keys, 1.0)))
    assert line[1] == "tiny, best of 2" and line[-6:].count("–") == 4
