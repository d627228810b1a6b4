"""How the weights in `models` were trained: `python -m training.tiny`, `python -m training.raft`."""
