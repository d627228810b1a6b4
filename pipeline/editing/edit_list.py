"""Edits of a clip: a list of changes of its scene, each with the time from which it holds (docs/editing.md)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from pipeline.errors import SceneError, did_you_mean
from pipeline.untrusted import parse_yaml, read_text

Colour = tuple[int, int, int]
_VALID = "one of `set` (with `value`), `remove` and `add`"


@dataclass(frozen=True)
class Edit:
    """One change of a scene; it has one of `set`, `remove` and `add`.

    Attributes:
        at: s of the clip, from which on it holds.
        set: `path=value`, as `dynamics simulate --set` takes it.
        remove: Name of an object.
        add: An object as the text of a scene has it, and `colour`, [R, G, B] from 0 to 255, if it shall have a certain
            one.
    """

    at: float
    set: str | None = None
    remove: str | None = None
    add: dict[str, Any] | None = None

    def __str__(self) -> str:
        if self.set is not None:
            what = f"set {self.set}"
        else:
            what = f"remove {self.remove}" if self.add is None else f"add {self.add.get('name', 'an object')}"
        return f"{what} at {self.at:g} s"

    def record(self) -> dict[str, Any]:
        """The edit for result.json."""
        kinds = {"set": self.set, "remove": self.remove, "add": self.add}
        return {"at": self.at} | {kind: value for kind, value in kinds.items() if value is not None}


class EditText(BaseModel):
    """One entry of a list of edits."""

    model_config = ConfigDict(extra="forbid")

    at: Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)] = Field(
        0.0, description="s of the clip, from which on the edit holds"
    )
    set: str | None = Field(None, description="path of a number of the scene, as objects[0].mass")
    value: Any = Field(None, description="what is set there: a number or a list of numbers")
    remove: str | None = Field(None, description="name of an object that is taken away")
    add: dict[str, Any] | None = Field(
        None, description="an object as in a scene (docs/formats.md), and its colour, [R, G, B] from 0 to 255"
    )

    @model_validator(mode="after")
    def _one(self) -> EditText:
        if sum(v is not None for v in (self.set, self.remove, self.add)) != 1:
            raise PydanticCustomError("edit", f"an edit has {_VALID}")
        if (self.set is None) != ("value" not in self.model_fields_set):
            raise PydanticCustomError("edit", "`set` and `value` belong together")
        return self


class EditsText(BaseModel):
    """A file of edits."""

    model_config = ConfigDict(extra="forbid", title="edits of a clip")

    edits: list[EditText]


def edits_schema() -> dict[str, Any]:
    """The JSON schema of a file of edits."""
    return EditsText.model_json_schema()


def read_edits(path: Path) -> list[Edit]:
    """The edits of a YAML file. Raises SceneError, which names the place of the first fault."""
    data = _yaml(path)
    try:
        parsed = EditsText.model_validate(data)
    except ValidationError as error:
        faults = error.errors()
        # A misspelt key is reported first: it is also the cause of a missing one.
        fault = next((f for f in faults if f["type"] == "extra_forbidden"), faults[0])
        place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in fault["loc"]).removeprefix(".")
        hint = ""
        if fault["type"] == "extra_forbidden":
            valid = EditText.model_fields if len(fault["loc"]) > 1 else EditsText.model_fields
            hint = f"{did_you_mean(fault['loc'][-1], valid)}; valid: {', '.join(valid)}"
        raise SceneError(f"{path}: {place or 'edits'}: {fault['msg'].lower()}{hint}") from None
    return [
        Edit(e.at, None if e.set is None else f"{e.set}={json.dumps(e.value)}", e.remove, e.add) for e in parsed.edits
    ]


def read_object(path: Path) -> dict[str, Any]:
    """The object of a YAML file, as the text of a scene has one. Raises SceneError."""
    data = _yaml(path)
    if not isinstance(data, dict) or "shape" not in data:
        raise SceneError(f"{path}: an object is expected, as in a scene's `objects`: a mapping with shape, sizes, …")
    return data


def added_object(edit: Edit) -> tuple[dict[str, Any], Colour | None]:
    """The object that an edit adds, as in the text of a scene, and its colour. Raises SceneError for another colour."""
    assert edit.add is not None
    obj = {key: value for key, value in edit.add.items() if key != "colour"}
    colour = edit.add.get("colour")
    if colour is None:
        return obj, None
    whole = isinstance(colour, list) and len(colour) == 3 and all(type(v) is int and 0 <= v <= 255 for v in colour)
    if not whole:
        raise SceneError(f"{edit}: colour: {colour!r}; valid: [R, G, B], three whole numbers from 0 to 255")
    return obj, (colour[0], colour[1], colour[2])


def in_order(edits: Sequence[Edit], seconds: float, what: str = "the clip") -> list[Edit]:
    """Edits by time; those of one time in their own order. Raises SceneError for one outside of `what`."""
    for edit in edits:
        if not 0 <= edit.at < seconds:
            raise SceneError(f"{edit}: {what} is {seconds:g} s long; valid: 0 to less than {seconds:g}")
    return sorted(edits, key=lambda e: e.at)


def _yaml(path: Path) -> Any:
    return parse_yaml(read_text(path, SceneError), str(path), SceneError)
