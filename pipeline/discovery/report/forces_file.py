"""`augmented_forces.py`: the effects that MJCF cannot say, as a program that imports mujoco and numpy alone.

The laws in it are the functions of `scene/effects/kinds`, copied from their source; `forces.py.jinja` has the rest. A
test compares its motion with that of `pipeline.physics.simulate`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jinja2

from pipeline.discovery.report.copied_code import CopiedCode, array_text
from pipeline.physics.effect_forces import CHATTER_STEPS
from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.region import is_inside
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.mjcf_effects import effects_outside_mjcf, needs_contacts
from pipeline.scene.scene import Effect, Scene, half_extents

TEMPLATE = Path(__file__).with_name("forces.py.jinja")


def forces_file(scene: Scene) -> str | None:
    """The program beside a scene's MJCF; None where the MJCF says all effects.

    Effects of the recording are in it, too: its replay shows the motion as a recording does.
    """
    outside = effects_outside_mjcf(scene)
    kinds = [effect_kinds()[effect.name] for effect in scene.effects]
    recording = [i for i, kind in enumerate(kinds) if kind.recording is not None]
    if not scene.objects or not (outside or recording):
        return None
    code, entries = CopiedCode(), []
    for i, (effect, kind) in enumerate(zip(scene.effects, kinds, strict=True)):
        laws = {law: code.copy(function, f"{kind.name}_{law}") for law, function in _laws(kind, i in outside).items()}
        if laws:
            entries.append(_entry(scene, effect, laws))
    properties = [name for name in ("airspeed", "slip") if f"body.{name}" in code.text]
    for name in properties:
        code.copy(getattr(Body, name).fget, name)
    local = any(effect.only is not None for effect in scene.effects)
    if local:
        code.copy(is_inside, "is_inside")
    clips = any(effect.only is not None and effect.only.clips for effect in scene.effects)
    if recording:
        code.add(_recording(scene, [(i, kinds[i]) for i in recording], code))
    text = jinja2.Template(TEMPLATE.read_text(encoding="utf-8"), undefined=jinja2.StrictUndefined).render(
        names=", ".join(dict.fromkeys(scene.effects[i].name for i in sorted((*outside, *recording)))),
        bodies=repr([o.name for o in scene.objects]),
        mass=array_text([o.mass for o in scene.objects]),
        radius=array_text([0.0 if o.shape == "mesh" else half_extents(o)[2] for o in scene.objects]),
        friction=array_text([o.sliding_friction for o in scene.objects]),
        gravity=array_text(scene.gravity),
        laws=code.text,
        entries=entries,
        properties=properties,
        in_contact=any(needs_contacts(kinds[i]) for i in outside),
        steps=CHATTER_STEPS,
        local=local,
        spins="angular_velocity" in code.text or any(_lifts(effect) for effect in scene.effects),
        clips=clips,
        recording=bool(recording),
    )
    return text + "\n"


def _lifts(effect: Effect) -> bool:
    """Whether it is a force on spins that the MJCF says."""
    kind = effect_kinds()[effect.name]
    return kind.fluid is not None and kind.fluid(effect.values).lift != 0


def _laws(kind: EffectKind, outside: bool) -> dict[str, Callable[..., Any]]:
    """The functions of an effect that the program calls; what the MJCF says moves only the air or the ground."""
    laws = {"air_velocity": kind.air_velocity, "ground_velocity": kind.ground_velocity}
    if outside:
        laws |= {"force": kind.force or kind.patch_force, "torque": kind.torque}
    return {name: law for name, law in laws.items() if law is not None}


def _entry(scene: Scene, effect: Effect, laws: dict[str, str]) -> str:
    names = ", ".join(f"{law!r}: {name}" for law, name in laws.items())
    acts = [effect.objects is None or o.name in effect.objects for o in scene.objects]
    only, clips = "None", None
    if effect.only is not None:
        only, clips = f"{{{', '.join(map(_edge, effect.only.edges.items()))}}}", effect.only.clips
    return f"({{{names}}}, {_values(effect)}, {array_text(acts)}, {only}, {clips!r})"


def _edge(named: tuple[str, Any]) -> str:
    name, edge = named
    return f"{name!r}: " + (f"({array_text(edge[0])}, {edge[1]!r})" if isinstance(edge, tuple) else repr(edge))


def _recording(scene: Scene, effects: Sequence[tuple[int, EffectKind]], code: CopiedCode) -> str:
    """A function that shows true times and positions as a recording does."""
    lines = ["def recording(times, positions):"]
    for i, kind in effects:
        assert kind.recording is not None
        name = code.copy(kind.recording, f"{kind.name}_recording")
        lines.append(f"    times, positions = {name}({_values(scene.effects[i])}, times, positions)")
    return "\n".join([*lines, "    return times, positions"])


def _values(effect: Effect) -> str:
    return f"{{{', '.join(f'{name!r}: {array_text(value)}' for name, value in effect.parameters)}}}"
