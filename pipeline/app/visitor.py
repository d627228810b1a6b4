"""What one visitor of the page has: a clip, its bodies, the scene that was found, edits, and a job that runs."""

from __future__ import annotations

import re
import shutil
import threading
import time
import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.app import body_masks
from pipeline.app.body_masks import BodyMasks
from pipeline.app.job import ENDED, Job, JobQueue
from pipeline.app.live_replay import LiveScene
from pipeline.app.sliders import edits_of, gravity_slider, read_changes, sliders_of
from pipeline.editing.filmed_clip import CLIP, read_clip
from pipeline.errors import ParamsError, VideoError
from pipeline.scene.scene import Scene
from pipeline.scene.text import load_scene
from pipeline.untrusted import read_npz

SEARCHES = {"quick": 600, "usual": 2000, "thorough": 6000}
MASKS = "masks.npz"


@dataclass
class Bodies:
    """What was found in the clip.

    Attributes:
        folder: Of the job.
        found: The worker's record (`find_bodies`).
        masks: As they are after clicks.
        times: (T,) s of the video.
    """

    folder: Path
    found: dict[str, Any]
    masks: BodyMasks
    times: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """px, width and height of the masks."""
        return int(self.masks.masks.shape[2]), int(self.masks.masks.shape[1])


@dataclass
class Result:
    """A scene that was found.

    Attributes:
        folder: Of the job: `out`, `page.html`, `result.mp4`.
        found: The worker's record (`infer_scene`).
        live: For the sliders.
        edited: Folder of the job that edited the clip, where one did.
    """

    folder: Path
    found: dict[str, Any]
    live: LiveScene
    edited: Path | None = None
    edit_note: str = ""

    @property
    def scene(self) -> Scene:
        return self.live.scene

    @property
    def film(self) -> Path:
        """What the page shows: with the edited clip where there is one."""
        return (self.edited or self.folder) / "result.mp4"


