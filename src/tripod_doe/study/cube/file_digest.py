"""The digest of a netCDF file, stored at its end, behind the part that netCDF reads.

It is replaced and copied with the file, and removed when a program changes the file with netCDF. It detects any damaged
bit, also in parts without HDF5 checksum: names, attributes and texts. A damaged digest is detected, too: HDF5 stores
the end of its part of the file, and other bytes than a digest follow.
"""

import hashlib
import os
import re
import struct
from pathlib import Path

from tripod_doe.files.regular_files import version_of

_MARK = b"tripod-doe sha256 "
_LENGTH = len(_MARK) + 64 + 1
_WRITTEN = re.compile(_MARK + rb"[0-9a-f]{64}\n")
_CHUNK = 1 << 20  # bytes that are read at a time
_MOST_KNOWN = 1000
_HDF5 = b"\x89HDF\r\n\x1a\n"
_SUPERBLOCK = struct.Struct("<8sBBBBQQQ")  # signature, version, sizes of offsets and lengths, ..., end of the file

_known: dict[Path, tuple[int, ...]] = {}  # intact files, with their size and times


def seal(path: Path) -> None:
    """Write the digest of a file at its end."""
    with path.open("rb+") as stream:
        digest = _digest(stream.fileno(), path.stat().st_size)
        stream.seek(0, os.SEEK_END)
        stream.write(_MARK + digest + b"\n")


def is_sealed(path: Path) -> bool:
    """Whether a file has a digest at its end."""
    return bool(stored_digest(path))


def stored_digest(path: Path) -> str:
    """The digest at the end of a file; empty where none is."""
    with path.open("rb") as stream:
        return _stored_digest(stream.fileno()).decode(errors="replace")


def is_damaged(path: Path, most: int | None = None) -> bool:
    """Whether a file does not match its digest; a file without one is not damaged.

    Args:
        path: The file; an intact one is not read again until its size or times change.
        most: Bytes up to which it is read; None without a limit.
    """
    with path.open("rb") as stream:
        state = os.fstat(stream.fileno())
        version = version_of(state)
        if _known.get(path.absolute()) == version:
            return False
        stored = _stored_digest(stream.fileno())
        if _bytes_behind(stream.fileno()) not in (None, _LENGTH if stored else 0):
            return True
        if most is not None and state.st_size > most:
            return False
        if stored and _digest(stream.fileno(), state.st_size - _LENGTH) != stored:
            return True
    if len(_known) >= _MOST_KNOWN:
        _known.clear()
    _known[path.absolute()] = version
    return False


def _stored_digest(file: int) -> bytes:
    """The digest at the end of a file; empty where none is."""
    start = os.fstat(file).st_size - _LENGTH
    end = os.pread(file, _LENGTH, start) if start > 0 else b""
    return end[len(_MARK) : -1] if _WRITTEN.fullmatch(end) else b""


def _bytes_behind(file: int) -> int | None:
    """Number of bytes behind the end of the HDF5 part of a file; None if unknown.

    The first bytes are as the HDF5 specification has them, III.A (https://support.hdfgroup.org/documentation/hdf5).
    """
    begin = os.pread(file, _SUPERBLOCK.size, 0)
    if len(begin) < _SUPERBLOCK.size:
        return None
    signature, version, offset_bytes, _, _, _, _, end = _SUPERBLOCK.unpack(begin)
    if signature != _HDF5 or version not in (2, 3) or offset_bytes != 8:
        return None
    return int(os.fstat(file).st_size - end)


def _digest(file: int, length: int) -> bytes:
    digest, at = hashlib.sha256(), 0
    while at < length and (part := os.pread(file, min(_CHUNK, length - at), at)):
        digest.update(part)
        at += len(part)
    return digest.hexdigest().encode()
