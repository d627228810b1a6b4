"""Checkpoints of trainings: one safetensors file with a checksum, and beside it the one before.

Numbers, lists and dicts around the tensors are JSON in the file's header. Nothing of it is executed when it is read.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from pipeline.errors import ModelError

SUFFIX = ".safetensors"


def save_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Write a state whole or not at all; what was at `path` becomes the checkpoint before it.

    Args:
        path: A file whose name ends with .safetensors.
        state: Dicts, lists and tuples of tensors, numbers and text.
    """
    tensors: dict[str, torch.Tensor] = {}
    tree = json.dumps(_packed(state, "", tensors))
    part = path.with_suffix(".part")
    save_file(tensors, part, {"tree": tree, "sha256": _digest(tree, tensors)})
    with open(part, "rb") as file:
        os.fsync(file.fileno())
    if path.exists():
        path.replace(before(path))
    part.replace(path)


def load_checkpoint(path: Path, device: str = "cpu") -> dict[str, Any]:
    """The state at `path`, or, with a warning, the one before it where that is damaged or missing.

    Raises ModelError where neither can be read.
    """
    try:
        return _read(path, device)
    except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
        if not before(path).is_file():
            raise ModelError(f"{path} is damaged ({error}), and there is no checkpoint before it") from None
        print(f"warning: {path} is damaged ({error}); the training goes on from {before(path)}", file=sys.stderr)
    try:
        return _read(before(path), device)
    except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
        raise ModelError(f"{path} and the checkpoint before it are damaged ({error})") from None


def has_checkpoint(path: Path) -> bool:
    """Whether there is something to go on from."""
    return path.is_file() or before(path).is_file()


def before(path: Path) -> Path:
    """The file of the checkpoint before the one at `path`."""
    return path.with_name(f"{path.stem}-before{path.suffix}")


def _read(path: Path, device: str) -> dict[str, Any]:
    with safe_open(path, "pt", device="cpu") as file:
        header = file.metadata() or {}
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if header.get("sha256") != _digest(header.get("tree", ""), tensors):
        raise ValueError("its hash is not the one that was written")
    return _unpacked(json.loads(header["tree"]), {name: tensor.to(device) for name, tensor in tensors.items()})


def _digest(tree: str, tensors: dict[str, torch.Tensor]) -> str:
    digest = hashlib.sha256(tree.encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}\0".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def _packed(value: Any, name: str, tensors: dict[str, torch.Tensor]) -> Any:
    """What JSON has of a value; its tensors go to `tensors`. Keys of dicts keep their type."""
    match value:
        case torch.Tensor():
            tensors[name] = value.detach().cpu().contiguous().clone()
            return {"tensor": name}
        case dict():
            return {"dict": [[key, _packed(inner, f"{name}/{key}", tensors)] for key, inner in value.items()]}
        case list() | tuple():
            kind = "list" if isinstance(value, list) else "tuple"
            return {kind: [_packed(inner, f"{name}/{k}", tensors) for k, inner in enumerate(value)]}
        case None | bool() | int() | float() | str():
            return {"value": value}
    raise TypeError(f"{name}: a checkpoint cannot have a {type(value).__name__}")


def _unpacked(tree: dict[str, Any], tensors: dict[str, torch.Tensor]) -> Any:
    ((kind, content),) = tree.items()
    match kind:
        case "tensor":
            return tensors[content]
        case "dict":
            return {key: _unpacked(inner, tensors) for key, inner in content}
        case "list":
            return [_unpacked(inner, tensors) for inner in content]
        case "tuple":
            return tuple(_unpacked(inner, tensors) for inner in content)
    return content
