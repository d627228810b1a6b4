"""A copy of dvc.lock, since DVC leaves an empty or cut file where it is killed while it writes it.

Each stage keeps one as it starts: DVC has then written the last stage's entry, and waits. `make repro` runs
`python -m stages.graph.lock_copy`, which puts the copy back where dvc.lock cannot be used.
"""

import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path

LOCK = Path("dvc.lock")
COPY = Path(".dvc/tmp/dvc.lock.copy")


def keep() -> None:
    """Copy dvc.lock, where it is newer than the copy. Nothing happens outside of a repository."""
    with suppress(OSError):  # a read-only or full disk: a stage needs no copy
        written = LOCK.stat()
        if not written.st_size or (COPY.is_file() and COPY.stat().st_mtime_ns == written.st_mtime_ns):
            return
        temporary = COPY.with_name(f"{COPY.name}.{os.getpid()}")
        shutil.copy2(LOCK, temporary)
        temporary.replace(COPY)


def restore() -> str | None:
    """Put the copy back where dvc.lock is damaged; what was done, or None where nothing was."""
    if not LOCK.exists() or is_whole(LOCK):
        return None
    if COPY.is_file() and is_whole(COPY):
        shutil.copy2(COPY, LOCK)
        return f"{LOCK} was cut when an earlier run was killed; the copy of its last stage is put back"
    LOCK.unlink()
    return (
        f"{LOCK} was cut when an earlier run was killed, and there is no copy: it is removed, and the stages run again"
    )


def is_whole(path: Path) -> bool:
    """Whether a file ends with a line, can be parsed, and has entries of stages."""
    import yaml  # PyYAML, which transformers needs: its parser is compiled, and the file is long

    try:
        text = path.read_bytes()
        loaded = yaml.load(text, yaml.CSafeLoader) if text.endswith(b"\n") else None
    except (OSError, yaml.YAMLError, ValueError):
        return False
    stages = loaded.get("stages") if isinstance(loaded, dict) else None
    return isinstance(stages, dict) and all(isinstance(entry, dict) and "cmd" in entry for entry in stages.values())


def main() -> None:
    done = restore()
    if done:
        print(f"warning: {done}", file=sys.stderr)


if __name__ == "__main__":
    main()
