"""What a clip's search has to match, from its `render` and `flow` shards, and what it starts from."""

from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.search.target import Target, make_target
from pipeline.shards.opened_shard import OpenShard


def search_target(rendered: OpenShard, flow: OpenShard, clip: int, schedule: Schedule, size: tuple[int, int]) -> Target:
    """What the search of a clip has to match.

    Args:
        rendered: The `render` shard of the clip, which has its masks.
        flow: The `flow` shard of the clip.
        clip: The clip's index in its suite.
        schedule: The frames of the clip.
        size: Width and height at which the search compares, px.

    Returns:
        The masks and the measured flow of the model's frames, at that size.
    """
    masks = rendered.array(clip, "mask")[schedule.pairs[:, 0]]
    return make_target(masks, flow.array(clip, "flow"), *size)


def distinct_starts(ranked: OpenShard, clip: int, count: int) -> list[Scene]:
    """The best samples of a clip that differ, from its `best_of_k` shard."""
    texts = [row["scene"] for row in ranked.rows(clip)]
    return [read_scene(text) for text in list(dict.fromkeys(texts))[:count]]
