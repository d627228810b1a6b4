"""How a command tells what it does: a bar on stderr while it works, a line on stdout for each outcome."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

WIDTH = 11


class Progress:
    """A bar over a known number of steps; `seconds` has the time that each named step took."""

    def __init__(self, steps: int) -> None:
        self.seconds: dict[str, float] = {}
        look = "{l_bar}{bar}| {elapsed}{postfix}"
        self._bar = tqdm(total=steps, disable=None, leave=False, file=sys.stderr, bar_format=look)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """The step that is now under way."""
        self._bar.set_description(name)
        began = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - began, 3)
        self._bar.update()

    def detail(self, text: str) -> None:
        """What the step is at, beside its name."""
        self._bar.set_postfix_str(text)

    def say(self, subject: str, text: str) -> None:
        """A line of outcome."""
        tqdm.write(f"{subject:<{WIDTH}}{text}", file=sys.stdout)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()
