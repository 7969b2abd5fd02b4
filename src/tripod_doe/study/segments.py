"""Segments of a journal: files to which one process appends finished blocks, and which nobody ever changes again.

Two processes never share one, so that even where a lock does not work no block is damaged. What a kill or a bad disk
leaves behind is skipped: the torn end of the last record, or a stretch in the middle.
"""

from __future__ import annotations

import mmap
import os
import weakref
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tripod_doe.study.block_record import MARK, PREAMBLE, record_number, record_size

_ENDING = ".blocks"
_WINDOW = 1 << 20  # bytes in which the next record is looked for behind damage


class Segment:
    """A new segment of this process.

    Parameters
    ----------
    folder
        Where the segments of the journal are; it must exist.
    owner
        Word that no other process has.

    Raises
    ------
    OSError
        If it cannot be written, here and in all methods; what was appended before stays.
    """

    def __init__(self, folder: Path, owner: str) -> None:
        last = max((int(path.name[:6]) for path in segments_in(folder)), default=0)
        self.path = folder / f"{last + 1:06}-{owner}{_ENDING}"
        self._file = os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
        self.length, self.count = 0, 0
        directory = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(directory)  # so that the file itself outlives a power cut
        finally:
            os.close(directory)

    def append(self, record: bytes) -> None:
        """Add a record; one that cannot be written whole leaves nothing."""
        rest = memoryview(record)
        try:
            while rest:
                rest = rest[os.write(self._file, rest) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._file, self.length)
                os.lseek(self._file, self.length, os.SEEK_SET)
            raise
        self.length += len(record)
        self.count += 1

    def sync(self) -> None:
        """Make what was appended outlive a power cut."""
        os.fsync(self._file)

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


@dataclass
class StoredSegment:
    """A segment as it is on the disk, also while its process appends to it."""

    path: Path  # the file
    # bytes of it that count: those that were there when it was looked at, or when its process was found to be gone
    length: int
    lost: int = 0  # records that are missing between others; known when all records have been read
    end: int = 0  # end of the last whole record; known when all records have been read

    def __post_init__(self) -> None:
        self._file = os.open(self.path, os.O_RDONLY)  # it can be read even when its journal was gathered meanwhile
        weakref.finalize(self, os.close, self._file)
        self.length = min(self.length, os.fstat(self._file).st_size)
        self._checked: list[tuple[int, int]] | None = None  # records from the first one to `end`

    @property
    def torn(self) -> bool:
        """Whether something stands behind the last whole record; known when all records have been read."""
        return self.end < self.length

    def records(self, after: int = 0) -> Iterator[memoryview]:
        """All whole records from a place on, in the order in which they were appended."""
        for start, stop in self.places(after):
            yield self.record(start, stop)

    def places(self, after: int = 0) -> Iterator[tuple[int, int]]:
        """Where all whole records from a place on begin and end; those from the first one on are checked once."""
        if not after and self._checked is not None:
            yield from self._checked
            return
        checked = []
        at, expected = after, None if after else 0
        self.lost, self.end = 0, after
        while at < self.length:
            size = record_size(os.pread(self._file, PREAMBLE, at))
            number = record_number(self.record(at, at + size)) if size and at + size <= self.length else None
            if size is None or number is None:
                at = self._next_mark(at + 1)
                continue
            self.lost += number - expected if expected is not None else 0
            expected = number + 1
            self.end = at + size
            checked.append((at, self.end))
            yield at, self.end
            at = self.end
        if not after:
            self._checked = checked

    def record(self, start: int, stop: int) -> memoryview:
        """Bytes of the file; they take memory only as long as somebody holds them or an array made of them."""
        first = start - start % mmap.ALLOCATIONGRANULARITY
        mapped = mmap.mmap(self._file, stop - first, access=mmap.ACCESS_READ, offset=first)
        return memoryview(mapped)[start - first :]

    def _next_mark(self, at: int) -> int:
        """Where something looks like the beginning of a record; the end where nothing does."""
        while at < self.length:
            found = os.pread(self._file, _WINDOW, at).find(MARK)
            if found >= 0:
                return at + found
            at += _WINDOW - len(MARK) + 1
        return self.length


def segments_in(folder: Path) -> list[Path]:
    """Files of the segments in a folder, the oldest first."""
    return sorted(folder.glob(f"*{_ENDING}"))
