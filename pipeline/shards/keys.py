"""The key of a shard: a hash of everything that its content depends on, known before it is computed."""

import platform
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path, PurePath
from typing import Any, Protocol, runtime_checkable

from pipeline.errors import ShardError
from pipeline.shards.code_hash import function_code
from pipeline.shards.content_hash import hash_path, hash_value
from pipeline.shards.contents import check_contents
from pipeline.shards.shard import Shard

FORMAT = 1
_ALWAYS = ("numpy", "numcodecs", "pyarrow", "zarr")


@runtime_checkable
class Dumps(Protocol):
    """A record that gives its own plain values, as pydantic's models do."""

    def model_dump(self, *, mode: str) -> dict[str, Any]: ...


def plain(value: object) -> Any:
    """A parameter as the plain value that stands for it in a key and in a manifest.

    Dataclasses and mappings become dicts with text keys, sequences lists, paths text. Raises TypeError for a value
    of any other kind.
    """
    match value:
        case None | bool() | int() | float() | str():
            return value
        case PurePath():
            return value.as_posix()
        case Mapping():
            return {str(key): plain(inner) for key, inner in value.items()}
        case list() | tuple():
            return [plain(inner) for inner in value]
        case Dumps():
            return value.model_dump(mode="json")
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    raise TypeError(f"{type(value).__name__} cannot be a parameter; valid: dataclasses, numbers, text, lists, mappings")


def common_parts(
    compute: Callable[..., Any],
    parameters: object,
    versions: Iterable[str],
    files: Mapping[str, Path],
) -> dict[str, Any]:
    """What the keys of all shards of one run have in common, readable; it is written to the manifest.

    Args:
        compute: A function of a module; the code of that module counts.
        parameters: A record (`plain`), or None for a stage without parameters.
        versions: Names of the distributions whose versions count, beside those that write the bytes.
        files: Named files and folders (a checkpoint) that every shard reads; their content counts, their path does not.

    Raises:
        ShardError: One of the files is missing, or an output of a stage that is damaged.
    """
    assert "<" not in compute.__qualname__, f"{compute.__qualname__} must be a function of a module"
    for name, path in files.items():
        if not path.exists():
            raise ShardError(f"{path} is missing ({name}); `dvc repro` makes it, or `dvc checkout` brings it back")
        check_contents(path)
    return {
        "code": function_code(compute),
        "compute": compute.__qualname__,
        "files": {name: hash_path(path) for name, path in sorted(files.items())},
        "format": FORMAT,
        "parameters": {} if parameters is None else plain(parameters),
        "versions": {
            "python": ".".join(platform.python_version_tuple()[:2]),
            **{name: version(name) for name in sorted({*versions, *_ALWAYS})},
        },
    }


def shard_key(shard: Shard, inputs: Mapping[str, str], common: Mapping[str, Any]) -> str:
    """The key of one shard. `inputs` are the content hashes of the input shards, in order, by a readable name."""
    own = {
        "stage": shard.stage,
        "suite": shard.suite,
        "clips": [shard.start, shard.stop],
        "inputs": list(inputs.items()),
    }
    return hash_value({**common, **own})
