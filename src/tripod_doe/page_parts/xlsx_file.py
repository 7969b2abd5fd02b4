"""Tables as a workbook (.xlsx): a sheet per table, with units and widths, and the origin of the numbers.

XlsxWriter writes it: it has no dependencies and writes texts as texts, so that no cell of a stranger is a formula.
"""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from tripod_doe.errors import InputError, printable

MOST_ROWS, MOST_COLUMNS = 1_048_576, 16_384
"""Limits of a sheet, from the file format."""

_MOST_LETTERS = 32_767  # of a cell
_WIDEST, _SAMPLE = 60, 200  # letters of a column; rows that determine its width
_NO_NAME = str.maketrans(dict.fromkeys("[]:*?/\\'"))


@dataclass(frozen=True)
class Sheet:
    """One table."""

    name: str
    heads: Sequence[str]
    rows: Sequence[Sequence[Any]]  # numbers, texts, or None for an empty cell
    units: Sequence[str] = ()  # second line of the head; empty for none


def workbook(sheets: Sequence[Sheet]) -> bytes:
    """The file of some tables; InputError if a table is larger than a sheet may be."""
    import xlsxwriter

    buffer = io.BytesIO()
    safe = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False, "nan_inf_to_errors": False}
    with xlsxwriter.Workbook(buffer, safe) as book:
        book.set_properties({"created": datetime(2000, 1, 1), "author": "tripod_doe"})  # the same gives the same bytes
        styles = {
            "head": book.add_format({"bold": True, "bottom": 1, "text_wrap": True, "valign": "top"}),
            "unit": book.add_format({"italic": True, "font_color": "#5c6875"}),
        }
        names = set[str]()
        for sheet in sheets:
            names.add(name := _free_name(sheet.name, names))
            _write(book.add_worksheet(name), sheet, styles)
    return buffer.getvalue()


def _free_name(name: str, taken: set[str]) -> str:
    """A name that a workbook allows and no other sheet has: at most 31 letters, case ignored."""
    name = printable(name).translate(_NO_NAME).strip() or "Table"
    known = {other.lower() for other in taken}
    made = name[:31]
    for number in range(2, len(taken) + 3):
        if made.lower() not in known:
            break
        made = f"{name[:27]} {number}"
    return made


def _write(page: Any, sheet: Sheet, styles: dict[str, Any]) -> None:
    above = 2 if any(sheet.units) else 1
    if len(sheet.rows) + above > MOST_ROWS or len(sheet.heads) > MOST_COLUMNS:
        raise InputError(
            f"{sheet.name}: {len(sheet.rows):,} rows and {len(sheet.heads):,} columns; a sheet holds "
            f"{MOST_ROWS - above:,} and {MOST_COLUMNS:,}: select fewer, or take a CSV file"
        )
    page.write_row(0, 0, map(_text, sheet.heads), styles["head"])
    if above == 2:
        page.write_row(1, 0, map(_text, sheet.units), styles["unit"])
    for at, row in enumerate(sheet.rows, above):
        for column, value in enumerate(row):
            _write_cell(page, at, column, value)
    for column, head in enumerate(sheet.heads):
        texts = [head, *sheet.units[column : column + 1], *(_shown(row[column]) for row in sheet.rows[:_SAMPLE])]
        page.set_column(column, column, min(_WIDEST, max(8, 2 + max(len(text) for text in texts))))
    page.freeze_panes(above, 0)
    if above == 1 and sheet.rows:
        page.autofilter(0, 0, len(sheet.rows), len(sheet.heads) - 1)


def _write_cell(page: Any, row: int, column: int, value: Any) -> None:
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, bool) or not isinstance(value, int | float):
        if value is not None and value != "":
            page.write_string(row, column, _text(str(value)))
    elif math.isfinite(value):
        page.write_number(row, column, value)


def _text(text: str) -> str:
    return printable(text)[:_MOST_LETTERS]


def _shown(value: Any) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
