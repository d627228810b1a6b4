"""What shards cost to compute: times are no part of a shard's content, so they are kept in the store beside it."""

from pipeline.shards.dataset import ShardedDataset
from pipeline.shards.store import Store, default_store

SECONDS = "seconds"


def compute_seconds(dataset: ShardedDataset, store: Store | None = None) -> float | None:
    """Seconds of one worker behind all shards of a folder; None where the store has forgotten one."""
    store = store or default_store()
    total = 0.0
    for shard in dataset.shards:
        record = store.record_of(shard.entry.key)
        if record is None or SECONDS not in record.get("parts", {}):
            return None
        total += record["parts"][SECONDS]
    return total
