"""What stages write of hidden worlds: the scene that the discovery is told, and the truth that the judge is told."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any

import pyarrow as pa
from ruamel.yaml import YAML

from pipeline.shards.tables import table_from_rows

TRUTH = pa.schema({"clip": pa.int64(), "truth": pa.string()})


def scene_text(known: Mapping[str, Any]) -> str:
    """The scene file of what is known, YAML."""
    text = io.StringIO()
    YAML(typ="safe").dump(known, text)
    return text.getvalue()


def truth_table(truths: Mapping[int, Mapping[str, Any]]) -> pa.Table:
    """A row for each world, by its number: clip, truth (JSON)."""
    rows = [{"clip": number, "truth": json.dumps(truth, sort_keys=True)} for number, truth in truths.items()]
    return table_from_rows(rows, TRUTH)
