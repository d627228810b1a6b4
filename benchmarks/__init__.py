"""Measurements that anyone can repeat; each module says how."""

import stages  # noqa: F401  it limits BLAS, which must come before numpy
