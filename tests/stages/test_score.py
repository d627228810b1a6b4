"""The stage `score`."""

from pipeline.evaluation.scene_scores import METRICS
from pipeline.evaluation.tables import ERRORS
from stages.score import CLIP_COLUMNS


def test_the_table_of_clips_has_a_column_for_every_metric_and_parameter() -> None:
    assert sorted(CLIP_COLUMNS[4:]) == sorted([*METRICS, *ERRORS])
