"""Files that tasks read by their path (a checkpoint), brought through the store to machines that lack them."""

from pathlib import Path

from pipeline.shards.beside import beside, put_in_place
from pipeline.shards.content_hash import hash_path, hash_value
from pipeline.shards.output_folder import place
from pipeline.shards.store import Store

_CONTENT = "content"


def file_key(path: Path) -> str:
    """The key of a file's or folder's content in the store."""
    return hash_value({"file": hash_path(path)})


def share_file(store: Store, path: Path, key: str) -> None:
    """Put a file or folder into the store, where it is not there yet."""

    def write(folder: Path) -> dict[str, int]:
        sources = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
        for source in sources:
            inside = Path() if path.is_file() else source.relative_to(path)
            place(source, folder / _CONTENT / inside)
        return {}

    if store.lookup(key) is None:
        store.commit(key, write, {"path": path.as_posix()})


def place_file(store: Store, path: Path, key: str) -> None:
    """Bring a file or folder of the store to its path, unless this machine has the same there."""
    if path.exists() and file_key(path) == key:
        return
    found = store.lookup(key)
    assert found is not None, f"{path} was shared under {key}"
    path.parent.mkdir(parents=True, exist_ok=True)
    with beside(path.absolute()) as temporary:
        for name in found.files:
            place(found.folder / name, temporary / name)
        if path.is_file():
            path.unlink()
        put_in_place(temporary / _CONTENT, path.absolute())
