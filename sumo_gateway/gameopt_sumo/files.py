"""Files of ours: written whole or not at all, and named in whatever is said about them."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec

T = TypeVar("T")


class FileError(Exception):
    """A file that cannot be read, understood or written; one line that names it."""


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all. Raises `FileError`."""
    partial = path.with_name(path.name + ".part")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise FileError(f"{path}: cannot write: {error.strerror or error}") from None


def read_json(path: Path, kind: type[T]) -> T:
    """What a JSON file of ours holds. Raises `FileError`, also for one that is damaged."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from None
    except msgspec.DecodeError as error:
        raise FileError(f"{path}: damaged: {error}; remove it, and the same command makes it again") from None


def complaint(error: OSError) -> str:
    """What the system refused, in one line that names the file where there is one."""
    where = "" if error.filename is None else f"{error.filename}: "
    return f"{where}{error.strerror or error}"
