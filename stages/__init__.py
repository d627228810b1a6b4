"""One module per DVC stage."""

import os

# Before numpy is imported: one BLAS thread in this process as in a worker, so that results do not depend on the process
# that computes them. While a shard is computed, `pipeline.shards.numeric_threads` limits all libraries.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# OpenMP threads that wait for each other sleep. By default they spin, and a small network is ten times slower where
# other programs keep the cores busy.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
