"""A checkpoint of the model that reads objects: config.json, model.safetensors, and the record of its input."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from pipeline.errors import ModelError
from pipeline.objects.network import ObjectsNetwork, ObjectsSize
from pipeline.untrusted import read_json

MODEL_TYPE = "objects"
CONFIG_FILE, WEIGHTS_FILE = "config.json", "model.safetensors"


def is_objects(name: str) -> bool:
    """Whether a folder has a checkpoint of this kind."""
    file = Path(name) / CONFIG_FILE
    try:
        return file.is_file() and read_json(file, ModelError).get("model_type") == MODEL_TYPE
    except ModelError:
        return False


def save_objects(folder: Path, network: ObjectsNetwork) -> None:
    """Write configuration and weights."""
    folder.mkdir(parents=True, exist_ok=True)
    config = {"model_type": MODEL_TYPE, **asdict(network.size)}
    (folder / CONFIG_FILE).write_text(json.dumps(config, indent=1) + "\n")
    save_file({k: v.contiguous() for k, v in network.state_dict().items()}, folder / WEIGHTS_FILE)


def load_objects_network(folder: Path) -> ObjectsNetwork:
    """The network of a folder. Raises `ModelError`."""
    try:
        config = read_json(folder / CONFIG_FILE, ModelError)
        kind = config.pop("model_type")
        if kind != MODEL_TYPE:
            raise ValueError(f"it is of the type {kind}, not {MODEL_TYPE}")
        network = ObjectsNetwork(ObjectsSize(**config | {"channels": tuple(config["channels"])}))
        network.load_state_dict(load_file(folder / WEIGHTS_FILE))
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as error:
        reason = str(error).splitlines()[0]
        raise ModelError(f"{str(folder)!r} has no model that reads objects ({reason}); valid: models/objects") from None
    return network.eval()
