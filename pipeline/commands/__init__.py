"""The console script `dynamics`: a module for each subcommand, and what they share."""

import os

# Before anything imports numpy, as in stages/__init__.py: two BLAS threads slow the search's small matrices down.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# OpenMP threads that wait for each other sleep. By default they spin, and a small network is ten times slower where
# other programs keep the cores busy.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
