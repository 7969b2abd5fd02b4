"""Rows in the pages of an SQLite file and of its log, read without SQLite.

Why not row by row with SQLite: one damaged bit in the root page of a table would cost all rows, a file that was cut
cannot be opened, and SQLite ignores the log behind a damaged part. The format is fixed
(https://www.sqlite.org/fileformat2.html); only leaf pages of tables and their overflow pages are needed, and checksums
decide whether a row is intact.
"""

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_LEAF = 0x0D  # kind of a page that holds rows of a table
_LOG_HEADER, _FRAME_HEADER = 32, 24
_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}  # by the serial type of a value
_REAL, _ZERO, _ONE, _TEXTS = 7, 8, 9, 12  # other serial types
_MOST_COLUMNS = 32

Row = tuple[Any, ...]
Page = memoryview


def stored_rows(path: Path, page_bytes: int) -> Iterator[Row]:
    """Read all rows that can be read, each with its number first; newer ones after older ones, and some twice.

    Args:
        path: The file; its log is that with ``-wal`` at the end of its name.
    """
    pages, log = _pages(path, 0, 0, page_bytes), _log(path, page_bytes)
    yield from _rows([*pages[1:], *(page for _, page in log)], dict(enumerate(pages, 1)) | dict(log))


def logged_rows(path: Path, page_bytes: int) -> Iterator[Row]:
    """Read the rows among them that stand in the log."""
    if log := _log(path, page_bytes):
        pages = _pages(path, 0, 0, page_bytes)
        yield from _rows([page for _, page in log], dict(enumerate(pages, 1)) | dict(log))


def _pages(path: Path, start: int, before: int, page_bytes: int) -> list[Page]:
    """Pages of a file from a position, each with the bytes before it; the last one may be incomplete."""
    if not path.exists() or path.stat().st_size <= start:
        return []
    with path.open("rb") as stream:
        content = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    stride = before + page_bytes
    pages = [content[at : at + stride] for at in range(start, len(content), stride)]
    return [*pages[:-1], memoryview(bytes(pages[-1]).ljust(stride, b"\0"))]


def _log(path: Path, page_bytes: int) -> list[tuple[int, Page]]:
    """Numbers and contents of the pages in the log, in the order in which they were written.

    Remains of an earlier log behind them are harmless: overflow pages never change, and rows are never deleted.
    """
    frames = _pages(path.with_name(f"{path.name}-wal"), _LOG_HEADER, _FRAME_HEADER, page_bytes)
    return [(int.from_bytes(frame[:4], "big"), frame[_FRAME_HEADER:]) for frame in frames]


def _rows(leaves: list[Page], pages: dict[int, Page]) -> Iterator[Row]:
    for leaf in leaves:
        if leaf[0] == _LEAF:
            count = min(int.from_bytes(leaf[3:5], "big"), len(leaf) // 4)
            for start in struct.unpack_from(f">{count}H", leaf, 8):
                try:
                    yield _row(leaf, start, pages)
                except (_NotARowError, IndexError, struct.error, UnicodeDecodeError):
                    continue


class _NotARowError(Exception):
    """Raised for a damaged row."""


def _row(leaf: Page, start: int, pages: dict[int, Page]) -> Row:
    """The row that begins at a place of a page."""
    size, start = _varint(leaf, start)
    number, start = _varint(leaf, start)
    content = _content(leaf, start, size, pages)
    header, at = _varint(content, 0)
    kinds: list[int] = []
    while at < header and len(kinds) < _MOST_COLUMNS:
        kind, at = _varint(content, at)
        kinds.append(kind)
    values: list[Any] = []
    for kind in kinds:
        value, at = _value(content, kind, at)
        values.append(value)
    return (number, *values[1:])  # the first column is the number, which is not stored twice


def _content(leaf: Page, start: int, size: int, pages: dict[int, Page]) -> Page:
    """All bytes of a row, of which a long one has most in a chain of other pages."""
    most = len(leaf) - 35
    if size <= most:
        return leaf[start : start + size]
    if size > len(pages) * len(leaf):
        raise _NotARowError
    least = (len(leaf) - 12) * 32 // 255 - 23
    here = least + (size - least) % (len(leaf) - 4)
    here = here if here <= most else least
    parts, left, at = [leaf[start : start + here]], size - here, start + here
    page = leaf
    while left > 0:
        page = pages.get(int.from_bytes(page[at : at + 4], "big"), _NO_PAGE)
        if not page:
            raise _NotARowError
        parts.append(page[4 : 4 + left])
        left, at = left - (len(page) - 4), 0
    return memoryview(b"".join(parts))


_NO_PAGE = memoryview(b"")


def _value(content: Page, kind: int, at: int) -> tuple[Any, int]:
    """A value by its serial type, and where the next one begins."""
    if kind >= _TEXTS:
        stop = at + (kind - _TEXTS) // 2
        value = bytes(content[at:stop])
        return (value.decode() if kind % 2 else value), stop
    if kind == _REAL:
        return struct.unpack_from(">d", content, at)[0], at + 8
    if kind in (_ZERO, _ONE):
        return kind - _ZERO, at
    length = _INTEGER_BYTES.get(kind, 0)
    return int.from_bytes(content[at : at + length], "big", signed=True) if length else None, at + length


def _varint(content: Page, at: int) -> tuple[int, int]:
    """An integer of one to nine bytes, and where the next value begins."""
    number = 0
    for count in range(8):
        byte = content[at + count]
        number = number << 7 | byte & 0x7F
        if byte < 0x80:
            return number, at + count + 1
    return number << 8 | content[at + 8], at + 9
