"""The scene language: the data types, YAML text, sampling, MJCF and effects."""
