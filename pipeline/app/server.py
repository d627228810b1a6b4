"""The web server of `dynamics app`: pages, JSON, uploads and downloads. It trusts none of what it is sent.

A request is answered only where its Host is ours (no other name that was pointed at this machine), and where one that
changes something comes from our own page (a header that other pages cannot send).
"""

from __future__ import annotations

import functools
import io
import ipaddress
import json
import shutil
import socket
import sys
import tempfile
import traceback
import zipfile
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np

from pipeline.app.uploads import KINDS, UploadError, check_upload, receive, shown_name
from pipeline.app.visitor import Visitor
from pipeline.app.visitors import Visitors
from pipeline.errors import DynamicsError, OutputError, ParamsError
from pipeline.viewer.page.result_page import FOLDER as PAGE_FOLDER
from pipeline.vision.recordings.clip_folder import video_of
from pipeline.vision.recordings.video import read_clip
from pipeline.vision.rendering.appearance import PALETTE, object_colour

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SAMPLES = (ROOT / "data" / "films", ROOT / "data" / "samples")
EXAMPLE = ROOT / "data" / "measured" / "thrown_ball"
COOKIE = "dynamics_visitor"
OUR_HEADER = "X-Dynamics"
MOST_BODY = 2**16  # of JSON
SECONDS_OF_SILENCE = 60
THUMBNAIL = (300, 200)  # px
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; media-src 'self' blob:; "
    "connect-src 'self'; frame-src 'self'; form-action 'none'; base-uri 'none'; frame-ancestors 'self'"
)
REPORT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; frame-ancestors 'self'"
TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".jpg": "image/jpeg",
    ".js": "text/javascript",
    ".mp4": "video/mp4",
    ".zip": "application/zip",
}
STATIC = {
    "/": HERE / "app.html",
    "/app.css": HERE / "app.css",
    "/app.js": HERE / "app.js",
    "/page.css": PAGE_FOLDER / "page.css",
    "/player.js": PAGE_FOLDER / "player.js",
    "/viewer.js": PAGE_FOLDER / "viewer.js",
}


class AppServer(ThreadingHTTPServer):
    """The server and its visitors; `server_close` ends all jobs and removes all files."""

    daemon_threads = True

    def __init__(self, host: str, port: int) -> None:
        self.loopback = _is_loopback(host)
        self.root = Path(tempfile.mkdtemp(prefix="dynamics-app-"))
        self.visitors = Visitors(self.root)
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as error:
            self._forget_visitors()
            reason = getattr(error, "strerror", None) or error
            raise OutputError(f"--host {host} --port {port}: cannot listen there: {reason}") from None

    @property
    def address(self) -> str:
        host, port = str(self.server_address[0]), self.server_address[1]
        return f"http://{f'[{host}]' if ':' in host else host}:{port}/"

    def server_close(self) -> None:
        super().server_close()
        self._forget_visitors()

    def _forget_visitors(self) -> None:
        self.visitors.close()
        shutil.rmtree(self.root, ignore_errors=True)

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):  # the visitor has left
            traceback.print_exc()


