"""Reading a YAML 1.2 file of parameters into pydantic models, with errors that name the key and what is valid."""

import json
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from pipeline.errors import ParamsError, did_you_mean
from pipeline.untrusted import parse_yaml, read_text


class Section(BaseModel):
    """A section of the file: every key is required unless it has a default, and no other is allowed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, protected_namespaces=(), allow_inf_nan=False)


Model = TypeVar("Model", bound=Section)


def read_params_file(path: Path, model: type[Model]) -> Model:
    """Read and check the whole file. Raises ParamsError for the first thing that is wrong with it."""
    if not path.exists():
        raise ParamsError(f"{path} is missing: run in the folder of the repository")
    data = parse_yaml(read_text(path, ParamsError), str(path), ParamsError)
    if not isinstance(data, dict):
        raise ParamsError(f"{path} must have the sections {', '.join(model.model_fields)}")
    try:
        # As JSON, where strict means what a reader of YAML expects: a list is a tuple, "1" is no number.
        return model.model_validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        problems = error.errors(include_url=False)
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise ParamsError(f"{path}: {_sentence(problems[0], model)}{more}") from None


def _sentence(problem: ErrorDetails, model: type[Section]) -> str:
    *above, last = problem["loc"] or ("",)
    name = key_path(problem["loc"])
    valid = _fields_at(model, tuple(above))
    match problem["type"]:
        case "extra_forbidden":
            return f"`{name}` is not a parameter{did_you_mean(last, valid)}; valid here: {', '.join(valid)}"
        case "missing":
            return f"`{name}` is missing"
        case _:
            message = problem["msg"][0].lower() + problem["msg"][1:]
            return f"`{name}` is {json.dumps(problem['input'])}: {message}"


def key_path(location: tuple[int | str, ...]) -> str:
    """`suites.train.objects[1]` for ("suites", "train", "objects", 1)."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).removeprefix(".")


def _fields_at(model: Any, location: tuple[int | str, ...]) -> list[str]:
    """The keys that are valid at a place of a model; none where it is no section."""
    kinds = [model]
    for part in location:
        kinds = [inner for kind in kinds for inner in _inside(kind, part)]
    return sorted({field for kind in _flattened(kinds) if _is_section(kind) for field in kind.model_fields})


def _inside(kind: Any, part: int | str) -> list[Any]:
    inner: list[Any] = []
    for option in _flattened([kind]):
        if _is_section(option):
            inner += [option.model_fields[part].annotation] if part in option.model_fields else []
            inner += [option] if option.__name__ == part else []  # pydantic names the member of a union
        else:
            inner += typing.get_args(option)[-1:]  # dict[str, X], list[X]
    return inner


def _flattened(kinds: list[Any]) -> list[Any]:
    """The members of unions and what is annotated, instead of these."""
    flat: list[Any] = []
    for kind in kinds:
        if typing.get_origin(kind) in (typing.Union, types.UnionType):
            flat += _flattened(list(typing.get_args(kind)))
        elif typing.get_origin(kind) is typing.Annotated:
            flat += _flattened([typing.get_args(kind)[0]])
        else:
            flat.append(kind)
    return flat


def _is_section(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)
