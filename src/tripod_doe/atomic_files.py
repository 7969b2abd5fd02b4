"""Files replaced as a whole: written beside the old one and renamed over it, so that a kill leaves the old or the new.

A reader never sees half a file, and a full disk never costs the file that was there.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tripod_doe.errors import StorageError


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to; at the end of the block that file takes the place of `path`.

    Parameters
    ----------
    path
        The file to replace or to create; its folder is made if it is missing.

    Raises
    ------
    StorageError
        If it cannot be written, or what is there is no file (a device, a pipe, a folder); it stays.
    """
    fresh = path.with_name(f".{path.name}.new")
    if path.exists() and not path.is_file():
        raise StorageError(f"{path}: cannot write this file: something else is there, and stays; choose another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield fresh
        with fresh.open("rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(fresh, path)
    except (OSError, RuntimeError) as error:  # netCDF4 reports a full disk as a RuntimeError
        with suppress(OSError):
            fresh.unlink()  # a full disk must not stay full of what is of no use
        reason = getattr(error, "strerror", None) or error
        raise StorageError(
            f"{path}: cannot write this file: {reason}; nothing that was finished is lost: free space, then run again"
        ) from error


def replace_text(path: Path, text: str) -> Path:
    """Replace a text file (UTF-8) as a whole and return its path; see `replace_file`."""
    with replace_file(path) as fresh:
        fresh.write_text(text, encoding="utf-8")
    return path
