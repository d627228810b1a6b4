"""Chromium without a window, for tests of web pages. A test that uses `chromium` is skipped where it is not there."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
#: WebGL by the processor. Without a sandbox, since CI runs as root and opens only pages of its own.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


@dataclass
class Visit:
    """A page that is open, and what it asked for and complained of.

    Attributes:
        page: Playwright's.
        requested: Addresses, in order.
        complaints: Errors and warnings of the console, and exceptions.
    """

    page: Any
    requested: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser; skips where Playwright or Chromium are missing."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: make test-app does")
    place = next(filter(None, map(shutil.which, NAMES)), None)
    if place is None:
        pytest.skip(f"no Chromium on the PATH ({', '.join(NAMES)})")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=place, args=FLAGS)
        yield browser
        browser.close()


def visit(browser: Any, address: str, **options: Any) -> Visit:
    """A page in a context of its own, as of another visitor."""
    page = browser.new_context(viewport={"width": 1200, "height": 900}, **options).new_page()
    made = Visit(page)
    page.on("request", lambda r: made.requested.append(r.url))
    page.on("console", lambda m: made.complaints.append(m.text) if m.type in ("error", "warning") else None)
    page.on("pageerror", lambda e: made.complaints.append(str(e)))
    page.goto(address)
    return made


def colours(page: Any, selector: str) -> int:
    """How many different colours a canvas shows, of 400 of its pixels."""
    return int(
        page.locator(selector).evaluate(
            """canvas => {
              const small = document.createElement("canvas"); small.width = small.height = 20;
              const pen = small.getContext("2d"); pen.drawImage(canvas, 0, 0, 20, 20);
              const data = pen.getImageData(0, 0, 20, 20).data, seen = new Set();
              for (let i = 0; i < data.length; i += 4) seen.add(`${data[i]},${data[i + 1]},${data[i + 2]}`);
              return seen.size;
            }"""
        )
    )
