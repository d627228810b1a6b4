"""Entry point of `dynamics`: parses the command line, and turns errors into one line and an exit code."""

from __future__ import annotations

import argparse
import importlib
import io
import logging
import os
import signal
import sys
import warnings
from types import FrameType

from pipeline.errors import DynamicsError

DESCRIPTION = """\
Video in, editable physics out.

A clip of moving bodies becomes a program of the scene: a YAML text with every object's shape, size,
mass, friction and motion, the camera and gravity, which MuJoCo runs. Change a number, run it again,
and see what would have happened.
"""
EPILOG = """\
three examples:
  dynamics infer clip.mp4 -o out --search 2000         a scene from a video, refined by 2,000 simulations
  dynamics simulate out --set objects[0].mass=2 -o heavier    what if the first object weighed 2 kg?
  dynamics view out                                    look at it in 3D

where to go on:
  dynamics infer --help       each subcommand explains itself
  out/overlay.png, out/result.json    the picture to look at first, and what was assumed and measured
  README.md                   a first film, a first discovery, the experiment as a graph (make repro)
  docs/formats.md             the scene language, and every file that is written
"""
#: The subcommands: a module each, with SUMMARY (one line for `dynamics --help`), DESCRIPTION (what it does, with
#: examples), add_arguments(parser) and run(arguments). It imports nothing heavy before `run`.
VERBS = ("app", "discover", "edit", "export", "infer", "masks", "simulate", "store", "view")
INTERRUPTED = 130
CLOSED_PIPE = 141
TERMINATED = 143


def parser() -> argparse.ArgumentParser:
    """The parser of all subcommands."""
    raw = argparse.RawDescriptionHelpFormatter
    top = argparse.ArgumentParser(prog="dynamics", description=DESCRIPTION, epilog=EPILOG, formatter_class=raw)
    subcommands = top.add_subparsers(dest="verb", required=True, metavar="COMMAND", title="commands")
    for name in VERBS:
        module = importlib.import_module(f"pipeline.commands.{name}")
        sub = subcommands.add_parser(name, help=module.SUMMARY, description=module.DESCRIPTION, formatter_class=raw)
        module.add_arguments(sub)
        sub.set_defaults(run=module.run)
    return top


def main(words: list[str] | None = None) -> int:
    """Run `dynamics` with `words` (default: the command line's). Exit codes: 0 done; 2 the user's words, data or
    files are at fault, said in one line; 130 interrupted; 141 the reader of the
    output ended. Anything else is a defect and shows its traceback."""
    warnings.filterwarnings("ignore", module="glfw")  # it looks for a display that nothing here needs
    logging.getLogger("absl").setLevel(logging.ERROR)  # MuJoCo's warnings, which are counted or raised
    signal.signal(signal.SIGTERM, _terminate)
    # Before torch is imported: where other programs run, threads that spin while they wait take two thirds of its time.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files that are not UTF-8, terminals that are not
    arguments = parser().parse_args(words)
    try:
        arguments.run(arguments)
        sys.stdout.flush()
    except DynamicsError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # who reads the output has ended: nothing more can be said
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED_PIPE
    except MemoryError:
        print("error: there is not enough memory for this; nothing was written", file=sys.stderr)
        return 2
    except OSError as error:  # of the system: a full disk, a folder that one may not read
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("error: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    return 0


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    raise SystemExit(TERMINATED)  # unwinds, so that temporary folders are removed


if __name__ == "__main__":
    sys.exit(main())
