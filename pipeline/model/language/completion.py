"""What the model writes: `<think>` with the events, `<answer>` with the scene as YAML.

One grammar generates exactly these texts; every text it generates is a scene that `read_scene` reads.
"""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.clips.events import Event
from pipeline.errors import SceneError
from pipeline.model.language.grammar import Choice, Grammar, Literal, Number, spell
from pipeline.scene.canonical import DECIMALS
from pipeline.scene.scene import BASIC_SHAPES, SIZE_KEYS, Scene, SceneObject
from pipeline.scene.text import read_scene

MAX_OBJECTS = 6
MAX_EVENTS = 24  # the grammar ends `<think>` then, so that a model which has learned little stops too

PROMPT = (
    "The video is the optical flow of rigid bodies that move on a plane. Describe what happens, then write the "
    "scene as YAML: camera, gravity, and for each object its shape, size, mass, friction, damping, position, "
    "velocity, angular velocity and orientation."
)


def _number(key: str, low: float, high: float) -> Number:
    return Number(DECIMALS[key], low, high)


HEIGHT = _number("camera.height", 0.05, 9.99)
PITCH, FOV = _number("camera.pitch", -89, 89), _number("camera.fov", 5, 99)
GRAVITY = _number("gravity", 0, 50)
SIZE = _number("size", 0.01, 3)
MATERIAL: dict[str, Number] = {
    "mass": _number("mass", 0.01, 99),
    "sliding_friction": _number("sliding_friction", 0, 5),
    "rolling_friction": _number("rolling_friction", 0, 0.5),
    "damping": _number("damping", 0.01, 5),
}
VECTORS: dict[str, Number] = {
    "position": _number("position", -9.999, 9.999),
    "velocity": _number("velocity", -20, 20),
    "angular_velocity": _number("angular_velocity", -99, 99),
}
#: A canonical orientation has its real part largest, so that zero length cannot be written.
REAL_PART, IMAGINARY_PART = _number("orientation", 0.5, 1), _number("orientation", -1, 1)
ANGLE_FREE = {"sphere": 0, "cylinder": 2, "box": 3}  # imaginary parts that are not zero by symmetry

EVENT_PHRASES: dict[str, str] = {
    "hits_object": " hits object ",
    "hits_ground": " hits the ground",
    "enters": " enters the view",
    "leaves": " leaves the view",
    "starts_rolling": " starts rolling",
    "stops_rolling": " stops rolling",
    "starts_sliding": " starts sliding",
    "stops_sliding": " stops sliding",
}
PHRASE_KINDS = {phrase: kind for kind, phrase in EVENT_PHRASES.items()}
_COUNTS = tuple(f"{n} object: " if n == 1 else f"{n} objects: " for n in range(1, MAX_OBJECTS + 1))
_END_OF_ANSWER = "effects: []\n</answer>"
_END_OF_THINK = ".\n</think>\n<answer>\n"


def completion_grammar(reasoning: bool, seconds: float) -> Grammar:
    """All completions. With reasoning the shapes are named first, and the answer keeps to them."""
    shapes: list[str] | None = None
    if reasoning:
        yield Literal("<think>\n")
        count = _COUNTS.index((yield Choice(_COUNTS))) + 1
        shapes = []
        for i in range(count):
            if i:
                yield Literal(", ")
            shapes.append((yield Choice(BASIC_SHAPES)))
        yield from _events(count, seconds)
    else:
        yield Literal("<answer>\n")
    yield from _scene(shapes)


def _events(objects: int, seconds: float) -> Grammar:
    names = tuple(str(i + 1) for i in range(objects))
    kinds = tuple(p for k, p in EVENT_PHRASES.items() if objects > 1 or k != "hits_object")
    earliest = 0.0
    for _ in range(MAX_EVENTS):
        if (yield Choice((_END_OF_THINK, ".\nt="))) == _END_OF_THINK:
            return
        earliest = float((yield Number(2, earliest, seconds)))
        yield Literal("s: object ")
        first = yield Choice(names)
        phrase = yield Choice(kinds)
        if PHRASE_KINDS[phrase] == "hits_object":
            yield Choice(tuple(n for n in names if n != first))
    yield Literal(_END_OF_THINK)


