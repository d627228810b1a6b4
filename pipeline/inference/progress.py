"""How far a long computation is: a bar on stderr while it works, a line on stdout for each outcome, and the times."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

WIDTH = 11


class Progress:
    """Counts named steps.

    Args:
        steps: How many there will be.
        shown: Whether the user sees them; else only the times are kept.

    Attributes:
        seconds: The time that each step took.
    """

    def __init__(self, steps: int = 0, shown: bool = False) -> None:
        self.seconds: dict[str, float] = {}
        self._shown = shown
        look = "{l_bar}{bar}| {elapsed}{postfix}"
        self._bar = tqdm(total=steps, disable=None if shown else True, leave=False, file=sys.stderr, bar_format=look)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """The step that is now under way."""
        self._bar.set_description(name)
        began = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - began, 3)
        self._bar.update()

    def detail(self, text: str) -> None:
        """What the step is doing, beside its name."""
        self._bar.set_postfix_str(text)

    def say(self, subject: str, text: str) -> None:
        """A line of outcome."""
        if self._shown:
            tqdm.write(f"{subject:<{WIDTH}}{text}", file=sys.stdout)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()
