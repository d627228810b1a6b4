"""One module per DVC stage."""

import os

# Before numpy is imported: one BLAS thread in this process as in a worker, so that results do not depend on the process
# that computes them. While a shard is computed, `pipeline.shards.numeric_threads` limits all libraries.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
