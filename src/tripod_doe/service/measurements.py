"""An uploaded measurement beside a point of a cube."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tripod_doe.analysis.comparison import compare, model_point, parse_speeds
from tripod_doe.analysis.measurement import read_measurement
from tripod_doe.errors import InputError
from tripod_doe.report.comparison import comparison_json
from tripod_doe.study.results import open_cube

__all__ = ["MEASUREMENT", "compare_upload"]

MEASUREMENT = "measurement.csv"
"""How messages call the uploaded table."""


def compare_upload(
    path: str,
    measurement: str,
    select: Sequence[str],
    nearest: bool,
    columns: Mapping[str, str],
    pulses_per_revolution: int,
    reference_angle: float | None,
    speeds: str | None,
) -> dict[str, Any]:
    """Compare an uploaded measurement with one point of a cube, or with the points over speed.

    Parameters
    ----------
    path
        Result directory or cube.
    measurement
        Text of the table (CSV).
    select, nearest, columns, pulses_per_revolution, reference_angle, speeds
        As the flags of ``tripod-doe compare``.

    Returns
    -------
    dict
        The object of ``compare --format json``.

    Raises
    ------
    InputError
        If the table or the selection cannot be used.
    """
    point = model_point(open_cube(path), select, nearest)
    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as folder:
        file = Path(folder) / MEASUREMENT
        file.write_text(measurement, encoding="utf-8", newline="")
        try:
            record = read_measurement(file, pulses_per_revolution, columns)
            compared = compare(record, point, reference_angle, parse_speeds(speeds))
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from error
    told: dict[str, Any] = json.loads(comparison_json(compared).replace(f"{folder}/", ""))
    return told
