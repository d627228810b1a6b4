"""The server of `dynamics app`: whom it answers, what it takes, and what is left of a run that ends."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from local_server import Guest, files, serving

from pipeline.app.server import REPORT_POLICY, AppServer
from pipeline.app.uploads import KINDS, UploadError
from pipeline.commands.main import main
from pipeline.errors import OutputError


@pytest.fixture
def server() -> Iterator[AppServer]:
    with serving() as made:
        yield made


def alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_the_page_and_its_parts_come_from_this_server_alone(server: AppServer) -> None:
    guest = Guest(server)
    for path in ("/", "/app.js", "/app.css", "/page.css", "/player.js", "/viewer.js"):
        status, headers, body = guest.send("GET", path)
        assert status == 200
        assert b"http" not in body.replace(b'http-equiv="', b"")
        assert headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self';")
        assert headers["X-Content-Type-Options"] == "nosniff"
    assert "sandbox" in REPORT_POLICY
    assert guest.send("GET", "/../pyproject.toml")[0] == 404
    assert guest.send("GET", "/files/samples/..%2f..%2fx.jpg")[0] == 404
    for sample in guest.get("/api/state")["samples"]:
        assert guest.send("GET", f"/files/samples/{sample}.jpg")[2][:2] == b"\xff\xd8"


def test_requests_of_other_pages_and_other_names_are_refused(server: AppServer) -> None:
    guest = Guest(server)
    for host in ("evil.example", "127.0.0.1.evil.example:80", ""):
        assert guest.send("GET", "/api/state", headers={"Host": host})[0] == 403
    assert guest.send("GET", "/api/state", headers={"Host": f"localhost:{guest.port}"})[0] == 200
    assert guest.send("POST", "/api/sample", b'{"name": "cross_engine_17"}')[0] == 403
    assert "load the page again" in json.loads(guest.send("GET", "/api/state", cookie="dynamics_visitor=x")[2])["error"]
    assert guest.get("/api/job")["state"] == "none"


@pytest.mark.parametrize(
    ("path", "body", "message"),
    [
        ("/api/sample", {"name": "../../x"}, "is no sample; valid: tennisball_toss_wall, cross_engine_01"),
        ("/api/bodies", {"action": "drop", "frame": 0, "points": [[1, 2]]}, "there is no clip yet"),
        ("/api/bodies", {"points": "here"}, "a list of places"),
        ("/api/infer", {"search": "usual", "gravity": 9.81}, "there is no clip yet"),
        ("/api/infer", {"search": "usual", "gravity": "x"}, "gravity: x is not a number"),
        ("/api/live", {}, "there is no scene yet"),
        ("/api/edit", {}, "there is no scene yet"),
        ("/api/discover", {}, "a table of measured motion and a scene are needed"),
        ("/api/none", {}, "nothing at this address"),
        ("/api/live", "x" * 100_000, "at most 65536 bytes"),
        ("/api/live", [1], "not a JSON object"),
    ],
)
def test_a_request_that_makes_no_sense_is_one_sentence(server: AppServer, path: str, body, message: str) -> None:
    assert message in Guest(server).post(path, body)["error"]


def test_an_upload_of_2_gb_is_refused_before_it_is_read(server: AppServer) -> None:
    guest = Guest(server)
    with socket.create_connection(("127.0.0.1", guest.port)) as line:
        line.sendall(
            b"POST /api/upload?kind=clip&name=long.mp4 HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Dynamics: 1\r\n"
            + f"Cookie: {guest.cookie}\r\nContent-Length: {2**31}\r\n\r\n".encode()
        )
        answer = b"".join(iter(lambda: line.recv(65536), b"")).decode()
    assert "long.mp4 has 2,048 MiB; at most 500 MiB are taken" in answer
    assert "Connection: close" in answer
    assert files(server.root) == []
    assert guest.get("/api/state")["clip"] is None


def test_two_visitors_have_their_own_files(server: AppServer) -> None:
    one, other = Guest(server), Guest(server)
    assert one.upload("table", "flight.csv", b"clip,object,time,x,y,z\n")["table"] == "flight.csv"
    assert other.upload("scene", "flat.yaml", b"objects: []\n")["known"] == "flat.yaml"
    assert [one.get("/api/state")[k] for k in ("table", "known")] == ["flight.csv", None]
    assert [other.get("/api/state")[k] for k in ("table", "known")] == [None, "flat.yaml"]
    assert "is no scene; valid: .yaml" in one.upload("scene", "flat.txt", b"x")["error"]


def test_a_wrong_table_is_one_sentence_without_our_folders_and_nothing_is_left(server: AppServer) -> None:
    guest = Guest(server)
    guest.upload("table", "flight.csv", b"a,b\n1,2\n")
    guest.upload("scene", "flat.yaml", b"objects: []\n")
    before = files(server.root)
    guest.post("/api/discover")
    status = guest.wait("failed")
    assert str(server.root) not in status["error"]
    assert "flat.yaml" in status["error"] or "flight.csv" in status["error"]
    assert files(server.root) == before


def test_runs_wait_for_each_other_and_a_cancelled_run_leaves_nothing(server: AppServer) -> None:
    one, other = Guest(server), Guest(server)
    one.post("/api/sample", {"name": "cross_engine_17"})
    one.wait("running")
    assert "your run is still going" in one.post("/api/sample", {"name": "cross_engine_01"})["error"]
    waiting = other.post("/api/sample", {"name": "cross_engine_02"})
    assert (waiting["state"], waiting["before"]) == ("waiting", 1)
    (running,) = (v for v in server.visitors._all.values() if v.job is not None and v.job.state == "running")
    assert running.job is not None
    with running.job._lock:  # held until its process has begun
        assert running.job._process is not None
        pid = running.job._process.pid
    assert one.post("/api/cancel")["state"] == "cancelled"
    assert not alive(pid)
    assert other.post("/api/cancel")["state"] == "cancelled"
    assert one.wait("cancelled")["state"] == "cancelled"
    end = time.monotonic() + 20
    while any(server.root.rglob("bodies-*")) and time.monotonic() < end:
        time.sleep(0.05)
    assert files(server.root) == []
    assert not any(server.root.rglob("bodies-*"))
    assert one.get("/api/state")["bodies"] is None


@pytest.mark.slow
def test_a_text_named_mp4_is_one_sentence_and_the_next_clip_is_taken(server: AppServer) -> None:
    guest = Guest(server)
    guest.upload("clip", "notes.mp4", b"this is a text\n" * 100)
    error = guest.wait("failed")["error"]
    assert error.startswith("notes.mp4 is not a video that FFmpeg can read")
    guest.upload("clip", "notes.mp4", b"again\n")
    assert guest.wait("failed")["error"].startswith("notes.mp4 is not a video")
    assert guest.post("/api/sample", {"name": "cross_engine_17"})["state"] in ("waiting", "running")
    guest.post("/api/cancel")


def test_the_server_leaves_nothing_and_no_process_when_it_ends() -> None:
    with serving() as server:
        guest = Guest(server)
        guest.post("/api/sample", {"name": "cross_engine_17"})
        guest.wait("running")
        (visitor,) = server.visitors._all.values()
        assert visitor.job is not None
        end = time.monotonic() + 20
        while visitor.job._process is None and time.monotonic() < end:
            time.sleep(0.01)
        assert visitor.job._process is not None
        pid = visitor.job._process.pid
    assert not alive(pid)
    assert not server.root.exists()


def test_a_worker_ends_where_its_server_was_killed(tmp_path: Path) -> None:
    request = {"kind": "bodies", "clip": "data/samples/cross_engine_17", "folder": str(tmp_path)}
    code = f"""import subprocess, sys, time
