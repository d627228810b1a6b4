"""The key of a shard: a hash of everything that its content depends on, known before it is computed."""

import platform
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.errors import ShardError
from pipeline.shards.code_hash import function_code
from pipeline.shards.content_hash import hash_path, hash_value
from pipeline.shards.shard import Shard

FORMAT = 1
_ALWAYS = ("numpy", "numcodecs", "pyarrow", "zarr")


def common_parts(
    compute: Callable[..., Any],
    parameters: Mapping[str, Any],
    versions: Iterable[str],
    files: Mapping[str, Path],
) -> dict[str, Any]:
    """What the keys of all shards of one run have in common, readable; it is written to the manifest.

    versions: names of the distributions whose versions matter, beside those that write the bytes.
    files: named files and folders (a checkpoint) that every shard reads; their content counts, their place not.
    """
    assert "<" not in compute.__qualname__, f"{compute.__qualname__} must be a function of a module"
    for name, path in files.items():
        if not path.exists():
            raise ShardError(f"{path} is missing ({name}); `dvc repro` makes it, or `dvc checkout` brings it back")
    return {
        "code": function_code(compute),
        "compute": compute.__qualname__,
        "files": {name: hash_path(path) for name, path in sorted(files.items())},
        "format": FORMAT,
        "parameters": dict(parameters),
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
