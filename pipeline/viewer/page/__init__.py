"""Web pages without a server or a network: clips, replays and their motion in 3D (docs/app.md)."""
