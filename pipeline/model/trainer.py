"""The training loop of all models: the Hugging Face Trainer with an objective of ours.

All weights, or low-rank adapters (LoRA). An interrupted run goes on from its last checkpoint.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import torch
from peft import LoraConfig, PeftModel, get_peft_model
from torch.utils.data import DataLoader, Dataset
from transformers import PreTrainedModel, Trainer, TrainerCallback, TrainingArguments

from pipeline.model.checkpoint import load_weights
from pipeline.model.processes import average_gradients, is_first, mean_of_all, process_count, wait_for_all
from pipeline.model.training_plan import TrainingPlan
from pipeline.shards.content_hash import hash_files

STATE_FILE = "trainer_state.json"
HASHES_FILE = "hashes.json"  # SHA-256 of the other files of a checkpoint, written last
LORA_TARGETS = ("q_proj", "k_proj", "v_proj", "o_proj", "gate_proj", "up_proj", "down_proj", "qkv", "proj")

Row = TypeVar("Row")
Collate = Callable[[Sequence[Any]], Any]
Objective = Callable[[Any], tuple[torch.Tensor, Mapping[str, float]]]
Report = Callable[[dict[str, Any]], None]


class ClipDataset(Dataset, Generic[Row]):
    """So many clips, each as what `read` gives for its index."""

    def __init__(self, length: int, read: Callable[[int], Row]) -> None:
        self._length, self._read = length, read

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> Row:
        return self._read(index)


class HasModel(Protocol):
    """What is trained: a `Base`, or another holder of a pre-trained model of transformers."""

    model: Any


class _Trainer(Trainer):
    """The Trainer with our objective, whose measures stand beside the loss in the log."""

    base: HasModel
    objective: Objective
    measured: dict[str, list[float]]

    def compute_loss(
        self, model: Any, inputs: dict, return_outputs: bool = False, num_items_in_batch: Any = None
    ) -> Any:
        loss, measures = self.objective(inputs["batch"])
        for name, value in measures.items():
            self.measured[name].append(value)
        return (loss, {"loss": loss.detach()}) if return_outputs else loss

    def training_step(self, model: Any, inputs: dict, num_items_in_batch: Any = None) -> torch.Tensor:
        """As the Trainer; `compute_loss` goes past the wrapper of `model` that would average the gradients."""
        loss = super().training_step(model, inputs, num_items_in_batch)
        assert self.model is not None
        average_gradients(self.model)
        return loss

    def get_eval_dataloader(self, eval_dataset: Any = None) -> DataLoader:
        """As the Trainer; of several processes each goes through all, so that the batches are those of one."""
        if process_count() == 1:
            return super().get_eval_dataloader(eval_dataset)
        assert isinstance(self.eval_dataset, Dataset)
        return DataLoader(self.eval_dataset, self.args.per_device_eval_batch_size, collate_fn=self.data_collator)

    def prediction_step(
        self, model: Any, inputs: dict[str, Any], prediction_loss_only: bool, ignore_keys: list[str] | None = None
    ) -> Any:
        with torch.no_grad():
            loss, _ = self.objective(inputs["batch"])
        return loss.detach(), None, None

    def log(self, logs: dict[str, float], start_time: float | None = None) -> None:
        """As the Trainer, with the means of the measures since the last row of the loss."""
        if "loss" in logs:
            logs |= mean_of_all({name: float(np.mean(values)) for name, values in self.measured.items()})
            self.measured.clear()
        super().log(logs, start_time)

    def _load_from_checkpoint(self, resume_from_checkpoint: str, model: Any = None) -> None:
        """As the Trainer, but for whole models under the names of the file, which are not those of the module."""
        if not isinstance(self.model, PreTrainedModel) or isinstance(self.model, PeftModel):
            super()._load_from_checkpoint(resume_from_checkpoint, model)
            return
        stored = load_weights(type(self.base.model), resume_from_checkpoint, dtype=self.base.model.dtype)
        self.base.model.load_state_dict(stored.state_dict())


class _Report(TrainerCallback):
    def __init__(self, report: Report) -> None:
        self._report = report

    def on_log(self, args: Any, state: Any, control: Any, logs: dict | None = None, **_: Any) -> None:
        self._report({"step": state.global_step, **(logs or {})})


def train(
    base: HasModel,
    rows: Dataset,
    collate: Collate,
    objective: Objective,
    plan: TrainingPlan,
    work: Path,
    report: Report,
    held_out: Dataset | None = None,
) -> None:
    """Train `base` in place to lower the objective of batches of `rows`, which `collate` makes.

    objective: a batch's loss, and what else of it the log shall have. Checkpoints go to `work`, from the last of which
    an interrupted run goes on. report: called with each row of the log (step, loss and measures, or eval_loss on
    held_out), those from before an interruption too.
    """
    last = last_checkpoint(work)
    whole = base.model
    if plan.lora_rank:
        config = LoraConfig(r=plan.lora_rank, lora_alpha=2 * plan.lora_rank, target_modules=list(LORA_TARGETS))
        torch.manual_seed(plan.seed)  # for the adapters' first weights
        adapted = get_peft_model(whole, config)
    arguments = TrainingArguments(
        output_dir=str(work),
        max_steps=plan.steps if plan.steps is not None else -1,
        num_train_epochs=plan.epochs,
        per_device_train_batch_size=plan.batch_size // plan.processes,
        per_device_eval_batch_size=plan.batch_size,
        learning_rate=plan.learning_rate,
        lr_scheduler_type="cosine",
        warmup_steps=0.05,
        weight_decay=0.01,
        logging_steps=max(1, plan.checkpoint_steps // 4),
        eval_strategy="steps" if held_out is not None else "no",
        eval_steps=plan.checkpoint_steps,
        eval_on_start=held_out is not None and last is None,
        save_strategy="steps",
        save_steps=plan.checkpoint_steps,
        save_total_limit=2,
        remove_unused_columns=False,
        label_names=[],
        seed=plan.seed,
        data_seed=plan.seed,
        report_to=[],
        disable_tqdm=None,
        bf16=getattr(base.model, "dtype", None) == torch.bfloat16 and torch.cuda.is_available(),
        use_cpu=not torch.cuda.is_available(),
        dataloader_pin_memory=torch.cuda.is_available(),
    )
    trainer = _Trainer(
        model=adapted if plan.lora_rank else whole,
        args=arguments,
        train_dataset=rows,
        eval_dataset=held_out,
        data_collator=lambda members: {"batch": collate(members)},
        callbacks=[_Report(report), _Hash()],
    )
    trainer.base, trainer.objective, trainer.measured = base, objective, defaultdict(list)
    if last is not None:
        for row in json.loads((last / STATE_FILE).read_text())["log_history"]:
            report(row)
    trainer.train(resume_from_checkpoint=None if last is None else str(last))
    if plan.lora_rank:
        base.model = adapted.merge_and_unload()
    base.model.eval()


class _Hash(TrainerCallback):
    """Writes the hashes of a checkpoint's files when all are written."""

    def on_save(self, args: Any, state: Any, control: Any, **_: Any) -> None:
        wait_for_all()
        if is_first():
            write_hashes(Path(args.output_dir) / f"checkpoint-{state.global_step}")
        wait_for_all()


def write_hashes(checkpoint: Path) -> None:
    """Write down the SHA-256 of a complete checkpoint's files."""
    text = json.dumps(hash_files(checkpoint), indent=1) + "\n"
    temporary = checkpoint / f"{HASHES_FILE}.part"
    temporary.write_text(text)
    temporary.replace(checkpoint / HASHES_FILE)


def last_checkpoint(work: Path) -> Path | None:
    """The newest checkpoint in `work` that was written to its end and whose files have the hashes that they had."""
    newest_first = sorted(work.glob("checkpoint-*"), key=lambda folder: int(folder.name.split("-")[1]), reverse=True)
    return next(filter(_is_sound, newest_first), None)


def _is_sound(checkpoint: Path) -> bool:
    try:
        expected = json.loads((checkpoint / HASHES_FILE).read_bytes())
        found = hash_files(checkpoint)
    except (OSError, ValueError, RecursionError):
        return False
    found.pop(HASHES_FILE, None)
    return bool(expected) and found == expected
