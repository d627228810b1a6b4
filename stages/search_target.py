"""What a clip's search has to match, from its `render` and `flow` shards."""

from collections.abc import Mapping
from typing import Any

from pipeline.clips.schedule import Schedule
from pipeline.search.target import Target, make_target
from pipeline.shards.opened_shard import OpenShard


def search_target(rendered: OpenShard, flow: OpenShard, clip: int, p: Mapping[str, Any]) -> Target:
    """The masks given with the clip and the flow that was measured, at the size of the search."""
    masks = rendered.array(clip, "mask")[Schedule(**p["clip"]).pairs[:, 0]]
    return make_target(masks, flow.array(clip, "flow"), p["width"], p["height"])
