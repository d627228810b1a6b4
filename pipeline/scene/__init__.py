"""The scene language: values, YAML text, sampling and filters, MJCF."""
