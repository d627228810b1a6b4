"""Records that say whether they are whole: one field is the hash of all others."""

from collections.abc import Mapping
from typing import Any

from pipeline.shards.content_hash import hash_value

_CHECKSUM = "checksum"


class ChecksumError(ValueError):
    """A record is not what was written."""


def with_checksum(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The record of these fields."""
    return {**fields, _CHECKSUM: hash_value(fields)}


def checked_fields(record: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a record without its checksum. Raises ChecksumError where they are not those that were written."""
    fields = dict(record)
    if fields.pop(_CHECKSUM, None) != hash_value(fields):
        raise ChecksumError("its checksum is not that of its content")
    return fields
