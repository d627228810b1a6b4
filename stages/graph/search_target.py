"""A clip's search from its shards: what it has to match, and what it starts from."""

from pipeline.clips.schedule import Schedule
from pipeline.inference.scene_search import clip_evaluator, distinct_starts
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.search.evaluator import Evaluator
from pipeline.shards.opened_shard import OpenShard


def shard_evaluator(
    rendered: OpenShard, flow: OpenShard, clip: int, schedule: Schedule, size: tuple[int, int]
) -> Evaluator:
    """The rewards of scenes for a clip.

    Args:
        rendered: The `render` shard of the clip, which has its masks.
        flow: The `flow` shard of the clip.
        clip: The clip's index in its suite.
        schedule: The frames of the clip, or of its first part.
        size: Width and height at which the search compares, px.
    """
    return clip_evaluator(
        rendered.array(clip, "mask"), flow.array(clip, "flow"), schedule, size, 1, rendered.array(clip, "rgb")
    )


def ranked_starts(ranked: OpenShard, clip: int, count: int) -> list[Scene]:
    """The best samples of a clip that differ, from its `best_of_k` shard."""
    rows = ranked.rows(clip)
    return distinct_starts([read_scene(row["scene"]) for row in rows], [row["valid"] for row in rows], count)
