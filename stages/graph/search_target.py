"""What a clip's search has to match, from its `render` and `flow` shards, and what it starts from."""

from collections.abc import Mapping
from typing import Any

from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.search.target import Target, make_target
from pipeline.shards.opened_shard import OpenShard


def search_target(rendered: OpenShard, flow: OpenShard, clip: int, p: Mapping[str, Any]) -> Target:
    """The masks given with the clip and the flow that was measured, at the size of the search."""
    masks = rendered.array(clip, "mask")[Schedule(**p["clip"]).pairs[:, 0]]
    return make_target(masks, flow.array(clip, "flow"), p["width"], p["height"])


def distinct_starts(ranked: OpenShard, clip: int, count: int) -> list[Scene]:
    """The best samples of a clip that differ, from its `best_of_k` shard."""
    texts = [row["scene"] for row in ranked.rows(clip)]
    return [read_scene(text) for text in list(dict.fromkeys(texts))[:count]]
