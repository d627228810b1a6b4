"""In how many processes a stage trains."""

from pipeline.errors import ParamsError
from stages.graph.params import Params


def processes_for(params: Params, section: str) -> int:
    """`training.processes`. Raises ParamsError where the batch of the section cannot be shared equally among them."""
    processes, batch = params.training.processes, getattr(params, section).batch_size
    if batch % processes:
        raise ParamsError(
            f"`{section}.batch_size` is {batch}, and `training.processes` is {processes}; valid: a multiple of it"
        )
    return processes
