"""Video in, editable physics out: the library behind the stages and the `dynamics` command."""

import os

# Before anything imports numpy: the search's matrices are small, and with two BLAS threads it takes half as long again.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
