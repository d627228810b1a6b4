"""Sharded tables and arrays, the content-keyed store behind them, and the executors that fill it.

A stage calls `map_shards.map_shards`; a reader calls `dataset.open_shards`. What is in a shard is a pure
function of its inputs, parameters and code, so its key is computed before it is: see `keys`.
"""
