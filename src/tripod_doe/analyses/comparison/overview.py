"""Many records compared with one cube: an order of a record is a row, with both uncertainties and a verdict.

The operating point of a record stands in a table of records. A point that the cube lacks is simulated.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.comparison.comparison import compare
from tripod_doe.analyses.comparison.model_point import model_point, model_scatter
from tripod_doe.analyses.diff.definitions import fixed_parameters, parsed_study
from tripod_doe.analyses.diff.shared_points import factors_of
from tripod_doe.analyses.fit.model_error import model_error
from tripod_doe.array_types import FloatArray
from tripod_doe.csv_table import read_csv_table
from tripod_doe.errors import CubeError, InputError, closest
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.measurement import Measurement, read_measurement
from tripod_doe.study.definition.scenes import load_simulator
from tripod_doe.study.simulate import simulate

AGREES, DIFFERS, NOT_COMPARED = "agrees", "differs", "not compared"
"""Verdicts: within the uncertainty of measurement and model together, beyond it, or without one of both.

The mean force is not compared, as it holds the preload of the sensor.
"""

_SAME = 0.01  # relative: how near a measured value may be to one of the cube that was aimed at
_STEADY = 0.05  # relative change of speed below which a record has one
_TURNS = 2  # revolutions from which its speed is known
_NORMAL = 1.96  # half width of an interval of 95 % over its standard deviation


@dataclass(frozen=True)
class RecordRow:
    """A record to compare: its file, and what the table says of it."""

    path: Path
    values: Mapping[str, float | str] = field(default_factory=dict)  # of parameters, by name


@dataclass(frozen=True)
class ComparedRecord:
    """A record beside the model; a record that cannot be compared has the reason alone."""

    row: RecordRow
    comparison: xr.Dataset | None = None  # see `compare`
    computed_error: FloatArray = field(default_factory=lambda: np.full(ORDERS.size, np.nan))  # 95 %, N, (order,)
    simulated: bool = False  # whether the cube lacks its point
    problem: str = ""

    @property
    def name(self) -> str:
        """Name of its file."""
        return self.row.path.name


@dataclass(frozen=True)
class OverviewRow:
    """One order of one record, amplitudes and their 95 % uncertainties in N."""

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
    header, lines = read_csv_table(path, str(path))
    if "file" not in header:
        raise InputError(f"{path}: no column 'file'{closest('file', header)}; it names the record of each row")
    rows = []
    for number, line in lines.items():
        if not any(line):  # as spreadsheets leave them
            continue
        cells = dict(zip(header, line, strict=True))
        file = path.parent / cells.pop("file")
        try:
            values = {name: _value(name, text) for name, text in cells.items() if name in JOINT_PARAMETERS and text}
        except InputError as error:
            raise InputError(f"{path}: line {number}: {error}") from error
        rows.append(RecordRow(file, values))
    return rows


def _value(name: str, text: str) -> float | str:
    parameter = JOINT_PARAMETERS[name]
    if parameter.kind == "choice":
        return str(parameter.check(text))
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{name} = {text!r}: expected a number ({parameter.range_text})") from error


@dataclass(frozen=True)
class Reading:
    """How records are read and aligned: what `read_measurement` and `compare` take."""

    columns: Mapping[str, str] | None = None
    pulses_per_revolution: int | None = None
    pattern: str | None = None
    sign: float = 1.0
    reference_angle_deg: float | None = None
    speeds_rpm: tuple[float, float] | None = None


def compare_record(
    cube: xr.Dataset, row: RecordRow, reading: Reading, select: Sequence[str] = (), nearest: bool = False
) -> ComparedRecord:
    """Compare one record with its point of a cube; see `compare_records`.

    Raises:
        InputError: If the record cannot be read or compared.
    """
    speed = row.values.get("speed_rpm")
    known_speed = None if speed is None else float(speed)
    measurement = read_measurement(
        row.path, reading.pulses_per_revolution, reading.columns, reading.pattern, known_speed, reading.sign
    )
    row = with_stated_values(cube, row, measurement, select)
    point, simulated = point_of_record(cube, row, select, nearest)
    comparison = compare(measurement, point, reading.reference_angle_deg, reading.speeds_rpm)
    return ComparedRecord(row, comparison, _computed_error(cube, row, comparison, point), simulated)


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


def with_stated_values(cube: xr.Dataset, row: RecordRow, measurement: Measurement, select: Sequence[str]) -> RecordRow:
    """A record with what it states of its operating point, where the table and the selection say nothing.

    A value within a hundredth of one of the cube is that value. The speed is that of its revolutions; where the cube
    has several speeds around it, each revolution is compared at its own.
    """
    known = {*row.values, *(text.partition("=")[0] for text in select)}
    of_joint = str(cube.attrs.get("source", "")).endswith("simulator joint")
    factors, fixed = factors_of(cube), fixed_parameters(cube)
    stated = {**measurement.operating, **_own_speed(measurement)}
    values: dict[str, float | str] = {}
    for name, value in stated.items():
        if name in known or not (name in factors or of_joint):
            continue
        levels = np.unique(cube[name].values if name in factors else [fixed.get(name, _default(name))]).astype(float)
        if name == "speed_rpm" and levels.size > 1 and levels[0] <= value <= levels[-1]:
            continue
        near = float(levels[np.argmin(np.abs(levels - value))])
        values[name] = near if abs(near - value) <= _SAME * abs(value) else value
    return replace(row, values={**values, **row.values}) if values else row


def _own_speed(measurement: Measurement) -> dict[str, float]:
    """Mean speed of a record that does not run up; nothing where its time is not known."""
    angle, time = measurement.rotation_deg, measurement.time_s
    if time is None or angle.size < 2 or not angle[-1] > angle[0] + _TURNS * 360:
        return {}
    whole = np.arange(angle[0], angle[-1], 360.0)
    speed = 60 / np.diff(np.interp(whole, angle, time))
    return {"speed_rpm": float(speed.mean())} if np.ptp(speed) < _STEADY * speed.mean() else {}


def _default(name: str) -> float:
    default = JOINT_PARAMETERS[name].default
    return float(default) if isinstance(default, int | float) else math.nan


def point_of_record(
    cube: xr.Dataset, row: RecordRow, select: Sequence[str] = (), nearest: bool = False
) -> tuple[xr.Dataset, bool]:
    """The model at the operating point of a record, and whether it was simulated for that."""
    factors, fixed = factors_of(cube), fixed_parameters(cube)
    moved = [
        name
        for name, value in row.values.items()
        if name not in factors and not _equal(fixed.get(name, JOINT_PARAMETERS[name].default), value)
    ]
    own = [f"{name}={value}" for name, value in row.values.items() if name in factors]
    given = {text.partition("=")[0] for text in own}
    try:
        if moved:
            raise InputError(f"the cube has another {moved[0]}")
        rest = [text for text in select if text.partition("=")[0] not in given]
        return model_point(cube, [*own, *rest], nearest and not own).load(), False
    except InputError:
        if not row.values or not str(cube.attrs.get("source", "")).endswith("simulator joint"):
            raise
        known = _parameters(cube, row, select)
        if set(factors) - known.keys() - {"replicate"}:
            raise
        return model_point(simulate(**known)), True


def _parameters(cube: xr.Dataset, row: RecordRow, select: Sequence[str]) -> dict[str, Any]:
    """Parameters of the joint of a record: what its study shares, what was selected, and what the table says."""
    base = dict(parsed_study(str(cube.attrs.get("study", ""))).get("base", {}))
    if base.get("model") == "auto":
        del base["model"]
    chosen: dict[str, Any] = {}
    for text in select:
        name, _, value = text.partition("=")
        if name in JOINT_PARAMETERS:
            chosen[name] = _value(name, value)
    return base | chosen | dict(row.values)


def _equal(known: Any, value: float | str) -> bool:
    if isinstance(known, int | float) and isinstance(value, int | float):
        return math.isclose(known, value, rel_tol=1e-9)
    return bool(known == value)


def _computed_error(cube: xr.Dataset, row: RecordRow, comparison: xr.Dataset, point: xr.Dataset) -> FloatArray:
    """Uncertainty of the computed amplitudes, 95 %: error on record, and what still changes between revolutions."""
    amplitude, scatter = comparison["model_amplitude"].values, model_scatter(point)
    if not str(cube.attrs.get("source", "")).endswith("simulator joint"):
        return np.full(ORDERS.size, np.nan)
    simulator = load_simulator("joint")
    at = {str(name): label.item() for name, label in point.coords.items() if label.ndim == 0}
    known = fixed_parameters(cube) | {name: at[name] for name in at if name in JOINT_PARAMETERS} | dict(row.values)
    if "speed_rpm" not in known:  # over speed: the error hardly depends on it
        known["speed_rpm"] = float(point["speed_rpm"].mean()) if "speed_rpm" in point.coords else 600.0
    values = simulator.effective({name: value for name, value in known.items() if name in JOINT_PARAMETERS})
    parameters = {name: np.array([math.nan if value is None else value]) for name, value in values.items()}
    error = model_error(
        simulator, parameters, ORDERS.tolist(), amplitude[None].astype(complex), scatter[None], "recorded"
    )
    return np.asarray(_NORMAL * error.whole[0], float)


def overview_rows(records: Sequence[ComparedRecord]) -> list[OverviewRow]:
    """A row for each order of each record."""
    return [_row(record, int(order)) for record in records for order in ORDERS.tolist()]


def _row(record: ComparedRecord, order: int) -> OverviewRow:
    if record.comparison is None:
        return OverviewRow(record.name, order, math.nan, math.nan, math.nan, math.nan, NOT_COMPARED)
    own = record.comparison.sel(order=order)
    measured, unsure, computed = (
        float(own[name]) for name in ("measured_amplitude", "measured_amplitude_uncertainty", "model_amplitude")
    )
    error = float(record.computed_error[order])
    if order == 0:  # the preload of the sensor is in it
        return OverviewRow(record.name, order, measured, unsure, computed, error, NOT_COMPARED)
    allowed = math.hypot(unsure, error if math.isfinite(error) else 0.0)
    verdict = AGREES if abs(measured - computed) <= allowed else DIFFERS
    return OverviewRow(record.name, order, measured, unsure, computed, error, verdict)
