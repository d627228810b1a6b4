"""A recording read back has the motion, the pictures and the events that went into it."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipeline.clips.events import DEFAULT_THRESHOLDS, Event, find_events
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks, pair_view, trace_pairs
from pipeline.errors import OutputError
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.scene import SIZE_KEYS, Camera, FixedBody, Scene, SceneObject
from pipeline.viewer.footage import Footage, MotionLayer, Pictures, event_text
from pipeline.viewer.motion import LONGEST_ARROW, contact_arrows, shape
from pipeline.viewer.recording import save

SCHEDULE = Schedule()
WIDTH, HEIGHT = 60, 40
SCENE = Scene(
    (
        SceneObject("sphere", (0.1,), 1.0, position=(-0.3, 0, 0.3), velocity=(1, 0, 0), name="ball"),
        SceneObject("box", (0.2, 0.3, 0.2), 2.0, position=(0.3, 0, 0.1), angular_velocity=(0, 0, 3), name="crate"),
    ),
    Camera((0, -2, 0.6), fov=40, pitch=-15),
)
EVENTS = (Event(0.21, "hits_ground", 0), Event(0.5, "hits_object", 0, 1))


@pytest.fixture(scope="module")
def trace() -> Trace:
    return simulate(SCENE)


@pytest.fixture(scope="module")
def footage(trace: Trace) -> Footage:
    masks = frame_masks(SCENE, trace, SCHEDULE, WIDTH, HEIGHT)
    view = pair_view(SCENE, *trace_pairs(trace, SCHEDULE), WIDTH, HEIGHT)
    first = SCHEDULE.pairs[:, 0]
    rgb = np.repeat(80 * masks[..., None], 3, -1)
    pictures = Pictures(rgb, masks, view.depth, view.flow, first)
    return Footage(
        "suite/7", "# notes", (MotionLayer("truth", SCENE, trace, True, EVENTS),), pictures, times=SCHEDULE.times
    )


@pytest.fixture(scope="module")
def file(footage: Footage, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "a.rrd"
    save(footage, path)
    return path


def rows(file: Path, entity: str, static: bool = False) -> list[dict[str, Any]]:
    """The entity's rows, on whichever timelines they are."""
    chunks = [c for c in RrdReader(file).stream().to_chunks() if c.entity_path == f"/{entity}"]
    return [row for chunk in chunks if chunk.is_static == static for row in chunk.to_record_batch().to_pylist()]


def seconds(row: dict[str, Any]) -> float:
    return float(row["sim_time"].total_seconds())


def test_a_body_is_where_it_was_simulated_at_every_step_and_at_every_frame(file: Path, trace: Trace) -> None:
    for i, name in enumerate(("ball", "crate")):
        poses = sorted(rows(file, f"world/truth/{name}"), key=seconds)
        assert len(poses) == len(trace.times)
        np.testing.assert_allclose([seconds(p) for p in poses], trace.times, atol=1e-6)
        np.testing.assert_allclose([p["Transform3D:translation"][0] for p in poses], trace.position[:, i], atol=1e-6)
        xyzw = [p["Transform3D:quaternion"][0] for p in poses]
        np.testing.assert_allclose(xyzw, trace.quaternion[:, i][:, [1, 2, 3, 0]], atol=1e-6)
        at_frames = [p for p in poses if p.get("frame") is not None]
        assert [p["frame"] for p in at_frames] == list(range(30))
        np.testing.assert_allclose([seconds(p) for p in at_frames], np.arange(30) / 30, atol=1e-6)


def test_shapes_camera_and_notes_hold_for_all_times(file: Path) -> None:
    (ball,) = rows(file, "world/truth/ball", static=True)
    assert ball["Ellipsoids3D:half_sizes"] == [pytest.approx([0.1] * 3)]
    (crate,) = rows(file, "world/truth/crate", static=True)
    assert crate["Boxes3D:half_sizes"] == [pytest.approx([0.1, 0.15, 0.1])]
    camera = {k: v for row in rows(file, "world/camera", static=True) for k, v in row.items()}
    assert camera["Transform3D:translation"] == [pytest.approx([0, -2, 0.6])]
    assert camera["Pinhole:resolution"] == [[WIDTH, HEIGHT]]
    assert rows(file, "notes", static=True)[0]["TextDocument:text"] == ["# notes"]


def test_masks_come_back_pixel_for_pixel(file: Path, footage: Footage) -> None:
    found = sorted(rows(file, "world/camera/masks"), key=lambda row: row["frame"])
    assert footage.seen.masks is not None
    assert [row["frame"] for row in found] == list(range(30))
    for row, mask in zip(found, footage.seen.masks, strict=True):
        read = np.array(row["SegmentationImage:buffer"][0], np.uint8)
        np.testing.assert_array_equal(read.reshape(HEIGHT, WIDTH), mask)


def test_pictures_are_at_their_frames(file: Path) -> None:
    for kind, frames in (("rgb", range(30)), ("flow", range(0, 30, 3)), ("depth", range(0, 30, 3))):
        assert sorted(row["frame"] for row in rows(file, f"world/camera/{kind}")) == list(frames)


