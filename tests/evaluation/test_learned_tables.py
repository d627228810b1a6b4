"""Tables of the model's own answers."""

import numpy as np
import pytest

from pipeline.evaluation.learned_tables import (
    CHECKPOINT,
    differences_table,
    samples_table,
    scaling_table,
)
from pipeline.evaluation.tables import Summary
from pipeline.metrics.intervals import Estimate


def law(n: float, slope: float) -> float:
    """A share whose odds rise as a power."""
    odds = 0.1 * (float(n) / 1e3) ** slope
    return odds / (1 + odds)


def checkpoints(counts: list[int], slope: float) -> list[dict[str, str]]:
    return [{"clips_seen": str(n), "minutes": "1.5", "metric": m, **Estimate(law(n, slope), 0, 1, 9).row()}
            for n in counts for m in CHECKPOINT]  # fmt: skip


def test_what_follows_the_law_is_foretold_by_it(rng: np.random.Generator) -> None:
    slope = float(rng.uniform(0.1, 0.5))
    header, lines = scaling_table(checkpoints([4000, 1000, 2000], slope))
    assert [line[0] for line in lines] == ["1,000", "2,000", "4,000", "40,000 (foretold)", "400,000 (foretold)"]
    for line, n in zip(lines[3:], (4e4, 4e5), strict=True):
        for cell in line[2:]:
            mean, rest = cell.split(" (")
            found = [float(v) for v in (mean, *rest.rstrip(")").split(" to "))]
            assert found == pytest.approx([law(n, slope)] * 3, rel=0.01)
    assert len(header) == len(lines[0])


def test_nothing_is_foretold_from_two_checkpoints() -> None:
    assert len(scaling_table(checkpoints([1000, 2000], 0.5))[1]) == 2


def test_a_pair_is_one_line() -> None:
    rows = [{"suite": "id", "first": "a", "second": "b", "what": what, **Estimate(v, v - 0.1, v + 0.1, 7).row()}
            for what, v in (("first", 0.5), ("second", 0.3), ("difference", 0.2))]  # fmt: skip
    _, (line,) = differences_table(rows)
    assert line == ["id", "a", "b", "7", "0.5 (0.4–0.6)", "0.3 (0.2–0.4)", "0.2 (0.1–0.3)"]


def test_only_methods_with_samples_have_a_curve() -> None:
    some, none = Estimate(0.5, 0.4, 0.6, 3), Estimate(np.nan, np.nan, np.nan, 0)
    keys = [("id", "tiny"), ("id", "tiny, best of 2")]
    found = {keys[0]: {"iou": some, "iou@1": none}, keys[1]: {"iou": some, "iou@1": some, "iou@2": some}}
    _, (line,) = samples_table(Summary(found, dict.fromkeys(keys, 2.0), dict.fromkeys(keys, 1.0)))
    assert line[1] == "tiny, best of 2" and line[-6:].count("–") == 4
