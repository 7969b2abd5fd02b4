"""Rows of a damaged journal and of its log: SQLite reads each page that holds rows as a table of its own.

Why not the tables as they are: one damaged bit in the root page of a table would cost all rows, a file that was cut
cannot be opened, and SQLite ignores the log behind a damaged part. Checksums decide whether a row is intact.
"""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tripod_doe.study.journal.rows import PAGE_BYTES, make_tables

_LEAF = 0x0D  # kind of a page that holds rows of a table (https://www.sqlite.org/fileformat2.html)
_PAGES_AT = 28  # place of the number of pages in the header
_LOG_HEADER, _FRAME_HEADER = 32, 24


def stored_rows(path: Path) -> Iterator[tuple[Any, ...]]:
    """Read all rows that can be read, each with its number first; newer ones after older ones, and some twice.

    Args:
        path: The file, next to which it is copied; its log is that with ``-wal`` at the end of its name.
    """
    with TemporaryDirectory(prefix=".rescue-", dir=path.parent) as folder:
        yield from _rows(path, Path(folder) / "pages", log_only=False)


def logged_rows(path: Path) -> Iterator[tuple[Any, ...]]:
    """Read the rows among them that are in the log."""
    if _frames(path):
        with TemporaryDirectory(prefix="tripod-doe-") as folder:
            yield from _rows(path, Path(folder) / "pages", log_only=True)


def _rows(path: Path, copy: Path, log_only: bool) -> Iterator[tuple[Any, ...]]:
    with closing(sqlite3.connect(copy, isolation_level=None)) as connection:
        make_tables(connection)
    leaves = _copy_pages(path, copy, log_only)
    with closing(sqlite3.connect(copy, isolation_level=None)) as connection:
        connection.execute("PRAGMA journal_mode = OFF")
        connection.execute("PRAGMA synchronous = OFF")
        for leaf in leaves:
            connection.execute("PRAGMA writable_schema = ON")
            connection.execute("UPDATE sqlite_schema SET rootpage = ? WHERE type = 'table'", (leaf,))
            connection.execute("PRAGMA writable_schema = RESET")  # which reads the schema again
            for table in ("block", "note"):
                for way in ("ASC", "DESC"):  # a damaged row ends the reading
                    with suppress(sqlite3.Error, OverflowError):
                        yield from connection.execute(f"SELECT * FROM {table} ORDER BY id {way}")


def _copy_pages(path: Path, copy: Path, log_only: bool) -> list[int]:
    """Put the pages of a file and its log behind the first page of new tables; gives the numbers of those with rows.

    Pages with rows of the log come at the end, since remains of an earlier log may follow newer ones; others that rows
    need never change.
    """
    tables, frames = copy.read_bytes(), _frames(path)
    if not log_only:
        shutil.copyfile(path, copy)
    count = -(-max(path.stat().st_size, len(tables)) // PAGE_BYTES) + len(frames)
    with copy.open("r+b") as stream:

        def is_leaf(number: int) -> bool:
            stream.seek((number - 1) * PAGE_BYTES)
            return stream.read(1) == bytes([_LEAF])

        stream.write(tables[:PAGE_BYTES])
        leaves = [] if log_only else [number for number in range(2, count + 1) if is_leaf(number)]
        for number, page in frames:
            if page[0] == _LEAF:
                count += 1
                leaves.append(number := count)
            elif not 1 < number <= count or is_leaf(number):
                continue
            stream.seek((number - 1) * PAGE_BYTES)
            stream.write(page)
        stream.truncate(count * PAGE_BYTES)
        stream.seek(_PAGES_AT)
        stream.write(count.to_bytes(4, "big"))
    return leaves


def _frames(path: Path) -> list[tuple[int, bytes]]:
    """Numbers and contents of the pages in the log of a file, in the order in which they were written."""
    log = path.with_name(f"{path.name}-wal")
    content, stride = log.read_bytes()[_LOG_HEADER:] if log.exists() else b"", _FRAME_HEADER + PAGE_BYTES
    frames = [content[at : at + stride].ljust(stride, b"\0") for at in range(0, len(content), stride)]
    return [(int.from_bytes(frame[:4], "big"), frame[_FRAME_HEADER:]) for frame in frames]