def test_arrows_end_at_the_contact_points_and_are_gone_where_there_are_none(file: Path, trace: Trace) -> None:
    mass = np.array([o.mass for o in SCENE.objects])
    origins, vectors, counts = contact_arrows(trace, mass)
    np.testing.assert_allclose(origins + vectors, trace.contacts.position, atol=1e-12)
    length = np.linalg.norm(vectors, axis=1)
    assert length.max() <= LONGEST_ARROW + 1e-12
    along = np.sum(vectors * trace.contacts.force, 1)
    np.testing.assert_allclose(along, length * np.linalg.norm(trace.contacts.force, axis=1))
    logged = {round(seconds(r) * 240): len(r["Arrows3D:vectors"] or []) for r in rows(file, "world/truth/contacts")}
    assert logged == dict(enumerate(counts.tolist()))


def test_events_and_plots_tell_the_motion(file: Path, trace: Trace) -> None:
    told = [(seconds(r), r["frame"], r["TextLog:text"][0]) for r in rows(file, "events/truth")]
    assert told == [(0.21, 6, "ball hits the ground"), (0.5, 15, "ball hits crate")]
    heights = sorted(rows(file, "plots/height/truth/ball"), key=seconds)
    np.testing.assert_allclose([r["Scalars:scalars"][0] for r in heights], trace.position[:, 0, 2])


def test_the_recording_is_the_clips_with_a_blueprint_for_all_and_rerun_can_read_it(file: Path) -> None:
    reader = RrdReader(file)
    (recording,), (blueprint,) = reader.recordings(), reader.blueprints()
    assert recording.recording_id == "suite/7"
    assert recording.application_id == blueprint.application_id == "dynamics"
    tool = Path(sys.executable).with_name("rerun")
    subprocess.run([tool, "rrd", "verify", file], check=True, capture_output=True)


def test_a_scene_alone_and_pictures_alone_can_be_shown(footage: Footage, trace: Trace, tmp_path: Path) -> None:
    blind = Scene(SCENE.objects, None, SCENE.gravity, None)
    save(Footage("scene", "", (MotionLayer("scene", blind, trace),), times=SCHEDULE.times), tmp_path / "scene.rrd")
    save(Footage("pictures", "", (), footage.seen, times=SCHEDULE.times), tmp_path / "pictures.rrd")
    assert rows(tmp_path / "scene.rrd", "world/scene/ball")
    assert len(rows(tmp_path / "pictures.rrd", "world/camera/rgb")) == 30


@pytest.mark.parametrize("name", SIZE_KEYS)
@pytest.mark.parametrize("solid", [True, False])
def test_every_shape_can_be_drawn(name: str, solid: bool, tmp_path: Path) -> None:
    mesh = tmp_path / "mesh.obj"
    corners = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    mesh.write_text("\n".join([*corners, "f 1 2 3", "f 2 3 4", "f 5 6 7", "f 6 7 8"]) + "\n")
    size = (0.1, 0.4) if name == "capsule" else (0.3,) * len(SIZE_KEYS[name])
    body = SceneObject(name, size, 1.0, name="body", file=str(mesh) if name == "mesh" else None)
    assert len(list(shape(body, (1, 2, 3), solid).as_component_batches())) > 0


def test_fixed_bodies_stand_in_the_scene_and_events_name_them(tmp_path: Path) -> None:
    ramp = FixedBody("box", (1.0, 0.5, 0.1), (0.0, 0.0, 0.2), (0.98, 0.0, 0.2, 0.0), name="ramp")
    wall = FixedBody("plane", (), (2.0, 0.0, 0.0), (1.0, 0.0, -1.0, 0.0), name="wall")
    scene = Scene((SceneObject("sphere", (0.1,), 1.0, position=(0, 0, 0.8), name="ball"),), fixed=(ramp, wall))
    trace = simulate(scene)
    areas = np.full((SCHEDULE.frames, 1), 1000.0)
    found = find_events(trace, scene.shapes, areas, SCHEDULE.frame_steps, DEFAULT_THRESHOLDS)
    assert event_text(found[0], scene) == "ball hits ramp"
    save(
        Footage("scene", "", (MotionLayer("scene", scene, trace, True, tuple(found)),), times=SCHEDULE.times),
        tmp_path / "a.rrd",
    )
    (drawn,) = (r for r in rows(tmp_path / "a.rrd", "world/scene/ramp", static=True) if "Boxes3D:half_sizes" in r)
    assert drawn["Boxes3D:half_sizes"] == [pytest.approx([0.5, 0.25, 0.05])]
    assert rows(tmp_path / "a.rrd", "world/scene/wall", static=True)
    assert rows(tmp_path / "a.rrd", "events/scene")[0]["TextLog:text"] == ["ball hits ramp"]
    labels = {t for r in rows(tmp_path / "a.rrd", "world/scene/contacts") for t in r["Arrows3D:labels"] or []}
    assert any(t.startswith("ball on ramp: ") for t in labels)


def test_a_recording_that_cannot_be_written_leaves_nothing(footage: Footage, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="file"):
        save(footage, tmp_path / "file" / "a.rrd")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_every_event_can_be_told() -> None:
    assert event_text(Event(0, "leaves", 1), SCENE) == "crate leaves the view"
    assert event_text(Event(0, "starts_rolling", 0), SCENE) == "ball starts rolling"
