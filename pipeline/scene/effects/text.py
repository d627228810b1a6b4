"""Effects in a scene's YAML, read with one error for each fault."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from pipeline.errors import SceneError, did_you_mean
from pipeline.scene.effects.kind import EffectKind, Parameter, local_kind
from pipeline.scene.effects.region import LIMITS, Region
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect


def effect_from_dict(entry: Any, index: int, names: Sequence[str], source: str) -> Effect:
    """The effect that an entry of `effects` describes. Raises `SceneError` that names the place.

    Args:
        entry: Parsed YAML.
        index: Of the entry.
        names: Of the scene's objects.
        source: What the YAML was read from, for errors.
    """
    place = f"{source}: effects[{index}]"
    if not isinstance(entry, dict):
        raise SceneError(f"{place}: must be a mapping with a name and its parameters, not {entry!r}")
    kind = effect_kinds().get(entry.get("name"))  # type: ignore[arg-type]
    if kind is None:
        name, valid_names = entry.get("name"), effect_kinds()
        hint = did_you_mean(name, valid_names)
        raise SceneError(f"{place}.name: unknown effect {name!r}{hint}; valid: {', '.join(valid_names)}")
    valid = ["name", *(p.name for p in kind.parameters), "objects"]
    valid += ["object"] * (kind.kick is not None) + ["only"] * (kind.may_be_local or kind.kick is not None)
    for key in entry:
        if key not in valid:
            hint = did_you_mean(key, valid)
            raise SceneError(f"{place}.{key}: unknown key{hint}; valid keys of {kind.name}: {', '.join(valid)}")
    for parameter in kind.parameters:
        if parameter.name not in entry:
            needed = ", ".join(f"{p.name} ({p.unit})" for p in kind.parameters)
            raise SceneError(f"{place}.{parameter.name}: missing key; needed by {kind.name}: {needed}")
    values = tuple((p.name, _value(entry[p.name], p, f"{place}.{p.name}")) for p in kind.parameters)
    only = None if entry.get("only") is None else _region(entry["only"], f"{place}.only")
    if only is not None and only.edges and not kind.may_be_local:
        raise SceneError(f"{place}.only: {kind.name} has a time of its own; valid: clips")
    return Effect(kind.name, values, _objects(entry, names, place), only)


BALL = (Parameter("center", "m", length=3), Parameter("radius", "m", low=0.0))
PLANE = (Parameter("normal", "-", length=3), Parameter("offset", "m"))


def _region(entry: Any, place: str) -> Region:
    """Where an effect acts: the conditions that hold together."""
    valid = [*LIMITS, "within", "beyond", "clips"]
    if not isinstance(entry, dict) or not entry:
        raise SceneError(f"{place}: must be a mapping of conditions, not {entry!r}; valid: {', '.join(valid)}")
    for key in entry:
        if key not in valid:
            hint = did_you_mean(key, valid)
            raise SceneError(f"{place}.{key}: unknown condition{hint}; valid: {', '.join(valid)}")
    found: dict[str, Any] = {
        k: _number(entry[k], Parameter(k, u), f"{place}.{k}") for k, u in LIMITS.items() if k in entry
    }
    for key, parts in (("within", BALL), ("beyond", PLANE)):
        if key not in entry:
            continue
        keys = " and ".join(p.name for p in parts)
        if not isinstance(entry[key], dict) or set(entry[key]) != {p.name for p in parts}:
            raise SceneError(f"{place}.{key}: must have the keys {keys}, not {entry[key]!r}")
        found[key] = {p.name: _value(entry[key][p.name], p, f"{place}.{key}.{p.name}") for p in parts}
    if "clips" in entry:
        clips = entry["clips"]
        if not isinstance(clips, list) or not clips or not all(isinstance(c, str) for c in clips):
            raise SceneError(f"{place}.clips: must be a list of names of recordings, not {clips!r}")
        found["clips"] = clips
    return Region.of(found)


def _value(value: Any, parameter: Parameter, place: str) -> float | tuple[float, ...]:
    if parameter.length == 1:
        return _number(value, parameter, place)
    if not isinstance(value, list) or len(value) != parameter.length:
        raise SceneError(f"{place}: valid: a list of {parameter.length} numbers ({parameter.unit}), not {value!r}")
    return tuple(_number(v, parameter, f"{place}[{i}]") for i, v in enumerate(value))


def _number(value: Any, parameter: Parameter, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise SceneError(f"{place}: must be a finite number ({parameter.unit}), not {value!r}")
    if not parameter.low <= value <= parameter.high:
        bounds = f"from {parameter.low:g} to {parameter.high:g}".replace("to inf", "upwards").replace("-inf", "below")
        raise SceneError(f"{place}: {value:g} is out of range; valid: {bounds} ({parameter.unit})")
    return float(value)


def _objects(entry: dict[str, Any], names: Sequence[str], place: str) -> tuple[str, ...] | None:
    """The objects that the effect acts on; None: all. `object` (of a blow) is short for a list of one."""
    key = "object" if "object" in entry else "objects"
    if entry.get(key) is None:
        return None
    listed = [entry[key]] if key == "object" else entry[key]
    if not isinstance(listed, list) or not listed:
        raise SceneError(f"{place}.{key}: must be a list of names of objects, not {listed!r}")
    for i, name in enumerate(listed):
        if name not in names:
            where = f"{place}.object" if key == "object" else f"{place}.objects[{i}]"
            raise SceneError(f"{where}: there is no object {name!r}; valid: {', '.join(names)}")
    return tuple(listed)


def effect_kind(effect: Effect) -> EffectKind:
    """The kind of a scene's effect, which acts where the effect does."""
    kind = effect_kinds()[effect.name]
    return kind if effect.only is None else local_kind(kind, effect.only)
