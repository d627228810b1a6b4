"""Units of times and lengths, as people write them."""

from __future__ import annotations

PIXELS = "px"
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
LENGTH = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3, "in": 0.0254, "ft": 0.3048}
_OTHER_NAMES = {
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "msec": "ms",
    "millisecond": "ms",
    "milliseconds": "ms",
    "µs": "us",
    "μs": "us",
    "microseconds": "us",
    "nanoseconds": "ns",
    "minutes": "min",
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "centimeters": "cm",
    "centimetres": "cm",
    "millimeters": "mm",
    "millimetres": "mm",
    "µm": "um",
    "μm": "um",
    "inch": "in",
    "inches": "in",
    "feet": "ft",
    "pixel": PIXELS,
    "pixels": PIXELS,
    "pix": PIXELS,
}
VALID = (*LENGTH, PIXELS)
"""What a unit of positions may be."""


def unit_of(text: str) -> str | None:
    """The short name of a unit of time or length; None for any other text."""
    plain = text.strip().strip("()[]").strip()
    name = _OTHER_NAMES.get(plain.lower(), plain if plain in (*TIME, *VALID) else plain.lower())
    return name if name in TIME or name in VALID else None