class Handler(BaseHTTPRequestHandler):
    """One connection."""

    server: AppServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "dynamics", ""
    timeout = SECONDS_OF_SILENCE

    def do_GET(self) -> None:
        self._answer(self._get)

    def do_POST(self) -> None:
        self._answer(self._post)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the window has the address and defects only."""

    def _answer(self, act: Callable[[str, dict[str, str]], None]) -> None:
        url = urlsplit(self.path)
        words = {key: values[-1] for key, values in parse_qs(url.query).items()}
        try:
            if not self._is_our_host():
                self._refuse(HTTPStatus.FORBIDDEN, "this server answers under its own address only")
                return
            act(url.path, words)
        except DynamicsError as error:
            visitor = self._visitor()
            text = " ".join(str(error).split())
            self._refuse(HTTPStatus.BAD_REQUEST, visitor.plain(text) if visitor else text)
        except ConnectionError:
            raise
        except Exception:
            traceback.print_exc()
            with suppress(OSError):
                self._refuse(
                    HTTPStatus.INTERNAL_SERVER_ERROR, "something went wrong inside; the server's window has it"
                )

    # ---- what is asked for

    def _get(self, path: str, words: dict[str, str]) -> None:
        if path in STATIC:
            headers = {}
            if path == "/" and self._visitor() is None:
                token, _ = self.server.visitors.add()
                headers["Set-Cookie"] = f"{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict"
            self._send_file(STATIC[path], headers=headers)
            return
        visitor = self._known_visitor()
        match path:
            case "/api/state":
                self._send_json(_state(visitor))
            case "/api/job":
                self._send_json(visitor.status())
            case _ if path.startswith("/files/samples/") and Path(path).stem in samples():
                self._send_bytes(_thumbnail(Path(path).stem), ".jpg")
            case "/files/clip.mp4" if visitor.bodies is not None:
                self._send_file(visitor.bodies.folder / "clip.mp4")
            case "/files/result.mp4" if visitor.result is not None:
                self._send_file(visitor.result.film)
            case "/files/report.html" if visitor.discovery is not None:
                self._send_file(visitor.discovery[0] / "report.html", policy=REPORT_POLICY)
            case "/download/page.html" if visitor.result is not None:
                edited = visitor.result.edited
                page = visitor.result.folder / "page.html" if edited is None else edited / "edited.html"
                self._send_file(page, save_as="page.html")
            case "/download/result.zip" if visitor.result is not None:
                parts = [
                    visitor.result.folder / "out",
                    *([visitor.result.edited / "edited"] if visitor.result.edited else []),
                ]
                self._send_bytes(_zipped(parts), ".zip", save_as="result.zip")
            case "/download/discovery.zip" if visitor.discovery is not None:
                self._send_bytes(_zipped([visitor.discovery[0]]), ".zip", save_as="discovery.zip")
            case _:
                self._refuse(HTTPStatus.NOT_FOUND, "there is nothing at this address")

    def _post(self, path: str, words: dict[str, str]) -> None:
        if self.headers.get(OUR_HEADER) != "1":
            self._refuse(HTTPStatus.FORBIDDEN, "this server takes requests from its own page only")
            return
        visitor = self._known_visitor()
        if path == "/api/upload":
            self._upload(visitor, words)
            return
        body = self._json_body()
        if path == "/api/cancel":
            visitor.cancel()
            self._send_json(visitor.status())
            return
        with visitor.lock:
            self._send_json(self._changed(visitor, path, body))

    def _changed(self, visitor: Visitor, path: str, body: dict[str, Any]) -> dict[str, Any]:
        match path:
            case "/api/sample":
                name = str(body.get("name"))
                if name not in samples():
                    raise ParamsError(f"{name!r} is no sample; valid: {', '.join(samples())}")
                visitor.take_clip(samples()[name], {})
            case "/api/bodies":
                points = [(_number(x, "x"), _number(y, "y")) for x, y in _pairs(body.get("points", []))]
                visitor.change_bodies(str(body.get("action")), int(_number(body.get("frame", 0), "frame")), points)
                return visitor.status() if visitor.busy else _state(visitor)
            case "/api/infer":
                length = body.get("length")
                known = None if length is None else tuple(_number(v, "length") for v in length)
                visitor.infer(str(body.get("search")), _number(body.get("gravity"), "gravity"), known)
            case "/api/live":
                return visitor.live(body)
            case "/api/edit":
                visitor.edit(body)
            case "/api/discover":
                if body.get("example"):
                    visitor.table, visitor.known = EXAMPLE.with_suffix(".csv"), EXAMPLE.with_suffix(".yaml")
                visitor.discover()
            case _:
                raise ParamsError(f"{path}: there is nothing at this address")
        return visitor.status()

    def _upload(self, visitor: Visitor, words: dict[str, str]) -> None:
        """Take a file, whose bytes are the body. What is refused is not read."""
        try:
            kind, name = words.get("kind", ""), words.get("name", "")
            length = int(self.headers.get("Content-Length") or 0)
            check_upload(kind, name, length)
            if visitor.busy:
                raise ParamsError("your run is still going; wait for it, or cancel it first")
            options = {k: _number(float(words[k]), k) for k in ("start", "seconds", "fps") if words.get(k)}
            if any(v < 0 or (v == 0 and k != "start") for k, v in options.items()):
                raise ParamsError("start, seconds and frames a second are numbers greater than 0")
        except (DynamicsError, ValueError) as error:
            self.close_connection = True  # the rest of the body is not read
            raise error if isinstance(error, DynamicsError) else UploadError("start, seconds, fps: numbers") from None
        place = visitor.place_for(shown_name(name))
        try:
            receive(self.rfile, length, place)  # type: ignore[arg-type]
            with visitor.lock:
                if kind == "clip":
                    visitor.take_clip(place, options)
                elif kind == "table":
                    visitor.table = place
                else:
                    visitor.known = place
        except BaseException:
            shutil.rmtree(place.parent, ignore_errors=True)
            self.close_connection = True
            raise
        self._send_json(visitor.status() if kind == "clip" else _state(visitor))

    # ---- who asks

    def _is_our_host(self) -> bool:
        """Whether the address in the request is this machine's: a page elsewhere may point its own name at it."""
        if not self.server.loopback:
            return True
        name = urlsplit(f"//{self.headers.get('Host', '')}").hostname
        return name == "localhost" or _is_loopback(name or "")

    def _visitor(self) -> Visitor | None:
        try:
            cookie = SimpleCookie(self.headers.get("Cookie", "")).get(COOKIE)
        except CookieError:
            return None
        return self.server.visitors.get(None if cookie is None else cookie.value)

    def _known_visitor(self) -> Visitor:
        visitor = self._visitor()
        if visitor is None:
            raise ParamsError("the server does not know you any more; load the page again")
        return visitor

    def _json_body(self) -> dict[str, Any]:
        try:
            length = int(self.headers.get("Content-Length") or 0)
        except ValueError:
            length = -1
        if not 0 <= length <= MOST_BODY:
            self.close_connection = True
            raise ParamsError(f"a request has at most {MOST_BODY} bytes")
        try:
            found = json.loads(self.rfile.read(length) or b"{}")
        except (ValueError, RecursionError):
            raise ParamsError("the request is not JSON") from None
        if not isinstance(found, dict):
            raise ParamsError("the request is not a JSON object")
        return found

    # ---- answers

    def _send_json(self, data: Any) -> None:
        self._send(HTTPStatus.OK, json.dumps(data).encode(), "application/json")

    def _refuse(self, status: HTTPStatus, message: str) -> None:
        self._send(status, json.dumps({"error": message}).encode(), "application/json")

    def _send_file(
        self, path: Path, headers: dict[str, str] | None = None, policy: str = POLICY, save_as: str | None = None
    ) -> None:
        self._send_bytes(path.read_bytes(), path.suffix, headers=headers, policy=policy, save_as=save_as)

    def _send_bytes(
        self,
        data: bytes,
        suffix: str,
        *,
        headers: dict[str, str] | None = None,
        policy: str = POLICY,
        save_as: str | None = None,
    ) -> None:
        more = dict(headers or {})
        if save_as is not None:
            more["Content-Disposition"] = f'attachment; filename="{save_as}"'
        self._send(HTTPStatus.OK, data, TYPES[suffix], headers=more, policy=policy)

    def _send(
        self,
        status: HTTPStatus,
        data: bytes,
        kind: str,
        *,
        headers: dict[str, str] | None = None,
        policy: str = POLICY,
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8" if kind.startswith("text/") else kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        if self.close_connection:
            self.send_header("Connection", "close")
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(data)


def _state(visitor: Visitor) -> dict[str, Any]:
    """What the page shows, with what is the same for all visitors."""
    return visitor.state() | {
        "samples": list(samples()),
        "palette": [object_colour(i) for i in range(len(PALETTE))],
        "limits": {name: kind.most_bytes for name, kind in KINDS.items()},
    }


def samples() -> dict[str, Path]:
    """The clips that ship, by name: real films, which are files, then rendered ones, folders with their masks."""
    places = [p for folder in SAMPLES if folder.is_dir() for p in sorted(folder.iterdir())]
    return {p.stem: p for p in places if p.is_dir() or p.suffix == ".mp4"}


@functools.cache
def _thumbnail(sample: str) -> bytes:
    """A JPEG of a sample's middle."""
    frames = read_clip(video_of(samples()[sample]), 0.3, 0.4, size=THUMBNAIL).frames
    return cv2.imencode(".jpg", np.ascontiguousarray(frames[len(frames) // 2][..., ::-1]))[1].tobytes()


def _zipped(folders: list[Path]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for folder in folders:
            for path in sorted(p for p in folder.rglob("*") if p.is_file()):
                archive.write(path, f"{folder.name}/{path.relative_to(folder)}")
    return data.getvalue()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
        raise ParamsError(f"{name}: {str(value)[:40]} is not a number")
    return value


def _pairs(values: Any) -> list[tuple[Any, Any]]:
    if not isinstance(values, list) or len(values) > 10 or any(not isinstance(v, list) or len(v) != 2 for v in values):
        raise ParamsError("points: a list of places [x, y]")
    return [(v[0], v[1]) for v in values]
