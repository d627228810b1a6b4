"""The Python interface: `from pipeline import infer, simulate, discover`. The command `dynamics` calls the same."""

import os

# Before anything imports numpy, as in pipeline/commands/__init__.py: a search gives the same digits from both.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