def _scene(shapes: list[str] | None) -> Grammar:
    yield Literal("camera: {position: [0, -2, ")
    yield HEIGHT
    yield Literal("], pitch: ")
    yield PITCH
    yield Literal(", fov: ")
    yield FOV
    yield Literal("}\ngravity: ")
    yield GRAVITY
    yield Literal("\nground: {height: 0.0}\nobjects:\n- shape: ")
    written = 0
    while True:
        if shapes is not None:
            shape = shapes[written]
            yield Literal(shape)
        else:
            shape = yield Choice(BASIC_SHAPES)
        yield from _object(shape)
        written += 1
        if written == (MAX_OBJECTS if shapes is None else len(shapes)):
            yield Literal(_END_OF_ANSWER)
            return
        if shapes is not None:
            yield Literal("- shape: ")
        elif (yield Choice(("- shape: ", _END_OF_ANSWER))) == _END_OF_ANSWER:
            return


def _object(shape: str) -> Grammar:
    for key in SIZE_KEYS[shape]:
        yield Literal(f"\n  {key}: ")
        yield SIZE
    for key, number in MATERIAL.items():
        yield Literal(f"\n  {key}: ")
        yield number
    close = "\n"
    for key, number in VECTORS.items():
        yield Literal(f"{close}  {key}: [")
        yield number
        yield Literal(", ")
        yield number
        yield Literal(", ")
        yield number
        close = "]\n"
    free = ANGLE_FREE[shape]
    if not free:
        yield Literal("]\n  orientation: [1.000, 0.000, 0.000, 0.000]\n")
        return
    yield Literal("]\n  orientation: [")
    yield REAL_PART
    for _ in range(free):
        yield Literal(", ")
        yield IMAGINARY_PART
    yield Literal(", 0.000" * (3 - free) + "]\n")


def _object_values(obj: SceneObject) -> list[float]:
    values = [*obj.size, *(getattr(obj, key) for key in MATERIAL)]
    for key in VECTORS:
        values += getattr(obj, key)
    free = ANGLE_FREE[obj.shape]
    return values + list(obj.orientation[: 1 + free] if free else ())


def write_completion(scene: Scene, events: list[Event] | None, seconds: float) -> str:
    """The completion for a scene of basic shapes in canonical form; events=None leaves reasoning out.

    Raises SceneError for fixed bodies and hollow objects, which answers do not have.
    """
    assert scene.camera is not None
    assert scene.camera.pitch is not None
    if scene.fixed:
        raise SceneError("fixed: an answer of the model has none; valid: a scene without fixed bodies")
    if any(o.hollow for o in scene.objects):
        raise SceneError("objects: hollow: an answer of the model has none; valid: solid objects")
    values: list[str | float] = []
    if events is not None:
        values += [_COUNTS[len(scene.objects) - 1], *scene.shapes]
        for event in events:
            values += [".\nt=", event.time, str(event.first + 1), EVENT_PHRASES[event.kind]]
            if event.second is not None:
                values.append(str(event.second + 1))
        if len(events) < MAX_EVENTS:
            values.append(_END_OF_THINK)
    values += [scene.camera.position[2], scene.camera.pitch, scene.camera.fov, -scene.gravity[2]]
    for i, obj in enumerate(scene.objects):
        if events is None:
            values += ["- shape: "] * bool(i) + [obj.shape]
        values += _object_values(obj)
    if events is None and len(scene.objects) < MAX_OBJECTS:
        values.append(_END_OF_ANSWER)
    return spell(completion_grammar(events is not None, seconds), values)


def think_text(scene: Scene, events: list[Event], seconds: float) -> str:
    """The words between the tags of `<think>`, also for scenes that no answer of the model describes."""
    lines = [f"{_COUNTS[len(scene.objects) - 1]}{', '.join(scene.shapes)}."]
    for event in events:
        lines.append(f"t={min(event.time, seconds):.2f}s: object {event.first + 1}{event_phrase(event, scene)}.")
    return "\n".join(lines)


def event_phrase(event: Event, scene: Scene) -> str:
    """An event in words, without its subject: ` hits object 2`, ` hits ramp`."""
    if event.kind == "hits_fixed":
        assert event.second is not None
        return f" hits {scene.fixed[event.second].name}"
    return EVENT_PHRASES[event.kind] + ("" if event.second is None else str(event.second + 1))


@dataclass(frozen=True)
class Completion:
    """A parsed completion: the words of `<think>`, empty where there are none, and the scene."""

    think: str
    scene: Scene


def read_completion(text: str) -> Completion:
    """The parsed completion. Raises `SceneError` where the answer is no scene."""
    think, _, answer = text.rpartition("<answer>\n")
    think = think.removeprefix("<think>\n").removesuffix("</think>\n").strip()
    return Completion(think, read_scene(answer.removesuffix("</answer>"), "answer"))
