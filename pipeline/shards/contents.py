"""`contents.json`: the key and the hashes of the files of a folder that `keep_folder` made, for those who read it."""

import json
from collections.abc import Mapping
from pathlib import Path

from pipeline.errors import ShardError
from pipeline.shards.checksum import checked_fields, with_checksum
from pipeline.shards.content_hash import hash_file
from pipeline.shards.manifest import how_to_mend

CONTENTS = "contents.json"


def write_contents(folder: Path, key: str, files: Mapping[str, str]) -> None:
    """Write down the SHA-256 of the files, by their paths in the folder."""
    fields = {"key": key, "files": dict(sorted(files.items()))}
    text = json.dumps(with_checksum(fields), indent=1) + "\n"
    (folder / CONTENTS).write_text(text)


def read_contents(folder: Path) -> tuple[str, dict[str, str]]:
    """The key and the hashes of the files. Raises ShardError."""
    path = folder / CONTENTS
    try:
        fields = checked_fields(json.loads(path.read_bytes()))
        return fields["key"], dict(fields["files"])
    except FileNotFoundError:
        raise ShardError(f"{path} is missing; {how_to_mend(folder)}") from None
    except (OSError, RecursionError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ShardError(f"{path} is damaged ({error}); {how_to_mend(folder)}") from None


def check_contents(path: Path) -> None:
    """Raise ShardError where `path`, or a file below it, is in a folder with a `contents.json` and not what that says.

    Nothing is checked where no folder above has one: the path is then not an output of a stage.
    """
    path = path.absolute()
    folder = next((place for place in (path, *path.parents[:2]) if (place / CONTENTS).is_file()), None)
    if folder is None:
        return
    _, files = read_contents(folder)
    own = path.relative_to(folder).as_posix()
    for name, expected in files.items():
        if own in (".", name) or name.startswith(f"{own}/"):
            try:
                sound = hash_file(folder / name) == expected
            except OSError as error:
                raise ShardError(f"{folder / name} is missing ({error.strerror}); {how_to_mend(folder)}") from None
            if not sound:
                raise ShardError(
                    f"{folder / name} is damaged (its hash is not that of {CONTENTS}); {how_to_mend(folder)}"
                )
