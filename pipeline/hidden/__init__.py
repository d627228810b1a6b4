"""Worlds with hidden effects, which discovery is tested on. Discovery imports none of it."""
