"""How the weights in `models` were trained: `python -m training.words.trainer`, `python -m training.raft`."""
