"""Worlds with something hidden in them: who makes the measurements that discovery is tried on. Discovery imports
none of it."""
