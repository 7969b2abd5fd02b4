"""Tables that people write as CSV files: a header, and rows with a field for each of its columns.

Fields are separated by commas; by semicolons or tabs, as spreadsheets write them in some countries, decimal commas are
read, too, and a point may stand between thousands. And cells of tables that are written for them.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from tripod_doe.errors import InputError, TooLargeError, printable
from tripod_doe.files.checksum_list import refuse_changed
from tripod_doe.files.regular_files import read_regular, text_of
from tripod_doe.typed_numbers import number_or_text, readings

_ABOVE = re.compile(r"\s*(?:$|#(?![,;\t]))|\"?sep=.\"?\r?$", re.I)
"""A line above the header: empty, a comment, or the separator that Excel is to take."""
_FORMULA = re.compile(r"[=+\-@\t\r]")  # how a spreadsheet takes a cell for one


def read_csv_table(path: Path, where: str, most: int | None = None) -> tuple[list[str], dict[int, list[str]]]:
    """Read the header and, by their lines in the file, the rows of a table, without spaces around the fields.

    Args:
        path: The file, in any encoding of `text_of`. Empty lines in it are skipped, as are comments (#) above
            the header, and empty columns at the end.
        where: The file or key that names the table, for messages.
        most: Rows that may be there; reading ends with the first one beyond. None without a limit.

    Raises:
        InputError: If the file cannot be read, does not match its checksum, names a column twice, has no rows, or a row
            of another length.
        TooLargeError: If it has more rows than allowed.
    """
    rows: dict[int, list[str]] = {}
    refuse_changed(path)
    try:
        lines = io.StringIO(text_of(read_regular(path, links=True)), newline="").readlines()
    except (OSError, InputError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{where}: cannot read {path}: {reason}") from error
    above = _header_line(lines)
    if above < len(lines) and _ABOVE.match(lines[above]):
        lines[above] = lines[above].lstrip().lstrip("#").lstrip()
    separator = max(",;\t", key="".join(lines[above : above + 1]).count)
    reader = csv.reader(lines[above:], delimiter=separator, strict=True)
    try:
        for row in filter(None, reader):
            rows[above + reader.line_num] = [field.strip() for field in row]
            if most is not None and len(rows) > most + 1:  # one is the header
                raise TooLargeError(f"{where}: more than {most:,} rows; at most {most:,} are allowed here")
    except csv.Error as error:
        raise InputError(f"{where}: cannot read {path}: {error}") from error
    unused = min((_empty_at_the_end(row) for row in rows.values()), default=0)
    rows = {line: row[: len(row) - unused] for line, row in rows.items()}
    header = rows.pop(next(iter(rows), 0), [])
    counts = Counter(header)
    if twice := [name for name, count in counts.items() if count > 1]:
        raise InputError(f"{where}: column {twice[0]!r} occurs {counts[twice[0]]} times; keep one of them")
    if not rows:
        raise InputError(f"{where}: no rows below the header")
    for line, row in rows.items():
        if len(row) != len(header):
            raise InputError(f"{where}: line {line} has {len(row)} fields, the header {len(header)}")
    return header, rows if separator == "," else _with_points(header, rows, where)


def _header_line(lines: list[str]) -> int:
    """Index of the header; where numbers follow comments, the last of these is the header."""
    first = next((at for at, line in enumerate(lines) if not _ABOVE.match(line)), len(lines))
    if not 0 < first < len(lines) or not lines[first - 1].lstrip().startswith("#"):
        return first
    numbers = all(readings(field.strip()) for field in re.split("[,;\t]", lines[first]) if field.strip())
    return first - 1 if numbers else first


def _empty_at_the_end(row: list[str]) -> int:
    """Number of the last fields that are empty."""
    return next((at for at, field in enumerate(reversed(row)) if field), len(row))


def _with_points(header: list[str], rows: dict[int, list[str]], where: str) -> dict[int, list[str]]:
    """The rows, with decimal points in place of decimal commas.

    Numbers with one meaning show the decimal sign. So 1,200 is 1.2 if there is a 1,5, and 1.200 if there is a 1.5.
    Where none shows it, 1.200 is 1.2 in a column without whole numbers.

    Raises:
        InputError: For another number that may be in thousands.
    """
    read = {field: readings(field) for row in rows.values() for field in row if "," in field or "." in field}
    clear = {field for field, values in read.items() if len(values) == 1}
    commas = any(re.fullmatch(r"[^,]*,[^.,]*", field) for field in clear)
    points = any("." in field and number_or_text(field) == read[field][0] for field in clear)
    signs = "," * (commas and not points) + "." * (points and not commas)
    for name, *column in zip(header, *rows.values(), strict=True):
        unclear = _unclear(column, read, signs, shown=commas or points)
        if unclear:
            small, large = read[unclear]
            way = f"write {large:.0f}, or {unclear}0 for {small:g}"
            at = f"{where}: line {list(rows)[column.index(unclear)]}: {name} = {unclear}"
            raise InputError(f"{at}: may mean {small:g} or {large:.0f}; {way}")
    meant = {f: repr(read[f][0]) for f in read if "," in f and (f in clear or (read[f] and signs == ","))}
    return {line: [meant.get(field, field) for field in row] for line, row in rows.items()}


def _unclear(column: list[str], read: Mapping[str, list[float]], signs: str, shown: bool) -> str:
    """The first number of a column that may have a decimal sign or one between thousands; empty if none, or for words.

    Args:
        read: What each field with a sign may mean.
        signs: The decimal sign that the other numbers of the table show; empty if they show none, or both.
        shown: Whether they show any.
    """
    if not all(readings(field) for field in column if field):
        return ""
    whole = any(re.fullmatch(r"[+-]?[0-9]+", field) for field in column)
    known = signs if shown else "." * (not whole)
    return next((f for f in column if len(read.get(f, ())) > 1 and not any(sign in f for sign in known)), "")


def csv_cell(value: object) -> object:
    """A value as a cell of a CSV file: a text like a formula gets a ' in front, and control characters are escapes."""
    if not isinstance(value, str):
        return value
    return printable(f"'{value}" if _FORMULA.match(value) else value)
