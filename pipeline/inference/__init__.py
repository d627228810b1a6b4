"""From a clip to a scene: what the model is shown, its answers, and the search. The graph and the command call this."""
