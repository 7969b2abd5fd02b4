"""An uploaded measurement beside a point of a cube."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.comparison.comparison import compare, parse_speeds
from tripod_doe.analyses.comparison.model_point import model_point
from tripod_doe.analyses.comparison.sentences import ORDER_HEADS, comparison_json, find_in_comparison, order_rows
from tripod_doe.analyses.records.measurement import read_measurement
from tripod_doe.errors import InputError
from tripod_doe.service.explorer.figures.lines import lines
from tripod_doe.service.explorer.figures.point import bars
from tripod_doe.study.results.result_cube import opened_cube

MEASUREMENT = "measurement.csv"
"""How messages call the uploaded table."""


def compared_upload(
    path: str,
    measurement: str,
    *,
    select: Sequence[str],
    nearest: bool,
    columns: Mapping[str, str],
    pulses_per_revolution: int,
    reference_angle: float | None,
    speeds: str | None,
) -> xr.Dataset:
    """Compare an uploaded measurement with one point of a cube, or with the points over speed.

    Args:
        measurement: Text of the table (CSV).
        select, nearest, columns, pulses_per_revolution, reference_angle, speeds: As the flags of ``tripod-doe
            compare``.

    Returns:
        As `compare` gives it.

    Raises:
        InputError: If the table or the selection cannot be used.
    """
    with opened_cube(path) as cube:
        point = model_point(cube, select, nearest).load()
    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as folder:
        file = Path(folder) / MEASUREMENT
        file.write_text(measurement, encoding="utf-8", newline="")
        try:
            record = read_measurement(file, pulses_per_revolution, columns)
            return compare(record, point, reference_angle, parse_speeds(speeds))
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from error


def compare_upload(path: str, measurement: str, **settings: Any) -> dict[str, Any]:
    """The same as the object of ``compare --format json``."""
    return json.loads(comparison_json(compared_upload(path, measurement, **settings)))


def lay_over(path: str, measurement: str, **settings: Any) -> Any:
    """The same as findings, a table of orders and figures of measurement and model over each other."""
    compared = compared_upload(path, measurement, **settings)
    return {
        "findings": find_in_comparison(compared),
        "heads": ORDER_HEADS,
        "rows": order_rows(compared),
        "figures": {
            "waveform": lines(_beside(compared, "thrust", "thrust"), "rotation_deg", "of"),
            "orders": bars(_beside(compared, "amplitude", "thrust_amplitude"), "order", "of"),
        },
    }


def _beside(compared: xr.Dataset, ending: str, name: str) -> xr.Dataset:
    """Measurement and model along a dimension ``of``, with the uncertainty of the former where it is known."""
    both = [compared[f"{which}_{ending}"] for which in ("measured", "model")]
    pairs = {name: xr.concat(both, xr.Variable("of", ["measured", "model"])).assign_attrs(units="N")}
    if (unsure := f"measured_{ending}_uncertainty") in compared:
        error = compared[unsure]
        pairs[f"{name}_error"] = xr.concat(
            [error, xr.full_like(error, np.nan)], xr.Variable("of", ["measured", "model"])
        )
    return xr.Dataset(pairs)
