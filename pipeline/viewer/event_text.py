"""Events in words, with the objects' names."""

from __future__ import annotations

from pipeline.language.completion import EVENT_PHRASES
from pipeline.language.events import Event
from pipeline.scene.scene import Scene


def event_text(event: Event, scene: Scene) -> str:
    """`sphere_0 hits box_1`: an event with the objects' names."""
    names = [o.name for o in scene.objects]
    phrase = EVENT_PHRASES[event.kind]
    if event.second is not None:
        return f"{names[event.first]}{phrase.removesuffix('object ')}{names[event.second]}"
    return f"{names[event.first]}{phrase}"
