"""From measured tracks to the problem that is fitted: noise, impacts, smooth arcs, padded arrays."""
