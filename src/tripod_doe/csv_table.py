"""Tables that people write as CSV files: a header, and rows with a field for each of its columns.

Fields are separated by commas; by semicolons or tabs, as spreadsheets write them in some countries, decimal commas are
read, too.
"""

import csv
import re
from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path

from tripod_doe.checksum_list import refuse_changed
from tripod_doe.errors import InputError, TooLargeError, closest, misspelt
from tripod_doe.regular_files import refuse_irregular
from tripod_doe.typed_numbers import readings


def read_csv_table(path: Path, where: str, most: int | None = None) -> tuple[list[str], dict[int, list[str]]]:
    """Read the header and, by their lines in the file, the rows of a table, without spaces around the fields.

    Args:
        path: The file; empty lines in it are skipped.
        where: The file or key that names the table, for messages.
        most: Rows that may be there; reading ends with the first one beyond. None without a limit.

    Raises:
        InputError: If the file cannot be read, does not match its checksum, names a column twice, has no rows, or a row
            of another length.
        TooLargeError: If it has more rows than allowed.
    """
    rows: dict[int, list[str]] = {}
    refuse_irregular(path)
    refuse_changed(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            first = next((line for line in stream if line.strip()), "")
            stream.seek(0)
            separator = max(",;\t", key=first.count)
            reader = csv.reader(stream, delimiter=separator, strict=True)
            for row in filter(None, reader):
                rows[reader.line_num] = [_with_point(field.strip(), separator) for field in row]
                if most is not None and len(rows) > most + 1:  # one is the header
                    raise TooLargeError(f"{where}: more than {most:,} rows; at most {most:,} are allowed here")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{where}: cannot read {path}: {reason}") from error
    header = rows.pop(next(iter(rows), 0), [])
    counts = Counter(header)
    if twice := [name for name, count in counts.items() if count > 1]:
        raise InputError(f"{where}: column {twice[0]!r} occurs {counts[twice[0]]} times; keep one of them")
    if not rows:
        raise InputError(f"{where}: no rows below the header")
    for line, row in rows.items():
        if len(row) != len(header):
            raise InputError(f"{where}: line {line} has {len(row)} fields, the header {len(header)}")
    return header, rows


def _with_point(field: str, separator: str) -> str:
    """A field, with a decimal point where its comma can only be the decimal sign: 1,5 but not 1,200."""
    if separator == "," or "," not in field or len(read := readings(field)) != 1:
        return field
    return repr(read[0])


def read_record_table(
    path: Path, where: str, parameters: Collection[str], most: int | None = None
) -> tuple[list[str], dict[int, dict[str, str]]]:
    """Read a table with a column ``file``, the record of each row; the rows by column, without empty ones.

    Raises:
        InputError: See `read_csv_table`; also where there is no such column, or one is nearly a parameter.
    """
    header, rows = read_csv_table(path, where, most)
    if "file" not in header:
        raise InputError(f"{where}: no column 'file'{closest('file', header)}; it names the record of each row")
    refuse_misspelt(header, parameters, where)
    return header, {line: dict(zip(header, row, strict=True)) for line, row in rows.items() if any(row)}


def _meant(column: str, parameters: Collection[str]) -> str:
    """The parameter that a column names but for a letter or two, or without its unit: ``Torque [kNm]``; else empty."""
    words = re.findall(r"[^\W_]+", re.sub(r"[\[(<].*", "", column).lower())
    without_unit = re.compile(f"{'_'.join(map(re.escape, words))}(_[a-z]{{1,3}}){{1,3}}")
    bare = [name for name in parameters if words and column not in parameters and without_unit.fullmatch(name)]
    return misspelt(column, parameters) or (bare[0] if bare else "")


def refuse_misspelt(header: Iterable[str], parameters: Collection[str], where: str) -> None:
    """Refuse a column whose name is a parameter's but for its unit or a letter or two: it would be read as a label.

    Args:
        where: The file or key that names the table, for messages.

    Raises:
        InputError: For the first such column.
    """
    for column in header:
        if meant := _meant(column, parameters):
            raise InputError(f"{where}: the column {column} would be a label; write {meant}, or another word")
