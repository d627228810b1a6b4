"""One module per DVC stage."""

import os

# Before anything imports numpy: one BLAS thread here as in a worker, so that the bytes do not depend on where a
# shard was computed. torch and numba are limited by `pipeline.shards.numeric_threads`.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
