"""The process that computes one job: `python -m pipeline.app.worker`, a request (JSON) on stdin, answers on stdout.

Each answer is a line of JSON with some of `step`, `share`, `line`, `error` and `result`. Where stdin closes, because
the server has ended in whatever way, the process ends, too.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from pipeline.errors import DynamicsError
from pipeline.inference.progress import Progress

Request = dict[str, Any]
MOST_WIDTH = 640  # px, of the masks that clicks change


class ToldProgress(Progress):
    """Tells each step to the server."""

    def __init__(self, steps: int, tell: Callable[..., None]) -> None:
        super().__init__(steps)
        self._steps, self._done, self._tell = steps, 0, tell

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        self._tell(step=name, share=self._done / self._steps)
        with super().step(name):
            yield
        self._done = min(self._done + 1, self._steps)
        self._tell(share=self._done / self._steps)

    def detail(self, text: str) -> None:
        self._tell(step=text)

    def say(self, subject: str, text: str) -> None:
        self._tell(line=f"{subject}: {text}" if subject else text)


def find_bodies(request: Request, folder: Path, tell: Callable[..., None]) -> dict[str, Any]:
    """Find bodies: writes masks.npz and clip.mp4 (what the page shows).

    request: `clip`, and perhaps `start`, `seconds`, `fps`, `points`, `boxes` (px of the video, s from its beginning).
    """
    _check_video(Path(request["clip"]))
    import cv2
    import numpy as np

    from pipeline.api.masks import masks
    from pipeline.bodies.prompts import Prompts
    from pipeline.viewer.page.film import Panel, film

    found = masks(
        request["clip"],
        start=request.get("start"),
        seconds=request.get("seconds"),
        fps=request.get("fps"),
        prompts=Prompts.of(points=request.get("points", ()), boxes=request.get("boxes", ())),
        progress=ToldProgress(2, tell),
    )
    seen = found.found.clip
    height, width = found.masks.shape[1:]
    small = min(1.0, MOST_WIDTH / width)
    size = (2 * round(width * small / 2), 2 * round(height * small / 2))
    ids = np.stack([cv2.resize(m, size, interpolation=cv2.INTER_NEAREST_EXACT) for m in found.masks])
    frames = np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in seen.frames])
    np.savez_compressed(folder / "masks.npz", masks=ids, times=seen.source_times)
    fps = 1 / float(np.median(np.diff(seen.source_times)))
    shown = film([Panel("the clip", frames)], fps, most_width=MOST_WIDTH)
    (folder / "clip.mp4").write_bytes(shown.video)
    return {
        "film": shown.record(),
        "source": [width, height],
        "start": found.start,
        "seconds": found.seconds,
        "times": [round(float(t), 4) for t in seen.source_times],
        "notes": [*found.found.notes, *found.found.doubts],
    }


def _check_video(clip: Path) -> None:
    """Raise VideoError for a file that is no video, before what takes seconds to load is loaded."""
    from pipeline.vision.recordings.clip_folder import video_of
    from pipeline.vision.recordings.video import Decoder, check_file

    check_file(video_of(clip))
    Decoder(video_of(clip), 0.0, None).close()


def infer_scene(request: Request, folder: Path, tell: Callable[..., None]) -> dict[str, Any]:
    """Find the scene: writes the folder `out`, out's page, and result.mp4 (what the page shows).

    request: `clip`, `masks`, `start`, `seconds`, `fps`, `search`, `gravity`, `length` ([x0, y0, x1, y1, m] or null).
    """
    from pipeline.api.infer import infer
    from pipeline.inference.filmed_world import World

    progress = ToldProgress(9 + 2 * bool(request["search"]), tell)
    length = request["length"]
    found = infer(
        request["clip"],
        start=request["start"],
        seconds=request["seconds"],
        fps=request.get("fps"),
        masks=request["masks"],
        search=request["search"],
        world=World.of("auto", request["gravity"], length=None if length is None else tuple(length)),
        progress=progress,
    )
    for line in found.doubts:
        tell(line=f"doubt: {line}")
    found.save(folder / "out", progress=progress)
    return _shown(folder, folder / "out")


def edit_clip(request: Request, folder: Path, tell: Callable[..., None]) -> dict[str, Any]:
    """Edit the clip: writes the folder `edited`, its page, and result.mp4 with the edited clip as the last panel.

    request: `found` (the folder of the result), `film` (its result.mp4), `record` (what that shows), `edits`.
    """
    import numpy as np

    from pipeline.api.edit import edit
    from pipeline.api.export import export
    from pipeline.editing.edit_list import Edit
    from pipeline.viewer.page.film import Panel, film
    from pipeline.vision.recordings.video import read_clip

    progress = ToldProgress(4, tell)
    made = edit(request["found"], [Edit(0.0, set=text) for text in request["edits"]], progress)
    made.save(folder / "edited", progress=progress)
    (folder / "edited.html").write_text(export(folder / "edited"), encoding="utf-8")
    record = request["record"]
    both = read_clip(request["film"], seconds=None).frames[: record["frames"]]
    panels = [Panel(p["title"], both[:, :, p["x"] : p["x"] + p["width"]]) for p in record["panels"]]
    shown = film([*panels[:3], Panel("the edited clip", np.asarray(made.pictures.frames))], record["fps"])
    (folder / "result.mp4").write_bytes(shown.video)
    measured, mirrored, invented = (round(100 * share) for share in made.pictures.bodies)
    note = f"of the bodies' pixels {measured} % were seen, {mirrored} % mirrored, {invented} % invented"
    return {"film": shown.record(), "note": note}


def discover(request: Request, folder: Path, tell: Callable[..., None]) -> dict[str, Any]:
    """Compare measured motion with a scene: writes the folder `found`. request: `table`, `scene`."""
    from pipeline.api.discover import discover as find

    progress = ToldProgress(2, tell)
    found = find(request["table"], request["scene"], progress=progress)
    found.save(folder / "found", progress=progress)
    return {"sentence": found.sentence}


def _shown(folder: Path, out: Path) -> dict[str, Any]:
    """Write what the page shows of a result; its record."""
    from pipeline.api.export import result_page
    from pipeline.viewer.page.result_page import html

    page = result_page(out)
    (folder / "page.html").write_text(html(page), encoding="utf-8")
    (folder / "result.mp4").write_bytes(page.film.video)
    return {
        "title": page.title,
        "grade": page.grade,
        "reason": page.reason,
        "film": page.film.record(),
        "motion": page.motion,
        "scene": page.scene,
        "notes": list(page.notes),
    }


WORK: dict[str, Callable[[Request, Path, Callable[..., None]], dict[str, Any]]] = {
    "bodies": find_bodies,
    "discover": discover,
    "edit": edit_clip,
    "infer": infer_scene,
}


def main() -> int:
    """Compute the request on stdin. Exit code 0 where there is a result, 2 where the visitor's data are at fault."""
    out = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8", errors="backslashreplace")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is no answer
    request = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with, args=(sys.stdin,), daemon=True).start()

    def tell(**words: Any) -> None:
        print(json.dumps(words), file=out, flush=True)

    try:
        tell(result=WORK[request["kind"]](request, Path(request["folder"]), tell))
    except MemoryError:
        tell(error="there is not enough memory for this; try a shorter or smaller clip")
        return 2
    except (DynamicsError, OSError) as error:
        tell(error=" ".join(str(error).split()))
        return 2
    except Exception:
        traceback.print_exc()
        return 1
    return 0


def _end_with(stdin: TextIO) -> None:
    """End this process and those that it started when stdin closes."""
    stdin.read()
    os.killpg(os.getpgrp(), signal.SIGKILL)


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    os._exit(code)  # the thread that waits for stdin does not hold it up
