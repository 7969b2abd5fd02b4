"""Measurement files of recorders: separators, decimal commas, lines before the table, encodings.

Text files, and TDMS files if npTDMS is installed (the extra ``tdms``). The headings identify the columns (`headings`);
values are converted to the units of this package.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pandas as pd

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.files.regular_files import read_regular, text_of
from tripod_doe.measurements.headings import OPERATING, given_position, is_unit, roles_of, unit_factor, unit_given
from tripod_doe.measurements.tdms_file import is_tdms, read_tdms
from tripod_doe.typed_numbers import readings, typed_number

_SEPARATORS = ((";", ","), (";", "."), ("\t", ","), ("\t", "."), (",", "."), (",", ","), (None, "."), (None, ","))
"""Separator (None: spaces) and decimal sign, in the order in which they are preferred."""
_LOOKED_AT = 300  # lines that determine the separator and the start of the table
_MOST_COLUMNS = 500
_LONGEST = 200  # characters of a heading: the time to look for names and units grows with the square
_CLOCK = re.compile(r"(?<![\d:+])(\d{1,3}):(\d\d)(?::(\d\d(?:[.,]\d*)?))?(?=(?:\s*[+-]\d\d:?\d\d)?[^\d:]*$)")
_GAPS = {"", "-", "--", "---", "nan", "na", "n/a", "#n/a", "null", "none", "inf", "-inf", "ovl", "overflow", "ovr"}
_MDF = b"MDF     "
_SHOWS_DECIMAL = {
    sign: re.compile(
        rf"(?<![0-9{sign}])(?:0[0-9]*|[0-9]{{4,}})?[{sign}][0-9]"  # no group of thousands begins so
        rf"|[{sign}](?:[0-9]{{1,2}}(?![0-9])|[0-9]{{4}}|[0-9]*e)",  # nor has other than three digits
        re.I,
    )
    for sign in ".,"
}
"""A number in which a sign is the decimal one for certain, by sign."""


@dataclass(frozen=True)
class Record:
    """A table of a measurement."""

    # values by our names of the columns, in our units; NaN for an empty field. Shape (row,) each.
    columns: Mapping[str, FloatArray]
    headings: tuple[str, ...]  # all headings of the file, with the units of a line of units
    taken: str  # in words, the column assigned to each heading; empty if the file uses our names
    notes: tuple[str, ...] = ()  # lines before the table, and comments: the recorder's notes on the record
    remarks: tuple[str, ...] = ()  # sentences on assumptions


@dataclass(frozen=True)
class Table:
    """Columns of a file, unchanged."""

    headings: Sequence[str]
    columns: Sequence[pd.Series[float]]
    notes: Sequence[str]
    decimal: str = "."
    # whether all decimal signs stand before three digits, as signs between thousands do; columns are texts then
    may_be_grouped: bool = False


def read_record(path: Path, given: Mapping[str, str] | None = None) -> Record:
    """Read a table of a measurement.

    Args:
        path: Text file: numbers in columns, headings before them; a line of units may follow the headings. Lines that
            start with # are notes. Or a TDMS file.
        given: Headings by our names, for headings that are not recognised. A unit in brackets after a heading replaces
            the unit in the file.

    Raises:
        InputError: If the file cannot be read, holds no table, a heading is ambiguous or its unit unknown, or a field
            is no number, or may be 1.005 or 1005.
    """
    given, table = given or {}, read_table_of(path, given or {})
    if long := next((heading for heading in table.headings if len(heading) > _LONGEST), ""):
        raise InputError(f"{long[:40]}...: a heading of more than {_LONGEST} characters: shorten it")
    columns, taken, remarks = {}, list[str](), list[str]()
    roles = roles_of(table.headings, given)
    sampled = [table.headings[at] for role, at in roles.items() if role not in OPERATING]
    by_heading = dict(zip(table.headings, table.columns, strict=False))
    _refuse_other_times({heading: by_heading[heading] for heading in sorted(sampled, key="time_s".__eq__)})
    for role, position in roles.items():
        heading = unit_given(table.headings[position], given.get(role))
        try:
            factor = unit_factor(role, heading)
            if table.may_be_grouped:
                remarks += _doubts(table.columns[position], heading, table.decimal)
            values = _numbers(table.columns[position], heading, table.decimal, role)
        except InputError:
            if role in OPERATING and role not in given:  # may be stated elsewhere
                continue
            raise
        columns[role] = factor * values
        if heading != role:
            taken.append(f"{role} from {heading!r}" + (f" times {factor:.6g}" if factor != 1 else ""))
    return Record(columns, tuple(table.headings), ", ".join(taken), tuple(table.notes), tuple(remarks))


def _refuse_other_times(columns: Mapping[str, pd.Series[float]]) -> None:
    """Refuse waveforms of a TDMS file whose samples of one row were taken at different times."""
    timed = [(heading, *timing) for heading, column in columns.items() if (timing := column.attrs.get("timing"))]
    for heading, increment, start in timed[1:]:
        first, other, began = timed[0]
        apart, rows = start - began, columns[heading].size
        if abs(apart) + rows * abs(increment - other) > other / 2:
            raise InputError(
                f"{first!r} and {heading!r} were sampled at different times: every {other:g} s and every {increment:g} "
                f"s, the second from {apart:+g} s on; export the record with one sampling rate from one start"
            )


def read_table_of(path: Path, given: Mapping[str, str]) -> Table:
    """Headings and columns of a file of any form; see `read_record`."""
    if is_tdms(path):
        return Table(*read_tdms(path))
    notes, lines = _lines(path)
    for line in lines[:_LOOKED_AT]:  # before any is taken apart; a comma may be a decimal sign
        _refuse_wide(max(len(line.split()), *map(line.count, ";\t"), line.count(",") // 2))
    separator, decimal = _form(lines[:_LOOKED_AT])
    form = separator, decimal, True  # a row with the other sign is a row, and refused later on
    first = next((i for i, line in enumerate(lines) if _is_numeric(line, *form)), len(lines))
    if first == len(lines):  # there is a column of words among the numbers
        numbers = (_numbers_in(_fields(line, separator), decimal, True) for line in lines)
        first = next((i for i, count in enumerate(numbers) if i and count > 1), len(lines))
    if _LOOKED_AT < first < len(lines):
        raise InputError(f"no row of numbers in the first {_LOOKED_AT} lines: remove the lines above the table")
    before = lines[:first]
    if not before and notes:  # headings after a #
        before = [note for note in notes if len(_fields(note, separator)) > 1][-1:]
    if not before or (first == len(lines) and len(lines) < 2):
        raise InputError("not a CSV file with one line of column names above rows of numbers")
    first = 1 if first == len(lines) else first
    before = before[:first] or before
    at, headings = _headings(before, given, lines[first], (separator, decimal))
    _refuse_wide(len(headings))
    text = "\n".join(lines[first:])
    may_be_grouped = decimal in text and not _SHOWS_DECIMAL[decimal].search(text)
    wide = max(len(_fields(line, separator)) for line in lines[first : first + _LOOKED_AT])
    if separator is None and len(headings) > wide:
        raise InputError(
            f"{len(headings)} words above {wide} columns, and spaces do not say which name whose: write tabs or two "
            "spaces between the names"
        )
    widths = len(headings), max(len(headings), wide)
    table = _columns(text, separator, decimal, widths, str if may_be_grouped else None)
    return Table(headings, table, [*notes, *before[:at]], decimal, may_be_grouped)


def _refuse_wide(columns: int) -> None:
    if columns > _MOST_COLUMNS:
        raise InputError(f"more than {_MOST_COLUMNS} columns, the limit for a record: export fewer channels")


def _lines(path: Path) -> tuple[list[str], list[str]]:
    """Lines that start with # (without the #), and the other lines."""
    try:
        content = read_regular(path, links=True)
    except OSError as error:
        raise InputError(f"cannot read the measurement: {error.strerror}") from error
    if content.startswith(_MDF):
        raise InputError("an MDF file is not read: export its channels as CSV, or as TDMS")
    try:
        text = text_of(content)
    except InputError as error:
        raise InputError(f"not a CSV file with one line of column names: {error}") from error
    lines = [line for line in text.splitlines() if line.strip()]
    notes = [line.lstrip().lstrip("#").strip() for line in lines if line.lstrip().startswith("#")]
    return notes, [line for line in lines if not line.lstrip().startswith("#")]


