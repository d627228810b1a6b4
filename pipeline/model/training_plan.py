"""How a model is trained: steps, batches, checkpoints."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrainingPlan:
    """steps: None for what `epochs` take. lora_rank 0 trains all weights. checkpoint_steps between checkpoints.
    processes: that train together (`pipeline.model.processes`), each on its share of every batch."""

    steps: int | None
    epochs: float
    batch_size: int
    learning_rate: float
    lora_rank: int
    checkpoint_steps: int
    seed: int
    processes: int = 1
