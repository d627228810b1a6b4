"""result.json as a web page reads it: the entries that are shown, checked, since the file may be anybody's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError

from pipeline.api.result_folder import RESULT
from pipeline.errors import OutputError
from pipeline.untrusted import read_json

VALID = "a folder that `dynamics infer`, `dynamics edit` or `dynamics simulate` wrote"
Seconds = Annotated[float, Field(gt=0, le=3600)]


class Forecast(BaseModel):
    from_s: float
    iou: float | None
    constant_velocity_iou: float | None


class Method(BaseModel):
    method: str
    composition: str
    sequence_iou: float | None
    epe_frame_px: float | None
    simulations: int


class View(BaseModel):
    kind: str
    reason: str


class Assumed(BaseModel):
    scale: str


class Answer(BaseModel):
    source: str = Field(alias="from")
    events_of_replay: list[str]
    doubts: list[str]


class Certainty(BaseModel):
    place: str
    determined: bool


class InferResult(BaseModel):
    command: Literal["infer"]
    clip: str
    grade: Literal["good", "doubtful", "poor"]
    grade_reason: str
    forecast: Forecast | None
    methods: list[Method]
    view: View
    assumed: Assumed
    answer: Answer
    certainty: list[Certainty]


class EditResult(BaseModel):
    command: Literal["edit"]
    found: str
    edits: list[dict[str, Any]]
    pixels: dict[str, float]


class Departure(BaseModel):
    name: str
    end: float
    largest: float
    time: float


class SimulateResult(BaseModel):
    command: Literal["simulate"]
    scene: str
    set: list[str]
    seconds: Seconds
    notes: list[str]
    departures: list[Departure]


SavedResult = InferResult | EditResult | SimulateResult
_KINDS: dict[str, type[SavedResult]] = {"edit": EditResult, "infer": InferResult, "simulate": SimulateResult}


def read_result(folder: Path) -> SavedResult:
    """The result of a folder. Raises OutputError where it is none of ours, or of another version."""
    if not (folder / RESULT).is_file():
        raise OutputError(f"{folder} has no {RESULT}; valid: {VALID}")
    data = read_json(folder / RESULT, OutputError)
    kind = _KINDS.get(str(data.get("command")))
    if kind is None:
        raise OutputError(f"{folder} is of `dynamics {data.get('command')}`; valid: {VALID}")
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(map(str, fault["loc"]))
        raise OutputError(
            f"{folder / RESULT}: {place}: {fault['msg'].lower()}; this version writes it otherwise: run it again"
        ) from None
