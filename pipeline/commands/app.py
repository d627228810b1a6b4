"""`dynamics app`: a local web page on which clips become scenes."""

from __future__ import annotations

import argparse

from pipeline.commands.arguments import count

SUMMARY = "a local web page: choose a clip, correct its bodies, find the scene, move sliders"
DESCRIPTION = """\
Open a local web page on which clips become scenes.

Choose a sample or drop a clip; correct the bodies that were found by clicks; let the scene be found; move sliders and
see the motion change at once, then the clip itself. A second tab compares a table of measured motion with a scene, as
`dynamics discover` does.

The page is served to this machine only and asks for nothing from any network. --host 0.0.0.0 lets others in: then
anybody who reaches this machine can run computations on it. Ctrl-C ends it, and what was computed is removed.

examples:
  dynamics app
  dynamics app --port 8001
"""
DEFAULT_PORT = 7860


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--host", default="127.0.0.1", metavar="HOST", help="address to listen at (127.0.0.1)")
    add("--port", type=count, default=DEFAULT_PORT, metavar="N", help=f"port; 0 for any that is free ({DEFAULT_PORT})")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.app.server import AppServer

    with AppServer(arguments.host, arguments.port) as server:
        if not server.loopback:
            print(f"note       {arguments.host}: everybody who reaches this machine can use it")
        print(f"{'open':<11}{server.address}", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print("ended")
