"""Measurements; each module opens with the command that repeats it."""

import stages  # noqa: F401  limits the threads of BLAS, which must come before numpy
