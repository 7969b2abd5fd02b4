"""An uploaded measurement compared with a point of a cube."""

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.comparison.comparison import VERDICTS, parse_speeds
from tripod_doe.analyses.comparison.record_comparison import Reading, compare_record
from tripod_doe.analyses.comparison.record_point import RecordRow
from tripod_doe.analyses.comparison.sentences import ORDER_HEADS, comparison_json, find_in_comparison, order_rows
from tripod_doe.errors import InputError
from tripod_doe.measurements.headings import OPERATING, ROLES, roles_of
from tripod_doe.measurements.record_file import read_table_of
from tripod_doe.number_text import interval
from tripod_doe.service.explorer.figures.lines import lines
from tripod_doe.service.explorer.figures.point import bars
from tripod_doe.study.result_directory.open_cube import opened_study

_PREVIEWED = 6  # rows and notes

MEASUREMENT = "measurement.csv"
"""How messages call the uploaded table."""


def compared_upload(
    path: str,
    measurement: str,
    *,
    select: Sequence[str],
    nearest: bool,
    columns: Mapping[str, str],
    pulses_per_revolution: int | None,
    sign: int,
    reference_angle: float | None,
    speeds: str | None,
) -> xr.Dataset:
    """Compare an uploaded measurement with its point of a cube, or with the points over speed.

    Args:
        measurement: Text of the table (CSV).
        select, nearest, columns, pulses_per_revolution, sign, reference_angle, speeds: As the flags of ``tripod-doe
            compare``.

    Returns:
        As `compare_record` gives it.

    Raises:
        InputError: If the table or the selection cannot be used.
    """
    reading = Reading(columns, pulses_per_revolution, None, sign, reference_angle, parse_speeds(speeds))
    with uploaded(measurement) as file, opened_study(path) as cube:
        comparison = compare_record(cube, RecordRow(file), reading, select, nearest).comparison
    assert comparison is not None
    return comparison


@contextmanager
def uploaded(measurement: str) -> Iterator[Path]:
    """A file with an uploaded table, which messages call `MEASUREMENT`."""
    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as folder:
        file = Path(folder) / MEASUREMENT
        file.write_text(measurement, encoding="utf-8", newline="")
        try:
            yield file
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from error


def preview(measurement: str) -> dict[str, Any]:
    """Headings, first rows, and the column assigned to each heading; an unclear heading gives a complaint.

    Raises:
        InputError: If it is no table.
    """
    with uploaded(measurement) as file:
        table = read_table_of(file, {})
    complaint, columns = "", dict[str, str]()
    for role in ROLES:
        try:
            found = roles_of(table.headings, dict.fromkeys(ROLES.keys() - {role}, ""))
        except InputError as error:
            complaint = str(error)
        else:
            columns |= {name: table.headings[at] for name, at in found.items()}
    rows = zip(*(column.head(_PREVIEWED).astype("string").fillna("").tolist() for column in table.columns), strict=True)
    return {
        "headings": list(table.headings),
        "rows": [list(row) for row in rows],
        "columns": columns,
        "roles": [role for role in ROLES if role not in OPERATING],
        "complaint": complaint,
        "notes": list(table.notes[:_PREVIEWED]),
    }


def compare_upload(path: str, measurement: str, **settings: Any) -> dict[str, Any]:
    """The same as the object of ``compare --format json``."""
    return json.loads(comparison_json(compared_upload(path, measurement, **settings)))


def lay_over(path: str, measurement: str, **settings: Any) -> Any:
    """The same comparison as findings, a table of orders, and figures with measurement and model overlaid."""
    compared = compared_upload(path, measurement, **settings)
    return {
        "findings": find_in_comparison(compared),
        "third": _third_of(compared),
        "heads": ORDER_HEADS,
        "rows": order_rows(compared),
        "figures": {
            "waveform": lines(_measured_and_computed(compared, "thrust", "thrust"), "rotation_deg", "of"),
            "orders": bars(_measured_and_computed(compared, "amplitude", "thrust_amplitude"), "order", "of"),
        },
    }


def _third_of(compared: xr.Dataset) -> list[str]:
    """The point, and its third order: one row of the overview of several files."""
    third = compared.sel(order=3)
    measured, model = float(third["measured_amplitude"]), float(third["model_amplitude"])
    point = ", ".join(f"{name} {value}" for name, value in json.loads(str(compared.attrs["point"])).items())
    return [
        point,
        interval(measured, float(third["measured_amplitude_uncertainty"])),
        interval(model, float(third["model_amplitude_uncertainty"])),
        f"{100 * (measured / model - 1):+.1f} %" if model else "-",
        VERDICTS[int(third["agrees"])],
    ]


def _measured_and_computed(compared: xr.Dataset, ending: str, name: str) -> xr.Dataset:
    """Measurement and model along a dimension ``of``, with the uncertainty of the measurement if known."""
    both = [compared[f"{which}_{ending}"] for which in ("measured", "model")]
    pairs = {name: xr.concat(both, xr.Variable("of", ["measured", "model"])).assign_attrs(units="N")}
    if (unsure := f"measured_{ending}_uncertainty") in compared:
        error = compared[unsure]
        pairs[f"{name}_error"] = xr.concat(
            [error, xr.full_like(error, np.nan)], xr.Variable("of", ["measured", "model"])
        )
    return xr.Dataset(pairs)