def _fields(line: str, separator: str | None) -> list[str]:
    if '"' in line and separator is not None:
        with_quotes = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        return [field.strip().strip('"').strip() for field in with_quotes]
    return [field.strip().strip('"').strip() for field in line.split(separator)]


def _is_number(field: str, decimal: str, either: bool = False) -> bool:
    """Whether a field is a number, a time of day or a gap; if asked for, also one with the other sign."""
    if (either and readings(field)) or field.casefold() in _GAPS or _CLOCK.search(field):
        return True
    if decimal == "," and "." in field:
        return False
    try:
        typed_number(field.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _is_numeric(line: str, separator: str | None, decimal: str, either: bool = False) -> bool:
    """Whether a line has at least two fields, all numbers, times of day or gaps, and at least one number."""
    fields = _fields(line, separator)
    return (
        len(fields) > 1
        and all(_is_number(field, decimal, either) for field in fields)
        and _numbers_in(fields, decimal, either) > 0
    )


def _numbers_in(fields: Sequence[str], decimal: str, either: bool = False) -> int:
    """How many fields are numbers."""
    return sum(_is_number(field, decimal, either) and field.casefold() not in _GAPS for field in fields)


def _form(lines: Sequence[str]) -> tuple[str | None, str]:
    """Separator and decimal sign for which most lines are rows of numbers, else for which most lines have numbers."""
    rows = [sum(_is_numeric(line, *form) for line in lines) for form in _SEPARATORS]
    if not any(rows):
        rows = [sum(_numbers_in(_fields(line, sign), dec) > 1 for line in lines) for sign, dec in _SEPARATORS]
    return _SEPARATORS[int(np.argmax(rows))] if any(rows) else (",", ".")


def _headings(
    before: Sequence[str], given: Mapping[str, str], row: str, form: tuple[str | None, str]
) -> tuple[int, list[str]]:
    """Index of the heading line among the lines before the numbers, and the headings with their units.

    The heading line has no numbers, and the most names that are known or given; of several such lines, or if there is
    none, it is the last line as wide as the table that is not a line of units.
    """
    wide = len(_fields(row, form[0]))
    parts = [_heading_fields(line, form[0], wide) for line in before]
    units = [sum(map(is_unit, fields)) for fields in parts]
    unit_like = [0 < sum(map(bool, fields)) <= 2 * count for fields, count in zip(parts, units, strict=True)]

    def fitness(at: int) -> tuple[bool, bool, int, bool, int]:
        words = not _numbers_in(parts[at], form[1])
        return len(parts[at]) >= wide, words, _known(parts[at], given), not unit_like[at], at

    at = max(range(len(before)), key=fitness)
    below = [line for line in range(at + 1, len(before)) if unit_like[line]]
    if not below:
        return at, parts[at]
    own = [unit.strip("[]()<>- ") for unit in parts[max(below, key=lambda line: units[line])]]
    if form[0] is None and len(own) < len(parts[at]):
        raise InputError(
            f"the line of units, {' '.join(own)!r}, has fewer fields than there are column names, and spaces do not "
            "say which is whose: write a - for a column without a unit"
        )
    named = zip_longest(parts[at], own[: len(parts[at])], fillvalue="")
    return at, [f"{name} [{unit}]" if unit else name for name, unit in named]


def _heading_fields(line: str, separator: str | None, wide: int) -> list[str]:
    """Fields of a line of headings; if spaces separate columns, a heading may contain some, as before its unit.

    A % in front begins a comment if the names fit without it.
    """
    for text, form in itertools.product((line.strip(), line.strip().lstrip("% ")), (r"\s{2,}|\t", r"\s+(?![\[(<])")):
        if separator is None and len(apart := re.split(form, text)) == wide:
            return [field.strip('",;') for field in apart]
    return _fields(line, separator)


def _known(headings: Sequence[str], given: Mapping[str, str]) -> int:
    """How many headings of a line are known or given."""
    headings, wanted = [heading[:_LONGEST] for heading in headings], {}
    for role, heading in given.items():
        with suppress(InputError):
            given_position(role, heading, headings)
            wanted[role] = heading
    try:
        return len(roles_of(headings, wanted))
    except InputError:  # two headings may be the same column
        return 2


def _columns(
    text: str, separator: str | None, decimal: str, widths: tuple[int, int], kind: type[str] | None
) -> list[pd.Series[float]]:
    """Columns of rows by their position; a separator at the end of the lines adds an empty column.

    Args:
        text, separator, decimal: The rows and their form.
        widths: How many columns have a heading, and how many fields a row has.
        kind: The type of the columns; None for numbers where all fields are numbers.
    """
    width, wide = widths
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # fields that would be dropped
            table = pd.read_csv(
                io.StringIO(text),
                sep=separator or r"\s+",
                decimal=decimal,
                header=None,
                names=range(wide),
                dtype=kind,
                index_col=False,
                low_memory=False,
                skipinitialspace=True,
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning, ValueError) as error:
        raise InputError(f"rows of different length: {str(error).strip()}") from error
    if table.iloc[:, width:].notna().any(axis=None):
        raise InputError("rows of different length: some have more fields than there are column names")
    return [table[position] for position in range(width)]


def _doubts(column: pd.Series[float], heading: str, decimal: str) -> list[str]:
    """A remark that a sign before three digits is taken as the decimal one, if a column has it.

    Raises:
        InputError: If other numbers of the column are whole ones below 1000, as next to signs between thousands.
    """
    text = column.astype("string").str.strip()
    signed = text[text.str.contains(decimal, regex=False).fillna(False)]
    if signed.empty:
        return []
    first, value = signed.iloc[0], signed.iloc[0].replace(decimal, ".")
    if text.str.fullmatch(r"[+-]?[0-9]{1,3}").fillna(False).any():
        raise InputError(
            f"{heading} = {first!r} in row {signed.index[0] + 1} may be {value} or {first.replace(decimal, '')}, since "
            "other rows have whole numbers: export without signs between thousands, or all numbers with decimals"
        )
    return [f"Numbers of {heading} such as {first} are read as {value}: {decimal!r} is taken as the decimal sign."]


def _numbers(column: pd.Series[float], heading: str, decimal: str, role: str) -> FloatArray:
    """A column as numbers; NaN for a field that is empty or no finite number."""
    if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column):
        values = np.array(column, float)
        values[~np.isfinite(values)] = np.nan
        return values
    text = column.astype("string").str.strip()
    numbers = np.array(
        pd.to_numeric(text.str.replace(decimal, ".", regex=False), errors="coerce").to_numpy(float, na_value=np.nan)
    )
    if decimal == ",":
        numbers[text.str.contains(".", regex=False).fillna(False).to_numpy(bool)] = np.nan
    if role == "time_s" and np.isnan(numbers).all():
        numbers = np.array(list(_seconds(text.fillna("").tolist())), float)
    gap = text.fillna("").str.casefold().isin(_GAPS).to_numpy(bool)
    words = np.flatnonzero(np.isnan(numbers) & ~gap)
    if words.size:
        clock = "a time of day as 12:00:01.5, " * (role == "time_s")
        raise InputError(
            f"{heading} = {text.iloc[words[0]]!r} in row {words[0] + 1}: expected {clock}a number with {decimal!r} as "
            "the decimal sign and none between thousands, or nothing at a dropout"
        )
    numbers[~np.isfinite(numbers)] = np.nan
    return numbers


def _seconds(texts: Sequence[str]) -> Iterator[float]:
    """Seconds since the first of some times of day, with or without a date; also across midnight."""
    before, days, start = -np.inf, 0, None
    for text in texts:
        match = _CLOCK.search(text)
        if match is None:
            yield np.nan
            continue
        second = int(match[1]) * 3600 + int(match[2]) * 60 + float((match[3] or "0").replace(",", "."))
        days += second < before - 43_200
        before = second
        start = second if start is None else start
        yield second + 86_400 * days - start
