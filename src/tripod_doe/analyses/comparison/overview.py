"""Many records compared with one cube: a row for each order of a record, with uncertainties and a verdict; CSV, JSON.

The operating point of a record is in a table of records. A point that the cube lacks is simulated.
"""

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import xarray as xr

from tripod_doe.analyses.comparison.comparison import NOT_COMPARED, VERDICTS
from tripod_doe.analyses.comparison.record_comparison import ComparedRecord, Reading, compare_record
from tripod_doe.analyses.comparison.record_point import RecordRow
from tripod_doe.errors import CubeError, InputError
from tripod_doe.files.csv_table import csv_cell
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.record_table import read_record_table
from tripod_doe.number_text import plain_json


@dataclass(frozen=True)
class OverviewRow:
    """One order of one record, amplitudes and their uncertainties of 95 % in N."""

    file: str
    order: int
    measured: float
    measured_error: float
    computed: float
    computed_error: float
    verdict: str


def read_table(path: Path) -> list[RecordRow]:
    """Read a table of records: a column `file`, relative to the table, and a column for each parameter that differs.

    Raises:
        InputError: If it cannot be read, has no column `file`, or a cell is no value of its parameter.
    """
    rows = []
    for number, cells in read_record_table(path, str(path), JOINT_PARAMETERS)[1].items():
        file = path.parent / cells.pop("file")
        try:
            values = {
                name: JOINT_PARAMETERS[name].typed(text)
                for name, text in cells.items()
                if name in JOINT_PARAMETERS and text
            }
        except InputError as error:
            raise InputError(f"{path}: line {number}: {error}") from error
        rows.append(RecordRow(file, values))
    return rows


def compare_records(
    cube: xr.Dataset, rows: Sequence[RecordRow], reading: Reading, select: Sequence[str] = (), nearest: bool = False
) -> list[ComparedRecord]:
    """Compare records with the points of a cube.

    Args:
        cube: The cube.
        rows: The records.
        reading: How they are read.
        select: ``name=value`` of factors that all records share.
        nearest: Take the nearest point for what neither the table nor the record says.

    Returns:
        One for each record; a record that cannot be read or compared is among them, with the reason.
    """
    compared = []
    for row in rows:
        try:
            compared.append(compare_record(cube, row, reading, select, nearest))
        except CubeError:
            raise
        except InputError as problem:
            compared.append(ComparedRecord(row, problem=str(problem)))
    return compared


def overview_rows(records: Sequence[ComparedRecord]) -> list[OverviewRow]:
    """A row for each order of each record."""
    return [_row(record, int(order)) for record in records for order in ORDERS.tolist()]


def _row(record: ComparedRecord, order: int) -> OverviewRow:
    if record.comparison is None:
        return OverviewRow(record.name, order, math.nan, math.nan, math.nan, math.nan, VERDICTS[NOT_COMPARED])
    own = record.comparison.sel(order=order)
    measured, unsure, computed, error = (
        float(own[name + part]) for name in ("measured_amplitude", "model_amplitude") for part in ("", "_uncertainty")
    )
    return OverviewRow(record.name, order, measured, unsure, computed, error, VERDICTS[int(own["agrees"])])


def overview_csv(rows: Sequence[OverviewRow]) -> str:
    """The overview as a table: file, order, measured, measured_error, computed, computed_error, verdict."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([one.name for one in fields(OverviewRow)])
    for row in rows:
        cells = ["" if isinstance(value, float) and math.isnan(value) else value for value in asdict(row).values()]
        writer.writerow(map(csv_cell, cells))
    return buffer.getvalue()


def overview_json(rows: Sequence[OverviewRow]) -> str:
    """The overview as a list of objects; NaN is null."""
    return json.dumps(plain_json([asdict(row) for row in rows]))
