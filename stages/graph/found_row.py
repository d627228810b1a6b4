"""What the stages `cmaes` and `fit` keep of a search."""

from typing import Any

import pyarrow as pa

from pipeline.scene.text import write_scene
from pipeline.search.search_result import SearchResult

FOUND = [
    ("scene", pa.string()),
    ("reward", pa.float64()),
    ("iou", pa.float64()),
    ("simulations", pa.int32()),
    ("spent", pa.list_(pa.int32())),
    ("history", pa.list_(pa.float64())),
]


def found_row(found: SearchResult) -> dict[str, Any]:
    """The values of the columns FOUND."""
    return {
        "scene": write_scene(found.scene),
        "reward": found.reward,
        "iou": found.iou,
        "simulations": found.simulations,
        "spent": found.spent.tolist(),
        "history": found.history.tolist(),
    }
