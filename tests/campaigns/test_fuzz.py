"""Damaged input of every kind: an answer or one error, and never a traceback or a hang."""

import io
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaign import damaged, outcomes, rounds
from PIL import Image

from pipeline.discovery.tracks.known_scene import load_known_scene
from pipeline.discovery.tracks.track import read_tracks
from pipeline.errors import DynamicsError
from pipeline.physics.simulate import simulate
from pipeline.scene.edited import edited
from pipeline.scene.text import load_scene, read_scene
from pipeline.shards.code_hash import ROOT
from pipeline.vision.recordings.mask_file import read_masks
from pipeline.vision.recordings.video import read_clip, write_video
from stages.graph.params import Params
from stages.graph.params_file import read_params_file

pytestmark = pytest.mark.campaign

SCENE = """camera: {position: [0, -2, 0.80], pitch: -22.0, fov: 42.0}
gravity: 9.81
ground: {height: 0.0}
fixed:
- {name: ramp, shape: box, width: 1.0, depth: 0.5, height: 0.1, position: [0, 1, 0]}
objects:
- {name: ball, shape: sphere, radius: 0.12, mass: 0.50, sliding_friction: 0.40, rolling_friction: 0.004, damping: 0.60,
   position: [0.10, 0.32, 0.12], velocity: [0.90, -0.20, 0.0], angular_velocity: [0, 7.5, 0], orientation: [1, 0, 0, 0]}
effects:
- {name: air_drag, coefficient: 0.003, objects: [ball]}
"""
NUMBERS = [".nan", ".inf", "-.inf", "-1", "0", "1e-300", "1e300", "1e7", "null", "[]", "{}", "true", "x", "9" * 400]


def with_a_strange_number(text: bytes, rng: np.random.Generator) -> bytes:
    """The text with one of its numbers replaced."""
    import re

    found = list(re.finditer(rb"-?\d+\.?\d*", text))
    chosen = found[int(rng.integers(len(found)))]
    return text[: chosen.start()] + str(rng.choice(NUMBERS)).encode() + text[chosen.end() :]


def mutated(text: bytes, rng: np.random.Generator) -> bytes:
    return with_a_strange_number(text, rng) if rng.random() < 0.5 else damaged(text, rng)


def test_scenes(tmp_path: Path, rng: np.random.Generator) -> None:
    counted: Counter[str] = Counter()

    def attempt() -> None:
        simulate(load_scene(tmp_path / "scene.yaml"), 0.05)

    for k in rounds(60, 1500):
        text = mutated(SCENE.encode(), rng)
        (tmp_path / "scene.yaml").write_bytes(text)
        outcomes(attempt, DynamicsError, counted, f"scene {k}: {text!r}")
    print(dict(counted))


def test_edits(rng: np.random.Generator) -> None:
    scene, counted = read_scene(SCENE), Counter[str]()
    for k in rounds(30, 500):
        edit = mutated(b"objects[0].position[2]=0.5", rng).decode("utf-8", "replace")
        outcomes(lambda edit=edit: edited(scene, [edit]), DynamicsError, counted, f"edit {k}: {edit!r}")
    print(dict(counted))


def test_parameters(tmp_path: Path, rng: np.random.Generator) -> None:
    counted, whole = Counter[str](), (ROOT / "params.yaml").read_bytes()
    for k in rounds(6, 400):
        text = mutated(whole, rng)
        (tmp_path / "params.yaml").write_bytes(text)
        outcomes(lambda: read_params_file(tmp_path / "params.yaml", Params), DynamicsError, counted, f"params {k}")
    print(dict(counted))


def test_tracks(tmp_path: Path, rng: np.random.Generator) -> None:
    counted: Counter[str] = Counter()
    table = pd.read_csv(ROOT / "data/measured/thrown_ball.csv").head(60)
    table.to_parquet(tmp_path / "sound.parquet")
    kinds = {".csv": table.to_csv(index=False).encode(), ".parquet": (tmp_path / "sound.parquet").read_bytes()}
    for k in rounds(40, 1200):
        suffix = str(rng.choice(list(kinds)))
        data = mutated(kinds[suffix], rng) if suffix == ".csv" else damaged(kinds[suffix], rng)
        file = tmp_path / f"t{suffix}"
        file.write_bytes(data)
        outcomes(lambda file=file: read_tracks(file), DynamicsError, counted, f"tracks {k}{suffix}: {data!r}")
    print(dict(counted))


def test_known_scenes(tmp_path: Path, rng: np.random.Generator) -> None:
    counted, whole = Counter[str](), (ROOT / "data/measured/thrown_ball.yaml").read_bytes()
    for k in rounds(30, 500):
        text = mutated(whole, rng)
        (tmp_path / "k.yaml").write_bytes(text)
        outcomes(lambda: load_known_scene(tmp_path / "k.yaml"), DynamicsError, counted, f"known {k}: {text!r}")
    print(dict(counted))


def test_masks(tmp_path: Path, rng: np.random.Generator) -> None:
    counted, masks = Counter[str](), np.zeros((3, 12, 16), np.uint8)
    masks[:, 3:8, 4:9] = 1
    archive, picture = io.BytesIO(), io.BytesIO()
    np.savez_compressed(archive, masks=masks)
    Image.fromarray(masks[0]).save(picture, "PNG")
    kinds = {".npz": archive.getvalue(), ".png": picture.getvalue()}
    for k in rounds(60, 1500):
        suffix = str(rng.choice(list(kinds)))
        data = damaged(kinds[suffix], rng)
        file = tmp_path / f"m{suffix}"
        file.write_bytes(data)
        outcomes(lambda file=file: read_masks(file, (16, 12)), DynamicsError, counted, f"masks {k}{suffix}: {data!r}")
    print(dict(counted))


def test_videos(tmp_path: Path, rng: np.random.Generator) -> None:
    counted: Counter[str] = Counter()
    write_video(tmp_path / "sound.mp4", rng.integers(0, 255, (10, 32, 48, 3), np.uint8))
    whole = (tmp_path / "sound.mp4").read_bytes()
    for k in rounds(30, 500):
        (tmp_path / "v.mp4").write_bytes(damaged(whole, rng))
        outcomes(
            lambda: read_clip(tmp_path / "v.mp4", seconds=0.3, size=(48, 32)), DynamicsError, counted, f"video {k}"
        )
    print(dict(counted))


def test_checkpoints(tmp_path: Path, rng: np.random.Generator) -> None:
    from pipeline.bodies.networks.network import load_network
    from pipeline.bodies.networks.outline_network import load_outline_network

    source, folder, counted = ROOT / "models" / "masks", tmp_path / "masks", Counter[str]()
    shutil.copytree(source, folder)
    networks = (
        ("config.json", "model.safetensors", load_network),
        ("outlines.json", "outlines.safetensors", load_outline_network),
    )
    for config, weights, load in networks:
        for k in rounds(5, 100):
            for file in (config, weights):
                data = damaged((source / file).read_bytes(), rng)
                if file == weights and rng.random() < 0.7:  # in the header, where faults can be told
                    head = 400
                    data = damaged(data[:head], rng) + data[head:]
                (folder / file).write_bytes(data)
                outcomes(lambda load=load: load(folder), DynamicsError, counted, f"{k} {file}")
                shutil.copyfile(source / file, folder / file)
    print(dict(counted))
