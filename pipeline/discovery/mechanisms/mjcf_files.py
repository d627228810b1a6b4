"""A user's MJCF and its files, checked before MuJoCo opens them: bounded, inside one folder, without plugins."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

from pipeline.errors import SceneError, naming
from pipeline.untrusted import MOST_MESH_BYTES, open_untrusted, parse_xml, read_bytes

MOST_XML_BYTES = 2**24
MOST_ELEMENTS = 50_000  # of all kinds; the largest models of robots that are published have some 3,000
MOST_BODIES = 2_000
MOST_COPIES = 10_000  # bodies that replicate, composite and flexcomp may make together
MOST_INCLUDES = 100
REFUSED = ("plugin", "extension", "attach", "model")
"""Elements that load compiled code or other models."""


def check_mjcf(path: Path) -> None:
    """Raise SceneError where an MJCF file, or a file that it names, is not one that MuJoCo may be given.

    The files must lie in the folder of the model or below it, and are bounded in size; their number of elements and of
    bodies is, too. Nothing is loaded that runs code.
    """
    folder = path.resolve().parent
    elements = list(_elements(path, folder, depth=0))
    if elements[0].tag != "mujoco":
        raise SceneError(f"{path}: the outermost element is {elements[0].tag!r}; valid: a MuJoCo model (mujoco)")
    if len(elements) > MOST_ELEMENTS:
        raise SceneError(f"{path} has {len(elements):,} elements; at most {MOST_ELEMENTS:,} are read")
    bodies = sum(e.tag == "body" for e in elements)
    if bodies > MOST_BODIES:
        raise SceneError(f"{path} has {bodies:,} bodies; at most {MOST_BODIES:,} are simulated")
    copies = 1
    folders = {"mesh": folder, "texture": folder, "hfield": folder, "skin": folder}
    for e in elements:
        if e.tag in REFUSED:
            raise SceneError(f"{path}: the element {e.tag!r} loads other code or models, which is not allowed")
        if e.tag in ("replicate", "composite", "flexcomp"):
            copies *= _count(path, e)
        if e.tag == "size" and e.get("memory") is not None:
            raise SceneError(f"{path}: size: memory is not allowed; MuJoCo finds out how much is needed")
        if e.tag == "compiler":
            common = e.get("assetdir")
            for kind, key in (("mesh", "meshdir"), ("skin", "meshdir"), ("texture", "texturedir")):
                named = e.get(key) or common
                if named is not None:
                    folders[kind] = folder / named
    if copies > MOST_COPIES:
        raise SceneError(f"{path}: {copies:,} copies of bodies are asked for; at most {MOST_COPIES:,} are made")
    for e in elements:
        if e.tag in folders:
            for key, value in e.attrib.items():
                if key.startswith("file"):
                    _check_asset(path, folder, folders[e.tag] / value)


def _elements(path: Path, folder: Path, depth: int) -> Iterator[Element]:
    """The elements of a file and of those that it includes, in order."""
    data = read_bytes(path, SceneError, MOST_XML_BYTES)
    if depth > MOST_INCLUDES:
        raise SceneError(f"{path}: files include each other more than {MOST_INCLUDES} deep")
    for e in parse_xml(data, str(path), SceneError).iter():
        if e.tag == "include":
            yield from _elements(_inside(path, folder, folder / (e.get("file") or "")), folder, depth + 1)
        else:
            yield e


def _count(path: Path, e: Element) -> int:
    """How many bodies an element makes."""
    out = 1
    for word in e.get("count", "1").split():
        if not word.isdecimal():
            raise SceneError(f"{path}: {e.tag}: count is {e.get('count')!r}; valid: whole numbers")
        out *= max(int(word), 1)
    return out


def _inside(path: Path, folder: Path, named: Path) -> Path:
    """A file that a model names, if it is in the model's folder or below."""
    place = named.resolve()
    if not place.is_relative_to(folder):
        raise SceneError(f"{path}: {named} is outside of the folder of the model, {folder}")
    return place


def _check_asset(path: Path, folder: Path, named: Path) -> None:
    place = _inside(path, folder, named)
    with naming(str(path)), open_untrusted(place, SceneError, MOST_MESH_BYTES):
        pass
