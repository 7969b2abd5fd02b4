"""Records of a rig as a fit takes them: orders of each revolution, and what is known of the joint in each record."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from tripod_doe.analyses.comparison.model_point import complex_orders
from tripod_doe.analyses.comparison.plausibility import doubts_of_record
from tripod_doe.analyses.fit.estimation.misfit import Rows
from tripod_doe.analyses.fit.fit_file import FitRequest
from tripod_doe.analyses.fit.model_error import ModelError
from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.errors import InputError, speaking_of_keys
from tripod_doe.measurements.measurement import Measurement, read_measurement
from tripod_doe.measurements.operating_point import differ
from tripod_doe.measurements.order_tracking import track_orders
from tripod_doe.measurements.record_table import read_record_table
from tripod_doe.model_interface import Parameter, Value
from tripod_doe.number_text import number
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.typed_numbers import typed_number

_ANGLE, _TORQUE, _SPEED = "joint_angle_deg", "torque_n_m", "speed_rpm"
_FLOOR = 3e-4  # of the largest fitted order: no chain of measurement is better, whatever its revolutions say
_PRIOR = 8  # degrees of freedom for which the usual scatter of all records counts in each of them
_FEW_RECORDS = 2  # up to which these have no usual scatter
_MOST_RECORDS = 10_000  # rows of a table of records
_FEW_FREEDOM = 2.5  # fewest degrees of freedom of a scatter for what chance makes of it
_ROUNDING = 1e-12  # of the largest thrust of a record: smaller orders are rounding
_OWN: dict[str, tuple[str, Callable[[float], bool]]] = {
    "reference_angle_deg": ("a finite number", math.isfinite),
    "pulses_per_revolution": ("a whole number from 1 on", lambda value: value >= 1 and value.is_integer()),
    "sign": ("1, -1 or free", lambda value: abs(value) == 1),
}
"""Keys of [records] that a column of the table may give for each record, with what their numbers must be."""


@dataclass(frozen=True)
class RigRecord:
    """One record."""

    name: str  # of its file
    orders: ComplexArray  # complex amplitudes of each revolution, shape (revolution, order)
    angle_error_deg: float  # error of the angle that all revolutions may share
    parameters: Mapping[str, Value]  # values of the joint that differ between records
    labels: Mapping[str, str]  # other columns of the table, as text
    reference_angle_deg: float | None  # None where the record is aligned by an order
    sign: float | None  # of the force; None where it is not known
    own_sign: bool = False  # whether the table gives the sign of this record
    remarks: tuple[str, ...] = ()  # sentences on what was assumed when it was read
    doubts: tuple[str, ...] = ()  # sentences on what is probably wrong with it
    digest: str = ""  # of its file


@dataclass(frozen=True)
class _Asked:
    """A row of the table of records."""

    path: Path
    parameters: Mapping[str, Value]
    labels: Mapping[str, str]
    own: Mapping[str, Any]


def read_records(request: FitRequest, parameters: Mapping[str, Parameter]) -> list[RigRecord]:
    """Read all records of a fit.

    Raises:
        InputError: For every file that cannot be read or used, for files with the same content, and for a table that
            names what is not known.
    """
    asked = list(_listed(request, parameters))
    records, wrong, seen = list[RigRecord](), list[str](), dict[str, Path]()
    with speaking_of_keys():
        for row in asked:
            try:
                records.append(_read(request, row, parameters))
                if (same := seen.setdefault(records[-1].digest, row.path)) is not row.path:
                    wrong.append(f"{row.path}: the same record as {same}, which would count twice; remove one of them")
            except InputError as error:
                wrong.append(str(error))
    wrong += _unknown_values(request, records)
    if wrong:
        raise request.fail("[records]", "\n".join(wrong))
    return records


def _unknown_values(request: FitRequest, records: Sequence[RigRecord]) -> list[str]:
    """A complaint for each value that some records have and a record lacks: no other record says what it is there."""
    named = dict.fromkeys(name for record in records for name in record.parameters)
    return [
        f"{record.name}: its {name} is not known, but other records have one: give it for all in the table of "
        "records, or for none"
        for record in records
        for name in named
        if name not in record.parameters and name not in request.file.base
    ]


def _listed(request: FitRequest, parameters: Mapping[str, Parameter]) -> Iterator[_Asked]:
    table = request.file.records
    if table.table is not None:
        yield from _rows_of_table(request, parameters)
        return
    paths: dict[Path, None] = {}
    for pattern in table.files:
        if set(pattern) & set("*?["):
            files = _matching(request.folder, pattern)
            if not files:
                raise request.fail("[records]", f"files = {pattern!r}: no file has such a name")
            paths |= dict.fromkeys(files)
        else:
            paths[request.folder.file(pattern, "files")] = None
    yield from (_Asked(path, {}, {}, {}) for path in paths)


def _matching(folder: StudyFolder, pattern: str) -> list[Path]:
    """Files of a pattern; in a folder from a stranger those that lie in it."""
    if folder.trusted:
        return sorted(folder.path.glob(pattern))
    if Path(pattern).name != pattern:
        return []
    return [folder.file(path.name, "files") for path in sorted(folder.path.glob(pattern)) if path.is_file()]


def _rows_of_table(request: FitRequest, parameters: Mapping[str, Parameter]) -> Iterator[_Asked]:
    name = str(request.file.records.table)
    where = f"[records]: table = {name!r}"
    path = request.folder.file(name, "table")
    header, rows = read_record_table(path, f"{request.origin}: {where}", parameters, _MOST_RECORDS)
    for column in header:
        if column in request.file.base:
            raise request.fail(where, f"{column} is also a base value; remove it from [base]")
        if column in request.file.unknowns:
            raise request.fail(where, f"{column} is also an unknown; remove one of them")
    for line, cells in rows.items():
        try:
            path = _record_path(request, name, cells.pop("file"))
            own = {key: _value_of_key(key, cells.pop(key)) for key in _OWN if cells.get(key)}
            typed = {key: parameters[key].typed(text) for key, text in cells.items() if text and key in parameters}
            known = {key: parameters[key].check(value) for key, value in typed.items()}
        except InputError as error:
            raise request.fail(where, error.at(f"line {line}")) from error
        labels = {key: text for key, text in cells.items() if key not in parameters and key not in _OWN}
        yield _Asked(path, known, labels, own)


def _record_path(request: FitRequest, table: str, name: str) -> Path:
    """The path of a record that a table names: next to the table, else next to the fit file."""
    near = Path(table).parent / name
    if (request.folder.path / near).is_file():
        return request.folder.file(near.as_posix(), "file")
    return request.folder.file(name, "file")


def _value_of_key(key: str, text: str) -> Any:
    """A value of [records] in a field of the table; spreadsheets and pandas write 1.0 for 1 next to empty fields."""
    if (key, text) == ("sign", "free"):
        return text
    try:
        value = typed_number(text)
    except ValueError:
        value = math.nan
    wanted, is_right = _OWN[key]
    if not is_right(value):
        raise InputError(f"{key} = {text!r}: must be {wanted}")
    return value if key == "reference_angle_deg" else int(value)


def _read(request: FitRequest, asked: _Asked, parameters: Mapping[str, Parameter]) -> RigRecord:
    """One record: its file, over revolutions."""
    table = request.file.records
    settings = {key: getattr(table, key) for key in _OWN} | dict(asked.own)
    speed = {**request.file.base, **asked.parameters}.get(_SPEED)
    measured = read_measurement(
        asked.path,
        settings["pulses_per_revolution"],
        table.columns,
        table.pattern,
        float(speed) if isinstance(speed, int | float) else None,
    )
    try:
        tracked = track_orders(measured.rotation_deg, measured.thrust_n, measured.time_s)
        fitted = tracked["thrust_amplitude"].sel(order=request.file.orders)
        if fitted.max() <= _ROUNDING * np.nanmax(np.abs(measured.thrust_n)):
            orders = ", ".join(map(str, request.file.orders))
            raise InputError(f"its thrust has none of the fitted orders ({orders}): nothing can be fitted to it")
        own = _stated(request, asked, measured, parameters)
    except InputError as error:
        raise InputError(f"{asked.path}: {error}") from error
    if _SPEED not in {*asked.parameters, *request.file.base, *request.file.unknowns}:
        if _SPEED in tracked:
            own[_SPEED] = float(tracked[_SPEED].mean())
        elif _SPEED not in own:
            raise InputError(
                f"{asked.path}: its speed is not known: give speed_rpm in [base] or in the table of records, or a "
                "column time_s"
            )
    sign, each = settings["sign"], complex_orders(tracked)
    return RigRecord(
        name=asked.path.name,
        orders=each,
        angle_error_deg=measured.angle_error_deg,
        parameters=own,
        labels=asked.labels,
        reference_angle_deg=settings["reference_angle_deg"],
        sign=None if sign == "free" else float(sign),
        own_sign="sign" in asked.own,
        remarks=(*measured.remarks, *_overruled(asked, measured)),
        doubts=tuple(doubts_of_record(measured, each)),
        digest=measured.digest,
    )


def _stated(
    request: FitRequest, asked: _Asked, measured: Measurement, parameters: Mapping[str, Parameter]
) -> dict[str, Value]:
    """Parameters of a record: those of the table, else what the record states beyond base values and unknowns."""
    own = dict(asked.parameters)
    for name, value in measured.operating.items():
        if name in own or name in request.file.unknowns:
            continue
        known = request.file.base.get(name)
        if known is None:
            own[name] = parameters[name].check(value)
        elif isinstance(known, int | float) and differ(known, value):
            raise InputError(
                f"it states {name} = {number(value)}, [base] {known:g}; remove {name} from [base], and give it in a "
                "table for records that do not state it"
            )
    for name in (_ANGLE, _TORQUE):
        if name not in {*own, *request.file.base, *request.file.unknowns}:
            raise InputError(
                f"its {name} is not known: give it in [base], in the table of records, in the first lines or a column "
                'of the file, or in its name with pattern = "NAME" in [records]'
            )
    return own


def _overruled(asked: _Asked, measured: Measurement) -> list[str]:
    """Values that a record states where the table of records has another one, a sentence each."""
    return [
        f"It states {name} = {number(stated)}, but {number(value)} of the table of records is used."
        for name, stated in measured.operating.items()
        if isinstance(value := asked.parameters.get(name), int | float) and differ(value, stated)
    ]


@dataclass(frozen=True)
class MeasuredOrders:
    """Mean orders of a record with their scatter."""

    mean: ComplexArray  # shape (order,)
    variance: FloatArray  # of the mean, along itself and at right angles to it, from the revolutions, shape (2, order)
    freedom: int  # degrees of freedom of the variance
    edge: FloatArray  # deviation at right angles that all revolutions share, as the marker is a sampled edge, (order,)


def measured_orders(record: RigRecord, orders: Sequence[int]) -> MeasuredOrders:
    """Mean orders of a record, turned to its reference angle, and their scatter between revolutions."""
    each = record.orders[:, list(orders)] * (record.sign or 1.0)
    reference = record.reference_angle_deg
    each = each * np.exp(-1j * np.radians(reference or 0.0) * np.array(orders))
    mean, count = each.mean(axis=0), each.shape[0]
    turned = each * np.exp(-1j * np.angle(mean))
    variance = np.array([part.var(axis=0, ddof=1) / count for part in (turned.real, turned.imag)])
    edge = np.zeros(len(orders))
    if reference is not None:  # half a sample at most
        edge = np.array(orders) * np.radians(record.angle_error_deg) / np.sqrt(3) * np.abs(mean)
    return MeasuredOrders(mean, variance, count - 1, edge)


def deviations(parts: Sequence[MeasuredOrders]) -> FloatArray:
    """Standard deviations of the mean orders, along and across, shape (record, 2, order).

    A scatter from few revolutions is itself a matter of chance. So the usual scatter of all records, relative to the
    largest order of each, counts in each record as if it came from eight more revolutions (Smyth 2004), and the rest of
    chance widens it as Student's distribution is wider than the normal one. One or two records say nothing of what is
    usual: there no order scatters less than the orders of its record usually do.
    """
    size = np.array([np.abs(part.mean).max() for part in parts])[:, None, None]
    own = np.array([part.variance for part in parts])
    revolutions = np.array([part.freedom for part in parts], float)[:, None, None]
    each = own * revolutions / chi2.median(revolutions)
    if len(parts) > _FEW_RECORDS:
        usual = np.median(each / size**2 * (revolutions + 1), axis=0) * size**2 / (revolutions + 1)
        variance = _widened((revolutions * own + _PRIOR * usual) / (revolutions + _PRIOR), revolutions + _PRIOR)
    else:
        usual = np.median(each, axis=(1, 2), keepdims=True)
        pooled = revolutions * own[0].size
        variance = np.maximum(_widened(own, revolutions), _widened(usual, pooled))
    variance += (_FLOOR * size) ** 2
    variance[:, 1] += np.array([part.edge for part in parts]) ** 2
    return np.asarray(np.sqrt(variance), float)


def _widened(variance: FloatArray, freedom: FloatArray) -> FloatArray:
    """Variance of Student's distribution from one with these degrees of freedom."""
    freedom = np.maximum(freedom, _FEW_FREEDOM)
    return np.asarray(variance * freedom / (freedom - 2), float)


def make_rows(records: Sequence[RigRecord], orders: Sequence[int], error: ModelError, scale_error: float) -> Rows:
    """All fitted orders of all records as rows, record by record.

    Args:
        records, orders: The records, and the orders of each that are fitted.
        error: The errors of the model at the records.
        scale_error: Relative deviation of the force sensor's scale.
    """
    parts = [measured_orders(record, orders) for record in records]
    count, deviation = len(records), deviations(parts)
    return Rows(
        record=np.repeat(np.arange(count), len(orders)),
        order=np.tile(np.array(orders, np.int64), count),
        measured=np.concatenate([part.mean for part in parts]),
        along=deviation[:, 0].ravel(),
        across=deviation[:, 1].ravel(),
        own_error=error.own.reshape(2, -1),
        shared=error.shared.reshape(count * len(orders), -1),
        turning=error.turning.reshape(count * len(orders), -1),
        free_phase=np.array([record.reference_angle_deg is None for record in records]),
        free_sign=np.array([record.sign is None for record in records]),
        scale_error=scale_error,
        one_sign=not any(record.sign is None and record.own_sign for record in records),
    )
