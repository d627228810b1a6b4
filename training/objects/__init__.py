"""Training of the model that reads objects."""
