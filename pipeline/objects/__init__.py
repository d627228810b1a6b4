"""A model that reads the bodies of a clip one by one: crops of their masks and flow, with their places as numbers."""
