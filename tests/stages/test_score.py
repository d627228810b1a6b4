"""The stage `score`."""

from pipeline.report.event_scores import EVENT_METRICS
from pipeline.report.scene_scores import METRICS
from pipeline.report.summary import COUNTS
from pipeline.report.tables import ERRORS
from stages.score import CLIP_COLUMNS


def test_the_table_of_clips_has_a_column_for_every_metric_parameter_and_count_of_events() -> None:
    counts = [f"{metric}.{count}" for metric in EVENT_METRICS for count in COUNTS]
    assert sorted(CLIP_COLUMNS[4:]) == sorted([*METRICS, *ERRORS, *counts])