p = subprocess.Popen([sys.executable, "-m", "pipeline.app.worker"], stdin=subprocess.PIPE, start_new_session=True)
p.stdin.write({json.dumps(request).encode()!r} + b"\\n"); p.stdin.flush()
print(p.pid, flush=True); time.sleep(600)"""
    server = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert server.stdout is not None
    worker = int(server.stdout.readline())
    os.kill(server.pid, signal.SIGKILL)
    server.wait()
    end = time.monotonic() + 60
    while alive(worker) and time.monotonic() < end:
        time.sleep(0.05)
    assert not alive(worker)


def test_there_is_room_for_so_many_visitors_and_idle_ones_make_room(server: AppServer) -> None:
    visitors = server.visitors
    visitors.most = 2
    one, other = Guest(server), Guest(server)
    one.upload("table", "flight.csv", b"clip\n")
    third = Guest(server)  # in the place of the one who has done nothing
    assert "load the page again" in other.get("/api/state")["error"]
    third.upload("table", "flight.csv", b"clip\n")
    with pytest.raises(UploadError, match="try again later"):
        visitors.add()
    for visitor in visitors._all.values():
        visitor.seen -= visitors.IDLE_SECONDS + 1
    visitors.add()
    assert len(visitors._all) == 1
    assert files(server.root) == []


def test_a_port_that_is_taken_or_none_is_one_error(server: AppServer, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["app", "--port", str(server.server_address[1])]) == 2
    assert "cannot listen there" in capsys.readouterr().err
    with pytest.raises(OutputError, match="cannot listen there"):
        AppServer("127.0.0.1", 70000)


def test_limits_are_what_the_page_is_told(server: AppServer) -> None:
    assert Guest(server).get("/api/state")["limits"] == {name: kind.most_bytes for name, kind in KINDS.items()}
