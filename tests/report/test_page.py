"""The page of a result: what is in it, that it needs no network, and how its parts are made."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest
import small_clip
from result_folders import INFER, write_inferred

from pipeline.api import export as module
from pipeline.api.export import export, write_page
from pipeline.api.simulate import simulate
from pipeline.commands.main import main
from pipeline.editing.edit_list import Edit
from pipeline.errors import OutputError
from pipeline.scene.scene import Scene, SceneObject
from pipeline.viewer.page.film import Panel, film
from pipeline.viewer.page.motion_3d import RATE, BodyPath, motion_record
from pipeline.viewer.page.result_page import asset
from pipeline.vision.recordings.video import read_clip


@pytest.fixture(autouse=True)
def _our_own_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "choose_backend", lambda choice: ("raycast", "our own ray caster"))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_inferred(tmp_path_factory.mktemp("results") / "out")


@pytest.fixture(scope="module")
def page(found: Path) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "choose_backend", lambda choice: ("raycast", "our own ray caster"))
        return export(found)


def data_of(page: str) -> dict:
    match = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return json.loads(match[1])


def test_a_page_asks_for_nothing_from_any_network(page: str) -> None:
    assert re.findall(r"(?:https?:)?//[\w.-]+\.\w+|\bimport\s*\(|XMLHttpRequest|\bfetch\(", page) == []
    assert re.findall(r"(?:src|href)=[\"'](?!data:)", page) == []
    assert "default-src 'none'" in page
    assert len(page) < 8_000_000


def test_a_page_has_clip_replay_and_outlines_in_one_video(page: str, tmp_path: Path) -> None:
    shown = data_of(page)["film"]
    assert [p["title"] for p in shown["panels"]] == ["the clip", "the replay", "its outlines on the clip"]
    (tmp_path / "film.mp4").write_bytes(base64.b64decode(shown["video"]))
    frames = read_clip(tmp_path / "film.mp4").frames
    assert frames.shape == (30, small_clip.HEIGHT, 3 * small_clip.WIDTH, 3)
    first = frames[..., : small_clip.WIDTH, :].astype(float)
    assert np.abs(first - small_clip.frames()).mean() < 6


def test_a_page_has_the_motion_of_the_scene(page: str) -> None:
    motion = data_of(page)["motion"]
    poses = np.frombuffer(base64.b64decode(motion["poses"]), "<f4").reshape(motion["frames"], 2, 7)
    trace = small_clip.trace()
    np.testing.assert_allclose(poses[:, :, :3], trace.position[:: 240 // RATE], atol=1e-5)
    assert [(b["name"], b["shape"]) for b in motion["bodies"]] == [("ball", "sphere"), ("crate", "box")]
    assert motion["ground"] == 0


def test_texts_of_a_result_are_shown_and_not_run(page: str) -> None:
    assert "<b>ball</b>" not in page
    assert "Doubt: a hand is in view" in page
    assert "objects[0].mass" in page


def test_an_edited_and_a_simulated_clip_show_what_they_are_compared_with(found: Path, tmp_path: Path) -> None:
    assert main(["edit", str(found), "--remove", "crate", "--at", "0.5", "-o", str(tmp_path / "edited")]) == 0
    page = export(tmp_path / "edited")
    assert "<h1>script&gt;.mp4, edited</h1>" in page  # the name of the clip, without its folder
    edited = data_of(page)
    assert [p["title"] for p in edited["film"]["panels"]] == ["as filmed", "edited"]
    bodies = [(b["name"], b["ghost"]) for b in edited["motion"]["bodies"]]
    assert bodies == [("ball", False), ("crate", False), ("ball", True), ("crate", True)]
    poses = np.frombuffer(base64.b64decode(edited["motion"]["poses"]), "<f4").reshape(-1, 4, 7)
    there = np.isfinite(poses[:, 1, 0])
    assert there[:15].all()
    assert not there[15:].any()

    simulate(found, edits=["objects[ball].mass=4"]).save(tmp_path / "heavier")
    heavier = data_of(export(tmp_path / "heavier"))
    assert [p["title"] for p in heavier["film"]["panels"]] == ["original", "edited"]
    assert len(heavier["motion"]["bodies"]) == 4
    simulate(found, edits=[Edit(0.3, remove="crate")]).save(tmp_path / "without")
    without = data_of(export(tmp_path / "without"))
    assert [(b["name"], b["ghost"]) for b in without["motion"]["bodies"]] == [("ball", False), ("ball", True)]


def test_a_film_gets_smaller_until_it_fits(rng: np.random.Generator) -> None:
    noise = rng.integers(0, 256, (8, 64, 96, 3), dtype=np.uint8)
    large = film([Panel("a", noise), Panel("b", noise)], 30.0)
    small = film([Panel("a", noise), Panel("b", noise)], 30.0, most_bytes=len(large.video) // 2)
    assert len(small.video) <= len(large.video) // 2
    assert small.height < large.height == 64
    assert small.lefts == (0, small.widths[0])


def test_a_mesh_is_shown_as_its_convex_hull_with_faces_outwards(tmp_path: Path) -> None:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + ["f 1 2 3", "f 2 4 3", "f 5 6 7", "f 1 5 6", "f 3 4 8"]
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    body = SceneObject("mesh", (0.1,), 1.0, file=str(tmp_path / "cube.obj"))
    path = BodyPath(body, 0, np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)))
    record = motion_record(Scene((body,)), [path], 30, 1.5)
    t = np.frombuffer(base64.b64decode(record["bodies"][0]["triangles"]), "<f4").reshape(-1, 3, 3)
    normals = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    assert (np.einsum("ki,ki->k", normals, t.mean(1)) > 0).all()
    assert record["bodies"][0]["half"] == [0.1, 0.1, 0.1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r | {"command": "masks"}, "is of `dynamics masks`; valid"),
        (lambda r: r | {"grade": 3}, "grade: input should be"),
        (lambda r: {k: v for k, v in r.items() if k != "methods"}, "methods: field required"),
    ],
)
def test_a_folder_that_is_not_ours_is_one_error_and_nothing_is_written(change, message: str, tmp_path: Path) -> None:
    folder = write_inferred(tmp_path / "out", change(INFER))
    with pytest.raises(OutputError, match=re.escape(message)):
        export(folder)
    (folder / "result.json").unlink()
    assert main(["export", str(folder), "-o", str(tmp_path / "page.html")]) == 2
    assert not (tmp_path / "page.html").exists()


def test_an_edited_clip_whose_source_is_gone_says_so(found: Path, tmp_path: Path) -> None:
    result = {"command": "edit", "found": str(tmp_path / "gone"), "edits": [], "pixels": {}}
    (tmp_path / "result.json").write_text(json.dumps(result))
    with pytest.raises(OutputError, match="the folder that was edited"):
        export(tmp_path)


def test_a_page_replaces_a_file_only_where_that_is_wanted(tmp_path: Path) -> None:
    place = tmp_path / "page.html"
    write_page("one", place)
    with pytest.raises(OutputError, match="exists already"):
        write_page("two", place)
    write_page("two", place, force=True)
    assert place.read_text() == "two"
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]
    with pytest.raises(OutputError, match="no such folder"):
        write_page("x", tmp_path / "a" / "b.html")


def test_the_scripts_are_strict_and_load_nothing() -> None:
    for name in ("viewer.js", "player.js"):
        assert '"use strict";' in asset(name)
        assert "http" not in asset(name)
