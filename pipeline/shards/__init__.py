"""Sharded tables and arrays, the content-keyed store behind them, and the executors that fill it.

A stage calls `map_shards.map_shards`; a reader calls `dataset.open_shards`. The content of a shard is a pure function
of its inputs, parameters and code; its key is a hash of these (`keys`), so it is known before the shard is computed.
"""
