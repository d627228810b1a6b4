"""What every stage's `main` is run under: `if __name__ == "__main__": run(main)`."""

import inspect
import sys
from collections.abc import Callable

from pipeline.errors import DynamicsError
from pipeline.shards.executor import SliceFinished


def run(main: Callable[..., None], arguments: list[str] | None = None) -> None:
    """Call `main` with the words of the command line (a suite's name, mostly) and exit with its outcome.

    0: done. 2: the user's data or settings are at fault, or the words do not fit: one line on stderr, no
    traceback. 130: Ctrl-C. Anything else is a defect and shows its traceback.
    """
    words = sys.argv[1:] if arguments is None else arguments
    try:
        inspect.signature(main).bind(*words)
    except TypeError:
        module = inspect.getmodule(main)
        name = module.__spec__.name if module and module.__spec__ else main.__module__
        expected = " ".join(parameter.upper() for parameter in inspect.signature(main).parameters)
        print(f"error: usage: python -m {name} {expected}".rstrip(), file=sys.stderr)
        sys.exit(2)
    try:
        main(*words)
    except SliceFinished as finished:
        print(finished)
    except DynamicsError as error:
        notes = "".join(f" ({note})" for note in getattr(error, "__notes__", []))
        print(f"error: {error}{notes}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("error: interrupted; what was computed is in the store, run it again to go on", file=sys.stderr)
        sys.exit(130)
