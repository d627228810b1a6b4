"""Tables of scores, and of models compared."""

import numpy as np

from pipeline.clips.intervals import MeanInterval
from pipeline.report.summary import Summary
from pipeline.report.tables import (
    differences_table,
    samples_table,
)


def test_a_pair_of_models_is_one_line_a_metric() -> None:
    head = {"suite": "id", "first": "a", "second": "b", "metric": "iou"}
    rows = [
        {**head, "what": what, **MeanInterval(v, v - 0.1, v + 0.1, 7).row()}
        for what, v in (("first", 0.5), ("second", 0.3), ("difference", 0.2))
    ]
    _, (line,) = differences_table(rows, {"iou": "IoU"})
    assert line == ["id", "a", "b", "IoU", "7", "0.5 (0.4–0.6)", "0.3 (0.2–0.4)", "0.2 (0.1–0.3)"]


def test_only_methods_with_samples_are_in_the_table_of_samples() -> None:
    some, none = MeanInterval(0.5, 0.4, 0.6, 3), MeanInterval(np.nan, np.nan, np.nan, 0)
    keys = [("id", "words"), ("id", "words, best of 2")]
    found = {keys[0]: {"iou": some, "iou@1": none}, keys[1]: {"iou": some, "iou@1": some, "iou@2": some}}
    _, (line,) = samples_table(Summary(found, dict.fromkeys(keys, 2.0), dict.fromkeys(keys, 1.0)))
    assert line[1] == "words, best of 2" and line[-6:].count("–") == 4