@dataclass
class Visitor:
    """One visitor. Methods are called from the threads of requests, one at a time (`lock`)."""

    folder: Path
    queue: JobQueue
    clip: Path | None = None
    bodies: Bodies | None = None
    result: Result | None = None
    table: Path | None = None
    known: Path | None = None
    discovery: tuple[Path, str] | None = None
    job: Job | None = None
    version: int = 0
    seen: float = field(default_factory=time.monotonic)
    lock: threading.RLock = field(default_factory=threading.RLock)

    @property
    def busy(self) -> bool:
        return self.job is not None and self.job.state not in ENDED

    @property
    def is_empty(self) -> bool:
        """Whether the visitor has done nothing yet."""
        return self.job is None and self.clip is None and self.table is None and self.known is None

    def take_clip(self, clip: Path, options: dict[str, Any]) -> None:
        """Begin with another clip: its bodies are looked for. options: `start`, `seconds`, `fps`, each perhaps None."""
        self._check_free()
        self._forget_clip()
        self.clip = clip
        wanted = {k: options.get(k) for k in ("start", "seconds", "fps") if options.get(k) is not None}
        self._start(
            "bodies", {"clip": str(clip), **wanted}, lambda folder, found: self._take_bodies(folder, found, wanted)
        )

    def change_bodies(self, action: str, frame: int, points: list[tuple[float, float]]) -> None:
        """Change bodies by clicks, (x, y) px of the masks. Raises ParamsError where they mean nothing."""
        self._check_free()
        bodies = self._bodies()
        masks = bodies.masks.masks
        needed = {"add": 1, "box": 2, "drop": 1, "join": 2, "split": 2, "undo": 0}
        if action not in needed:
            raise ParamsError(f"{action!r} is no change of bodies; valid: {', '.join(needed)}")
        if len(points) != needed[action] or not 0 <= frame < len(masks):
            raise ParamsError(f"{action} takes {needed[action]} places in a frame of the clip")
        match action:
            case "undo":
                bodies.masks = bodies.masks.undone()
            case "drop":
                new = body_masks.dropped(masks, body_masks.body_at(masks, frame, points[0]))
                bodies.masks = bodies.masks.changed(new)
            case "join":
                pair = [body_masks.body_at(masks, frame, p) for p in points]
                bodies.masks = bodies.masks.changed(body_masks.joined(masks, *pair))
            case "split":
                bodies.masks = bodies.masks.changed(body_masks.split(masks, frame, points[0], points[1]))
            case _:
                self._search_body(action, frame, points)
                return
        self.version += 1

    def infer(self, search: str, gravity: float, length: tuple[float, ...] | None) -> None:
        """Find the scene. length: x0, y0, x1, y1, px of the masks, and m."""
        self._check_free()
        bodies = self._bodies()
        if search not in SEARCHES:
            raise ParamsError(f"search: {search!r}; valid: {', '.join(SEARCHES)}")
        if not 0 < gravity <= 1000:
            raise ParamsError(f"gravity: {gravity:g} m/s²; valid: greater than 0, at most 1000")
        if length is not None and not (len(length) == 5 and 0 < length[4] < 1e4):
            raise ParamsError("the length: two places and a number of metres, greater than 0")
        np.savez_compressed(bodies.folder / MASKS, masks=bodies.masks.masks, times=bodies.times)
        scale = bodies.found["source"][0] / bodies.size[0]
        known = None if length is None else [*(scale * v for v in length[:4]), length[4]]
        request = {
            "clip": str(self.clip),
            "masks": str(bodies.folder / MASKS),
            "start": bodies.found["start"],
            "seconds": bodies.found["seconds"],
            "fps": bodies.found.get("fps"),
            "search": SEARCHES[search],
            "gravity": gravity,
            "length": known,
        }
        self._start("infer", request, self._take_result)

    def live(self, changes: Any) -> dict[str, Any]:
        """The replay with the sliders as they are (`LiveScene.replay`)."""
        return self._result().live.replay(read_changes(changes))

    def edit(self, changes: Any) -> None:
        """Edit the clip as the sliders say."""
        self._check_free()
        result = self._result()
        edits = edits_of(result.scene, read_changes(changes))
        if not edits:
            raise ParamsError("no slider was moved, so that the clip would stay as it is")
        request = {
            "found": str(result.folder / "out"),
            "film": str(result.folder / "result.mp4"),
            "record": result.found["film"],
            "edits": edits,
        }
        self._start("edit", request, self._take_edit)

    def discover(self) -> None:
        """Compare the table with the scene."""
        self._check_free()
        if self.table is None or self.known is None:
            raise ParamsError("a table of measured motion and a scene are needed; give both, or take the example")
        request = {"table": str(self.table), "scene": str(self.known)}
        self._start("discover", request, self._take_discovery)

    def cancel(self) -> None:
        """End what runs."""
        if self.job is not None:
            self.job.cancel()

    def state(self) -> dict[str, Any]:
        """All that the page shows, for JSON."""
        bodies, result = self.bodies, self.result
        return {
            "version": self.version,
            "clip": None if self.clip is None else self.clip.name,
            "bodies": None
            if bodies is None
            else {
                **{k: bodies.found[k] for k in ("film", "source", "times", "notes")},
                "size": bodies.size,
                "count": bodies.masks.count,
                "outlines": body_masks.outlines(bodies.masks.masks),
                "can_undo": bool(bodies.masks.before),
            },
            "result": None
            if result is None
            else {
                **result.found,
                "edited": result.edited is not None,
                "edit_note": result.edit_note,
                "gravity": vars(gravity_slider(result.scene)),
                "objects": [
                    {"name": o.name, "sliders": [vars(s) for s in sliders_of(o)]} for o in result.scene.objects
                ],
            },
            "discovery": None if self.discovery is None else self.discovery[1],
            "table": None if self.table is None else self.table.name,
            "known": None if self.known is None else self.known.name,
        }

    def status(self) -> dict[str, Any]:
        """Of the job, with how many are before it; messages without the names of our folders."""
        if self.job is None:
            return {"state": "none", "version": self.version}
        status = self.job.status()
        status["error"] = self.plain(status["error"])
        status["lines"] = [self.plain(line) for line in status["lines"]]
        return status | {"before": self.queue.before(self.job), "version": self.version}

    def plain(self, text: str) -> str:
        """A message without the folder of the visitor."""
        return re.sub(re.escape(str(self.folder)) + r"/(upload/[0-9a-f]{32}/)?", "", text)

    def place_for(self, name: str) -> Path:
        """Where an upload goes, under a name that is not taken."""
        folder = self.folder / "upload" / uuid.uuid4().hex
        folder.mkdir(parents=True)
        return folder / name

    def close(self) -> None:
        """End what runs and remove all files."""
        self.cancel()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _start(self, kind: str, request: dict[str, Any], take: Any) -> None:
        folder = self.folder / f"{kind}-{uuid.uuid4().hex[:8]}"
        folder.mkdir()

        def done(found: dict[str, Any]) -> None:
            take(folder, found)
            self.version += 1

        request = request | {"kind": kind, "folder": str(folder)}
        self.job = Job(kind, request, folder, done)
        self.queue.add(self.job)

    def _take_bodies(self, folder: Path, found: dict[str, Any], options: dict[str, Any]) -> None:
        arrays = read_npz(folder / MASKS, ("masks", "times"), VideoError)
        found |= {"fps": options.get("fps")}
        self.bodies = Bodies(folder, found, BodyMasks(arrays["masks"].copy()), arrays["times"])

    def _search_body(self, action: str, frame: int, points: list[tuple[float, float]]) -> None:
        """Look for a body at a point or in a box; the others stay as they are."""
        bodies = self._bodies()
        scale = bodies.found["source"][0] / bodies.size[0]
        mark = [*(scale * v for p in points for v in p), float(bodies.times[frame])]
        x, y = np.mean(points, axis=0)

        def take(folder: Path, found: dict[str, Any]) -> None:
            new = read_npz(folder / MASKS, ("masks",), VideoError)["masks"]
            shutil.rmtree(folder, ignore_errors=True)
            if new.shape != bodies.masks.masks.shape:
                raise ParamsError("the clip was read otherwise than before")
            body = body_masks.body_at(new, frame, (float(x), float(y)))
            bodies.masks = bodies.masks.changed(body_masks.added(bodies.masks.masks, new == body))

        request = {
            "clip": str(self.clip),
            "start": bodies.found["start"],
            "seconds": bodies.found["seconds"],
            "fps": bodies.found.get("fps"),
            "points" if action == "add" else "boxes": [mark],
        }
        self._start("bodies", request, take)

    def _take_result(self, folder: Path, found: dict[str, Any]) -> None:
        clip = read_clip(folder / "out" / CLIP)
        height, width = clip.masks.shape[1:]
        scene = load_scene(folder / "out" / "scene.yaml")
        live = LiveScene.of(scene, clip.schedule, (width, height))
        self._forget_result()
        self.result = Result(folder, found, live)

    def _take_edit(self, folder: Path, found: dict[str, Any]) -> None:
        result = self._result()
        if result.edited is not None:
            shutil.rmtree(result.edited, ignore_errors=True)
        result.edited, result.edit_note = folder, found["note"]
        result.found = result.found | {"shown": found["film"]}

    def _take_discovery(self, folder: Path, found: dict[str, Any]) -> None:
        if self.discovery is not None:
            shutil.rmtree(self.discovery[0], ignore_errors=True)
        self.discovery = (folder / "found", found["sentence"])

    def _check_free(self) -> None:
        if self.busy:
            raise ParamsError("your run is still going; wait for it, or cancel it first")

    def _bodies(self) -> Bodies:
        if self.bodies is None:
            raise ParamsError("there is no clip yet; choose one first")
        return self.bodies

    def _result(self) -> Result:
        if self.result is None:
            raise ParamsError("there is no scene yet; let one be found first")
        return self.result

    def _forget_clip(self) -> None:
        self._forget_result()
        if self.bodies is not None:
            shutil.rmtree(self.bodies.folder, ignore_errors=True)
        if self.clip is not None and self.clip.is_relative_to(self.folder):
            shutil.rmtree(self.clip.parent, ignore_errors=True)
        self.bodies = self.clip = None
        self.version += 1

    def _forget_result(self) -> None:
        if self.result is not None:
            for folder in (self.result.folder, self.result.edited):
                if folder is not None:
                    shutil.rmtree(folder, ignore_errors=True)
        self.result = None
