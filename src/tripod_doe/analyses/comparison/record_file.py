"""Files of measurements as recorders write them: separators, decimal commas, lines before the table, names and units.

A column is known by its name in any case, with its unit in brackets or at its end: ``thrust_n``, ``Axial force [kN]``,
``Time (ms)``, ``Zeit/s``. Values are converted to the units of this package.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, closest, option
from tripod_doe.regular_files import refuse_irregular


@dataclass(frozen=True)
class Role:
    """What a column can be: names that people give it, and units with their factors to ours."""

    words: frozenset[str]
    units: Mapping[str, float]


_FORCE = {"n": 1.0, "kn": 1e3, "dan": 10.0, "lbf": 4.4482216152605}
_ANGLE = {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "rad": 180 / np.pi, "rev": 360.0, "turns": 360.0}
_TIME = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}
ROLES = {
    "thrust_n": Role(
        frozenset(
            {
                "thrust",
                "thrust force",
                "axial force",
                "axial thrust",
                "force",
                "gaf",
                "generated axial force",
                "kraft",
                "axialkraft",
            }
        ),
        _FORCE,
    ),
    "rotation_deg": Role(
        frozenset(
            {"rotation", "rotation angle", "angle", "shaft angle", "angle of rotation", "phi", "winkel", "drehwinkel"}
        ),
        _ANGLE,
    ),
    "time_s": Role(frozenset({"time", "t", "zeit"}), _TIME),
    "tacho": Role(frozenset({"tacho", "tachometer", "tach", "pulse", "pulses", "trigger", "keyphasor"}), {}),
}
"""Columns of a measurement by our name of each."""

_SEPARATORS = ((";", ","), (";", "."), ("\t", ","), ("\t", "."), (",", "."), (None, "."), (None, ","))
"""Separator (None: spaces) and decimal sign, in the order in which they are preferred."""
_LOOKED_AT = 300  # lines from which separator and beginning of the table are known
_UNIT = re.compile(r"^(.*?)\s*(?:[\[(<]\s*(.*?)\s*[\])>]|[/,_]\s*([^\s/,_]+))\s*$")


@dataclass(frozen=True)
class Record:
    """A table of a measurement."""

    # values by our names of the columns, in our units; NaN where a field is empty. Shape (row,) each.
    columns: Mapping[str, FloatArray]
    headings: tuple[str, ...]  # all headings of the file
    taken: str  # in words, which heading was taken for which column; empty where the file has our own names


def read_record(path: Path, given: Mapping[str, str] | None = None) -> Record:
    """Read a table of a measurement.

    Args:
        path: Text file: numbers in columns, one line of headings before them; a line of units may follow the headings.
            Lines that start with # are ignored.
        given: Headings by our names, where the file's are not known.

    Raises:
        InputError: If the file cannot be read, holds no table, a heading is ambiguous or its unit unknown, or a field
            is no number.
    """
    lines = _lines(path)
    separator, decimal = _form(lines[:_LOOKED_AT])
    first = next((i for i, line in enumerate(lines) if _is_numeric(line, separator, decimal)), len(lines))
    if first == 0 or (first == len(lines) and len(lines) < 2):
        raise InputError("not a CSV file with one line of column names above rows of numbers")
    first = 1 if first == len(lines) else first
    headings = _headings(lines[:first], separator)
    table = _table(lines[first:], separator, decimal, len(headings))
    columns, taken = {}, []
    for role, position in _positions(headings, given or {}).items():
        heading = headings[position]
        factor = _factor(role, heading)
        columns[role] = factor * _numbers(table[position], heading, decimal)
        if heading != role:
            taken.append(f"{role} from {heading!r}" + (f" times {factor:.6g}" if factor != 1 else ""))
    return Record(columns, tuple(headings), ", ".join(taken))


def parse_column(text: str) -> tuple[str, str]:
    """Our name of a column and its heading in a file, from ``NAME=HEADING``.

    Raises:
        InputError: If the text has another form.
    """
    name, equals, heading = (part.strip() for part in text.partition("="))
    if not equals or not heading or name.replace("-", "_") not in ROLES:
        raise InputError(f"{option('column', text)}: write NAME=HEADING, a NAME of {', '.join(ROLES)}")
    return name.replace("-", "_"), heading


def _lines(path: Path) -> list[str]:
    refuse_irregular(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the measurement: {error.strerror}") from error
    if b"\0" in content:
        raise InputError("not a CSV file with one line of column names: it is no text")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")  # a recorder's degree sign
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _fields(line: str, separator: str | None) -> list[str]:
    return [field.strip().strip('"').strip() for field in line.split(separator)]


def _is_number(field: str, decimal: str) -> bool:
    if decimal == "," and "." in field:
        return False
    try:
        float(field.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _is_numeric(line: str, separator: str | None, decimal: str) -> bool:
    """Whether a line is a row of at least two fields, all of them numbers or empty."""
    fields = _fields(line, separator)
    filled = [field for field in fields if field]
    return len(fields) > 1 and bool(filled) and all(_is_number(field, decimal) for field in filled)


def _form(lines: Sequence[str]) -> tuple[str | None, str]:
    """Separator and decimal sign with which the most lines are rows of numbers."""
    rows = [sum(_is_numeric(line, *form) for line in lines) for form in _SEPARATORS]
    return _SEPARATORS[int(np.argmax(rows))] if any(rows) else (",", ".")


def _headings(before: Sequence[str], separator: str | None) -> list[str]:
    """Headings from the lines before the numbers: the last one, or the one before it where that holds the units."""
    last = _fields(before[-1], separator)
    known = {unit for role in ROLES.values() for unit in role.units} | {"v", "-", "1"}
    if len(before) > 1 and all(field.strip("[]()").lower() in known for field in last if field) and any(last):
        names = _fields(before[-2], separator)
        if len(names) == len(last):
            return [f"{name} [{unit.strip('[]()')}]" if unit else name for name, unit in zip(names, last, strict=True)]
    return last


def _table(rows: Sequence[str], separator: str | None, decimal: str, width: int) -> Mapping[int, pd.Series[float]]:
    """Columns of the rows by their position; a separator at the end of the lines makes an empty column more."""
    wide = max((len(_fields(row, separator)) for row in rows[:_LOOKED_AT]), default=width)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # fields that would be dropped
            table = pd.read_csv(
                io.StringIO("\n".join(rows)),
                sep=separator or r"\s+",
                decimal=decimal,
                header=None,
                names=range(max(wide, width)),
                index_col=False,
                low_memory=False,
                skipinitialspace=True,
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning, ValueError) as error:
        raise InputError(f"rows of different length: {str(error).strip()}") from error
    if table.iloc[:, width:].notna().any(axis=None):
        raise InputError("rows of different length: some have more fields than there are column names")
    return {int(position): table[position] for position in range(width)}


def _positions(headings: Sequence[str], given: Mapping[str, str]) -> dict[str, int]:
    """Position of every column that is known, by our name of it."""
    positions = {}
    for role, heading in given.items():
        if heading not in headings:
            raise InputError(
                f"{option('column', f'{role}={heading}')}: no such heading{closest(heading, headings)}; the file has "
                + ", ".join(headings)
            )
        positions[role] = headings.index(heading)
    for role in ROLES.keys() - positions.keys():
        places = [i for i, heading in enumerate(headings) if heading == role]
        places = places or [i for i, heading in enumerate(headings) if _names(role, heading)]
        if len(places) > 1:
            names = " or ".join(repr(headings[i]) for i in places)
            hint = option("column", f"{role}={headings[places[0]]}")
            raise InputError(f"{names} may be {role}: choose one, for instance {hint}")
        if places:
            positions[role] = places[0]
    return {role: positions[role] for role in ROLES if role in positions}


def _split(heading: str) -> tuple[str, str]:
    """Name and unit of a heading; no unit where it has none."""
    match = _UNIT.match(heading)
    if match is None:
        return heading, ""
    return match[1], match[2] or match[3] or ""


def _names(role: str, heading: str) -> bool:
    """Whether a heading is one that people give to a column."""
    return any(
        name.replace("_", " ").replace("-", " ").strip().lower() in ROLES[role].words
        for name in (heading, _split(heading)[0])
    )


def _factor(role: str, heading: str) -> float:
    """What values under a heading are multiplied by: 1 where it names no unit."""
    units = ROLES[role].units
    if not units or heading == role:
        return 1.0
    unit = _split(heading)[1]
    if not unit or heading.replace("_", " ").replace("-", " ").strip().lower() in ROLES[role].words:
        return 1.0
    if unit == "mN":
        return 1e-3
    if unit.lower() not in units:
        raise InputError(f"the unit of {heading!r} is not known; known are {', '.join(units)}")
    return units[unit.lower()]


def _numbers(column: pd.Series[float], heading: str, decimal: str) -> FloatArray:
    """A column as numbers, NaN where a field is empty."""
    if pd.api.types.is_numeric_dtype(column):
        return np.asarray(column, float)
    text = column.astype("string").str.strip().str.replace(decimal, ".", regex=False)
    numbers = np.asarray(pd.to_numeric(text, errors="coerce").to_numpy(float, na_value=np.nan))
    words = np.flatnonzero(np.isnan(numbers) & column.notna().to_numpy())
    if words.size:
        raise InputError(
            f"{heading} = {column.iloc[words[0]]!r} in row {words[0] + 1}: expected a number, or nothing at a dropout"
        )
    return numbers
