"""How often a campaign tries: a few times in `make test`, so often as docs/reliability.md says in `make campaign`."""

import os
import signal
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import numpy as np

FULL = "DYNAMICS_CAMPAIGN"
HANG_S = 60


def rounds(few: int, many: int) -> range:
    """As many rounds as this run asks for."""
    return range(many if os.environ.get(FULL) else few)


@contextmanager
def no_hang() -> Iterator[None]:
    """Raise TimeoutError after a minute."""

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise TimeoutError(f"more than {HANG_S} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(HANG_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcomes(attempt: Callable[[], object], allowed: type[Exception], counted: Counter[str], name: str) -> None:
    """Count what an attempt came to. Anything but an answer or one error of one line is a failure of the campaign."""
    said = None
    try:
        with no_hang():
            attempt()
    except allowed as error:
        said = str(error)
    except BaseException as error:
        raise AssertionError(f"{name}: {type(error).__name__}\n{traceback.format_exc()}") from error
    counted["answers" if said is None else "errors"] += 1
    assert said is None or 0 < len(said.strip()) < 2000, f"{name}: {said}"


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Data with one fault: a flipped bit, a cut end, a swapped or doubled or zeroed part, bytes of noise."""
    data = bytes(data)
    if not data:
        return rng.bytes(8)
    start = int(rng.integers(len(data)))
    stop = int(min(len(data), start + rng.integers(1, 64)))
    match rng.integers(6):
        case 0:
            return data[:start] + bytes([data[start] ^ (1 << int(rng.integers(8)))]) + data[start + 1 :]
        case 1:
            return data[:start]
        case 2:
            other = int(rng.integers(len(data)))
            return data[:start] + data[other : other + stop - start] + data[stop:]
        case 3:
            return data[:stop] + data[start:stop] + data[stop:]
        case 4:
            return data[:start] + b"\0" * (stop - start) + data[stop:]
        case _:
            return data[:start] + rng.bytes(stop - start) + data[stop:]
