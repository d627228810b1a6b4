"""The exceptions that a user can cause. Each message names the place of the fault and the valid values.

Commands and stages catch `DynamicsError`, print its message and exit with code 2.
"""

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class DynamicsError(Exception):
    """Base of all errors that come from the user's data, files or settings."""


class SceneError(DynamicsError):
    """A scene text or file that does not describe a scene."""


class ParamsError(DynamicsError):
    """A parameter that is unknown, missing or out of range."""


class SimulationError(DynamicsError):
    """A scene whose simulation becomes unstable (non-finite state, or a reset by MuJoCo)."""


class VideoError(DynamicsError):
    """A video or mask file that cannot be used."""


class ModelError(DynamicsError):
    """A checkpoint or a hub name that cannot be loaded."""


class ShardError(DynamicsError):
    """A shard that is missing or damaged and cannot be recomputed."""


class MeasurementError(DynamicsError):
    """Measured motion that cannot be used, or that does not fit its scene."""


class OutputError(DynamicsError):
    """A place that cannot be written to."""


def did_you_mean(word: object, valid: Iterable[object]) -> str:
    """` (did you mean 'mass'?)` where one of the valid words is close to `word`, else an empty string."""
    close = difflib.get_close_matches(str(word), [str(v) for v in valid], n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


@contextmanager
def naming(parameter: str) -> Iterator[None]:
    """Put the name of the parameter or flag that the user gave before the message of an error raised inside."""
    try:
        yield
    except DynamicsError as error:
        raise type(error)(f"{parameter}: {error}") from None
