"""Models of the motion along arcs, fitted to a problem: the calibrated model, and models with effects."""
