"""Open files of results, which may be a stranger's: regular ones only, up to a size; and files that are locked.

A pipe blocks who opens it until somebody writes, a device may never end, and a sparse file of a few bytes on the disk
fills the memory of who reads it.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from tripod_doe.errors import InputError

STUDY_BYTES, TEXT_BYTES = 20_000_000, 1_000_000_000
"""Most bytes of a study or workflow file, and of any other text."""

_KINDS: dict[str, Callable[[int], bool]] = {
    "a link": stat.S_ISLNK,
    "a folder": stat.S_ISDIR,
    "a pipe": stat.S_ISFIFO,
    "a device": lambda mode: stat.S_ISCHR(mode) or stat.S_ISBLK(mode),
    "a socket": stat.S_ISSOCK,
}
_OF_SHELLS = ("/dev/stdin", "/dev/fd/")  # a pipe that the user's shell has made


def refuse_irregular(path: Path, error: type[InputError] = InputError, links: bool = True) -> None:
    """Refuse a pipe, a device, a socket or a folder where a file is expected; nothing is opened.

    Args:
        path: Where a file is expected; nothing is refused where nothing is.
        error: What is raised.
        links: Whether a link to a file will do.

    Raises:
        InputError: With its kind.
    """
    try:
        mode = path.stat(follow_symlinks=links).st_mode
    except (OSError, ValueError):  # opening it states the reason
        return
    if not stat.S_ISREG(mode):
        kind = next((kind for kind, is_kind in _KINDS.items() if is_kind(mode)), "something else")
        raise error(f"{path}: {kind}, but a file is needed: name a file, or move this away")


@contextmanager
def opened_regular(
    path: Path, most: int = TEXT_BYTES, error: type[InputError] = InputError, links: bool = False
) -> Iterator[BufferedReader]:
    """Open a file for reading, as `read_regular`."""
    shell = str(path).startswith(_OF_SHELLS)
    if not shell:
        refuse_irregular(path, error, links)
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | (0 if shell else _flags(links)))
    with open(descriptor, "rb") as stream:
        state = os.fstat(descriptor)
        if not shell and not stat.S_ISREG(state.st_mode):  # exchanged just now
            raise error(f"{path}: not a regular file")
        if state.st_size > most:
            raise error(f"{path}: {state.st_size:,} bytes, at most {most:,} are read: not a file of this kind")
        yield stream


def read_regular(
    path: Path, most: int = TEXT_BYTES, error: type[InputError] = InputError, links: bool = False
) -> bytes:
    """The content of a small file.

    Args:
        path: The file.
        most: Bytes that it may have.
        error: What is raised for a file that is not read.
        links: Whether a link to a file will do, as for a file that the user has named.

    Raises:
        InputError: If it is no regular file, or larger.
        OSError: If it cannot be opened or read.
    """
    with opened_regular(path, most, error, links) as stream:
        content = stream.read(most + 1)
    if len(content) > most:  # a file of the system, or one that grows
        raise error(f"{path}: more than {most:,} bytes, the limit for this file")
    return content


def text_of(content: bytes) -> str:
    """The text of a table or record as spreadsheets and recorders write it: UTF-8, UTF-16, or else Windows' cp1252.

    Raises:
        InputError: If it is no text.
    """
    for mark, encoding in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig")):
        if content.startswith(mark):
            return content.decode(encoding, errors="replace")
    if b"\0" in content:
        even, odd = content[0:2000:2].count(0), content[1:2000:2].count(0)
        if max(even, odd) < 0.4 * len(content[:2000]) / 2:
            raise InputError("it is no text")
        return content.decode("utf-16-le" if odd > even else "utf-16-be", errors="replace").replace("\0", "")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")  # a degree sign, an umlaut


def version_of(state: os.stat_result) -> tuple[int, ...]:
    """What differs where a file was written or exchanged, even by one of the same size and time of its content."""
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns


def open_locked(path: Path, flags: int = os.O_RDONLY) -> int:
    """Open a file that is locked, or written by one process alone; gives its descriptor.

    Args:
        path: The file; one that is made here is its owner's alone.
        flags: As `os.open` takes them.

    Raises:
        OSError: If it cannot be opened, is a link or no file, or is made here and has another name elsewhere, under
            which it would be changed, too.
    """
    descriptor = os.open(path, flags | os.O_CLOEXEC | _flags(links=False), 0o600)
    state = os.fstat(descriptor)
    if not stat.S_ISREG(state.st_mode) or (flags & os.O_CREAT and state.st_nlink > 1):
        os.close(descriptor)
        raise OSError(errno.ELOOP, f"{path.name} is a link, or no file")
    return descriptor


def _flags(links: bool) -> int:
    return os.O_NONBLOCK | (0 if links else os.O_NOFOLLOW)


def private_text(path: Path, most: int, named: str) -> str:
    """The text of a file with a secret, up to `most` bytes.

    Args:
        path: The file.
        most: Bytes that are read.
        named: How the user named it.

    Raises:
        InputError: If it cannot be read, or other users can.
    """
    try:
        with opened_regular(path, links=True) as stream:
            state = os.fstat(stream.fileno())
            if state.st_uid not in (os.geteuid(), 0):
                raise InputError(f"{named}: another user owns this file, and knows the secret in it")
            if state.st_mode & 0o077:
                raise InputError(
                    f"{named}: other users can use this file (mode {stat.S_IMODE(state.st_mode):04o}) and may know the "
                    f"secret in it; put a new one into a new file, or run: chmod go-rwx {path}"
                )
            return stream.read(most).decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(f"{named}: cannot read this file: {reason}") from error
