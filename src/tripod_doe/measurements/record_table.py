"""Tables of records: a column ``file``, one for each parameter that differs between the records, and labels."""

import re
from collections.abc import Collection, Iterable
from pathlib import Path

from tripod_doe.errors import InputError, closest, misspelt
from tripod_doe.files.csv_table import read_csv_table
from tripod_doe.measurements.headings import operating_name


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
    """The parameter that a column names otherwise: but for a letter or two, or with another unit or case; else empty.

    As ``Torque [kNm]``, ``torque_n_m [Nm]``, ``Drehmoment``.
    """
    if column in parameters:
        return ""
    words = re.findall(r"[^\W_]+", re.sub(r"[\[(<].*", "", column).lower())
    named = re.compile(f"{'_?'.join(map(re.escape, words))}(_[a-z]{{1,3}}){{0,3}}")
    whole = "".join(words)
    alike = [n for n in parameters if words and (named.fullmatch(n) or n.replace("_", "") == whole)]
    return misspelt(column, parameters) or (alike[0] if alike else operating_name(column))


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
