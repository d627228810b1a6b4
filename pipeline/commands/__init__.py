"""The console script `dynamics`: a module for each subcommand, and what they share."""

import os

# Before anything imports numpy, as in stages/__init__.py: two BLAS threads slow the search's small matrices down.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
