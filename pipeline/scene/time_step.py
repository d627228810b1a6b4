"""The time step of every simulation."""

STEPS_PER_SECOND = 240
