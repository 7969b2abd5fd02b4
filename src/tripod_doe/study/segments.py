"""Segments of a journal: files to which one process appends finished blocks, and which nobody ever changes again.

Two processes never share one, so that even where a lock does not work no block is damaged. What a kill or a bad disk
leaves behind is skipped: the torn end of the last record, or a stretch in the middle.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tripod_doe.study.block_record import MARK, end_of_record

__all__ = ["Segment", "StoredSegment", "segments_in"]

_ENDING = ".blocks"


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
    """A segment as it is on the disk, also while its process appends to it.

    Attributes
    ----------
    path
        The file.
    length
        Bytes of it that count: those that were there when it was looked at, or when its process was found to be gone.
    lost
        Records that are missing between others; known when all records have been read.
    end
        End of the last whole record; known when all records have been read.
    """

    path: Path
    length: int
    lost: int = 0
    end: int = 0

    def __post_init__(self) -> None:
        with self.path.open("rb") as stream:
            self.length = min(self.length, os.fstat(stream.fileno()).st_size)
            self._stored: mmap.mmap | bytes = (
                mmap.mmap(stream.fileno(), self.length, access=mmap.ACCESS_READ) if self.length else b""
            )

    @property
    def torn(self) -> bool:
        """Whether something stands behind the last whole record; known when all records have been read."""
        return self.end < self.length

    def records(self, after: int = 0) -> Iterator[memoryview]:
        """All whole records from a place on, in the order in which they were appended."""
        view = memoryview(self._stored)
        at, expected = after, None if after else 0
        self.lost, self.end = 0, after
        while 0 <= at < self.length:
            found = end_of_record(view, at, self.length)
            if found is None:
                at = self._stored.find(MARK, at + 1)
                continue
            end, number = found
            self.lost += number - expected if expected is not None else 0
            expected = number + 1
            yield view[at:end]
            at = self.end = end


def segments_in(folder: Path) -> list[Path]:
    """Files of the segments in a folder, the oldest first."""
    return sorted(folder.glob(f"*{_ENDING}"))
