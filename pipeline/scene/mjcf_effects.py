"""Effects in an MJCF document: MuJoCo's own elements where they say the law exactly, and a text where none does.

Where effects are forces in the air, the scene is integrated by the classical Runge-Kutta method: MuJoCo's default
method takes forces at the start of a step, which at 1/240 s misses 1 % of the drag of a falling body. So are joints: a
double pendulum loses a quarter of its energy in 10 s by the default method, and 1e-5 by this one. Laws of friction
need the contact forces of the last step, which only the default method has.
"""

from __future__ import annotations

from typing import Any

from pipeline.scene.effects.fluid import Fluid, add_fluid, expressible
from pipeline.scene.effects.kind import EffectKind, Regime
from pipeline.scene.effects.text import effect_kind
from pipeline.scene.scene import Scene

SMOOTH_INTEGRATOR = "RK4"


def needs_contacts(kind: EffectKind) -> bool:
    """Whether the effect acts on the ground alone, so that its force needs the contact forces of the last step."""
    return Regime.FLIGHT not in kind.regimes


def effects_outside_mjcf(scene: Scene) -> tuple[int, ...]:
    """Indices of the effects on the motion that MuJoCo's elements cannot say: they have to be applied as forces."""
    in_fluid, _ = _fluid(scene)
    kinds = [effect_kind(effect) for effect in scene.effects]
    stated = (i in in_fluid or k.edit is not None or k.recording is not None for i, k in enumerate(kinds))
    return tuple(i for i, known in enumerate(stated) if not known)


def add_effects(root: Any, scene: Scene) -> None:
    """Add a scene's effects to its MJCF document, and describe in custom text those that it cannot say."""
    kinds = [effect_kind(effect) for effect in scene.effects]
    outside, (in_fluid, bodies) = effects_outside_mjcf(scene), _fluid(scene)
    if (scene.jointed or in_fluid or outside) and not any(needs_contacts(kinds[i]) for i in outside):
        root.option.integrator = SMOOTH_INTEGRATOR
    for number, (effect, kind) in enumerate(zip(scene.effects, kinds, strict=True)):
        if kind.edit is not None:
            kind.edit(root, scene, effect.values, effect.objects or tuple(o.name for o in scene.objects))
        elif number in outside:
            _describe(root, number, scene, "is not in this model: a force, which `dynamics` applies")
        elif kind.recording is not None:
            _describe(root, number, scene, "is about the recording, not the motion")
    if in_fluid:
        add_fluid(root, [o.name for o in scene.objects], bodies)


def _describe(root: Any, number: int, scene: Scene, what: str) -> None:
    effect = scene.effects[number]
    values = ", ".join(f"{name} {value}" for name, value in effect.parameters)
    where = "" if effect.only is None else f" {effect.only.words}"
    formula = effect_kind(effect).formula
    root.custom.add("text", name=f"effect_{number}", data=f"{effect.name} ({values}; {formula}){where} {what}")


def _fluid(scene: Scene) -> tuple[frozenset[int], list[Fluid]]:
    """Indices of the effects that are forces of MuJoCo's fluid, and what it does to each object.

    Where one fluid cannot say all of them, linear drag is left out, then all of them.
    """
    kinds = [effect_kind(effect) for effect in scene.effects]
    if any(kind.air_velocity is not None and kind.fluid is None for kind in kinds):
        return frozenset(), []  # air that moves in a part of the world
    said = {i: kind.fluid(scene.effects[i].values) for i, kind in enumerate(kinds) if kind.fluid is not None}
    for chosen in (said, {i: fluid for i, fluid in said.items() if not fluid.linear}):
        bodies = [
            sum((f for i, f in chosen.items() if _acts(scene, i, obj.name)), start=Fluid()) for obj in scene.objects
        ]
        if any(b.acts for b in bodies) and expressible(bodies):
            return frozenset(chosen), bodies
    return frozenset(), []


def _acts(scene: Scene, number: int, name: str) -> bool:
    objects = scene.effects[number].objects
    return objects is None or name in objects
