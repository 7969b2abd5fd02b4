"""Files replaced as a whole: written next to the old one and renamed over it, so that a kill leaves the old or the new.

A reader never sees half a file, and a full disk never costs the file that was there. Links that somebody else has put
into a folder lead nowhere: a file is written under a name that is made anew, and a folder with links is refused.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tripod_doe.errors import InputError, StorageError

_PROBE = 4_000_000  # bytes, more than netCDF4 writes at once
_DATABASE = "journal.sqlite"  # and its companions: SQLite follows links


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """Give a path next to `path` to write to; at the end of the block that file takes the place of `path`.

    Args:
        path: The file to replace or to create; its folder is made if it is missing.

    Raises:
        StorageError: If it cannot be written, or what is there is no file (a device, a pipe, a folder); it stays.
    """
    fresh = path.with_name(f".{path.name}.new")
    if path.exists() and not path.is_file():
        raise StorageError(
            f"{path}: cannot write this file: something other than a file has this name; choose another name"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh.unlink(missing_ok=True)  # left by a kill, or a link to another file
        os.close(os.open(fresh, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield fresh
        written = os.open(fresh, os.O_RDONLY | os.O_NOFOLLOW)
        try:
            os.fsync(written)
        finally:
            os.close(written)
        os.replace(fresh, path)
    except (OSError, RuntimeError) as error:  # netCDF4 reports a full disk as "HDF error" or "Permission denied"
        if isinstance(error, RuntimeError | PermissionError):
            error = _refusal(fresh) or error
        with suppress(OSError):
            fresh.unlink()  # a full disk must not stay full of what is of no use
        reason = getattr(error, "strerror", None) or error
        raise StorageError(
            f"{path}: cannot write this file: {reason}; nothing that was finished is lost: {remedy(error)}, then run "
            "again"
        ) from error


def remedy(error: BaseException) -> str:
    """What to do before a file can be written; a library that does not say why it failed meets a full disk mostly."""
    number = getattr(error, "errno", None)
    return "free space" if number in (None, errno.ENOSPC, errno.EDQUOT) else "mend this"


def _refusal(path: Path) -> OSError | None:
    """Why the disk takes no more of a file, for instance since it is full; netCDF4 does not say so."""
    try:
        with path.open("ab", 0) as file:
            file.write(bytes(_PROBE))
            os.fsync(file.fileno())
    except OSError as error:
        return error
    return None


def replace_text(path: Path, text: str) -> Path:
    """Replace a text file (UTF-8) as a whole and return its path; see `replace_file`."""
    with replace_file(path) as fresh:
        fresh.write_text(text, encoding="utf-8")
    return path


def remove_tree(directory: Path) -> None:
    """Remove a directory as far as possible; what is nested deeper than Python recurses stays."""
    with suppress(RecursionError):
        shutil.rmtree(directory, ignore_errors=True)


def refuse_links(directory: Path) -> None:
    """Refuse a folder of results in which a folder or the journal is a link: what is written there would go elsewhere.

    Raises:
        InputError: With the name of the link.
    """
    with suppress(FileNotFoundError, NotADirectoryError), os.scandir(directory) as entries:
        for entry in entries:
            if entry.is_symlink() and (entry.is_dir() or entry.name.startswith(_DATABASE)):
                raise InputError(
                    f"{directory}: {entry.name} is a link to {os.readlink(entry.path)!r}, outside of these results; "
                    "nothing is written through it: delete it, or choose another directory"
                )
