"""How the pictures are made that a model is shown: the record in its checkpoint, model_input.json."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from pipeline.errors import ModelError
from pipeline.untrusted import read_json

INPUT_FILE = "model_input.json"
CROP_SIDE = 56  # px, of a body's crop for a model with a tokenizer: two by two tokens of Qwen2.5-VL


@dataclass(frozen=True)
class ModelInput:
    """How a model's input is made, as it was trained: model_input.json. The pictures' size and number are in
    clip_layout.json.

    Attributes:
        input: What is shown: "flow", or the frames themselves ("rgb"); "any": either, as it is asked.
        picture: How flow becomes a picture: "channels" or "wheel"; None for "rgb", and for models that take numbers.
        flow_source: Where the flow in training came from: "exact" (with noise like RAFT's), "raft" or "dis"; None for
            "rgb". A model of exact flow may be shown measured flow; one of measured flow is shown that alone.
        flow_size: px, width and height, at which flow is estimated from frames; None for "rgb".
        flow_iterations: Of RAFT; None for "rgb".
        reasoning: Whether the model writes `<think>` before `<answer>`; "any": as it is asked.
        sees: Whole frames ("frame"), or each body by itself ("bodies"): crops of it, and its place as numbers; "any".
    """

    input: str
    picture: str | None
    flow_source: str | None
    flow_size: tuple[int, int] | None
    flow_iterations: int | None
    reasoning: bool | str
    sees: str = "frame"

    def __post_init__(self) -> None:
        _check_value("input", self.input, tuple(_VALID["input"]))
        has_flow = self.input != "rgb"
        _check_value("picture", self.picture, (*_VALID["picture"], None) if self.input == "flow" else (None,))
        _check_value("flow_source", self.flow_source, _VALID["flow_source"] if has_flow else (None,))
        numbers = [*(self.flow_size or ()), self.flow_iterations]
        if has_flow and not (len(numbers) == 3 and all(isinstance(n, int) and n > 0 for n in numbers)):
            raise ModelError(
                f"`flow_size` is {self.flow_size} and `flow_iterations` {self.flow_iterations}; valid: [width, height] "
                "in px and a number of iterations"
            )
        _check_value("reasoning", self.reasoning, (True, False, ANY))
        _check_value("sees", self.sees, _VALID["sees"])

    @classmethod
    def of(
        cls,
        input: str,
        picture: str | None,
        flow_source: str,
        flow_size: tuple[int, int],
        flow_iterations: int,
        reasoning: bool,
        sees: str = "frame",
    ) -> ModelInput:
        """From settings in which those of flow are given whatever the input is."""
        if input == "rgb":
            return cls(input, None, None, None, None, reasoning, sees)
        return cls(input, picture, flow_source, flow_size, flow_iterations, reasoning, sees)

    @property
    def asked(self) -> ModelInput:
        """With the usual choice wherever any is possible: each body by itself, by flow, with reasoning."""
        return replace(
            self,
            input="flow" if self.input == ANY else self.input,
            sees="bodies" if self.sees == ANY else self.sees,
            reasoning=True if self.reasoning == ANY else self.reasoning,
        )

    def check(self, name: str, given: object, parameter: str, checkpoint: str) -> None:
        """Raise ModelError where a setting contradicts what the checkpoint was trained with.

        Args:
            name: Of the field.
            given: The setting's value.
            parameter: What the user calls it: `flow.picture`, `--flow`.
            checkpoint: Its name or folder.
        """
        own = getattr(self, name)
        if own == ANY or (self.input == ANY and name == "picture"):
            return
        if name == "flow_source" and own == "exact":
            return
        if given != own:
            raise ModelError(
                f"{parameter} is {_shown(given)}, but {checkpoint} was trained with {name} {_shown(own)} "
                f"({INPUT_FILE}); valid: {_shown(own)}"
            )


ANY = "any"
_VALID: dict[str, tuple[str, ...]] = {
    "input": ("flow", "rgb", ANY),
    "sees": ("frame", "bodies", ANY),
    "picture": ("channels", "wheel"),
    "flow_source": ("exact", "raft", "dis"),
}


def _shown(value: object) -> str:
    return json.dumps(value)


def _check_value(name: str, value: object, valid: tuple[object, ...]) -> None:
    if value not in valid:
        raise ModelError(f"`{name}` is {_shown(value)}; valid: {', '.join(map(_shown, valid))}")


def read_input(name: str) -> ModelInput | None:
    """How the checkpoint's input is made; None where it has not recorded that. Raises `ModelError` for a bad record."""
    file = Path(name) / INPUT_FILE
    if not file.is_file():
        return None
    try:
        stored = read_json(file, ModelError)
        size = stored["flow_size"]
        return ModelInput(**stored | {"flow_size": None if size is None else tuple(size)})
    except ModelError as error:
        raise ModelError(f"{file}: {error}") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        keys = ", ".join(f.name for f in fields(ModelInput))
        raise ModelError(f"{file} cannot be used ({error}); valid: an object with {keys}") from None


def is_words(name: str) -> bool:
    """Whether a folder has a checkpoint of the words model, by its config.json."""
    file = Path(name) / "config.json"
    try:
        return file.is_file() and read_json(file, ModelError).get("model_type") == "words"
    except ModelError:
        return False


def write_input(folder: Path, model_input: ModelInput) -> None:
    (folder / INPUT_FILE).write_text(json.dumps(asdict(model_input), indent=1) + "\n")


def missing_input(name: str) -> ModelError:
    """The error for a checkpoint whose model has to be shown something, and that has not recorded what."""
    example = ModelInput(
        input="flow", picture="channels", flow_source="exact", flow_size=(240, 160), flow_iterations=4, reasoning=True
    )
    return ModelError(
        f"{name!r} has no {INPUT_FILE}, so it is not known what it was trained to see. Write into that file how its "
        f"input was made, as {json.dumps(asdict(example))}, or tune it again: the stage `finetune` writes it"
    )
