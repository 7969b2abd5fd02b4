"""A measured thrust force over the rotation angle: read from a file, with the angle from a tachometer if needed.

Columns, recognised by their names in several languages (`headings`); others are ignored:

- ``thrust_n``: thrust force on the housing in N, positive towards the intermediate shaft; empty or NaN at a dropout;
- ``rotation_deg``: rotation angle of the housing in degrees, increasing; a jump back by a turn means the next turn;
- or ``time_s`` in seconds, increasing, and ``tacho`` in any unit: pulses or a square wave, whose rising edges count.

With ``rotation_deg``, a column ``time_s`` is optional: it gives the speeds. Joint angle, torque and speed of the record
come from its notes, its columns or its file name (`operating_point`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError, closest, option
from tripod_doe.files.regular_files import read_regular
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.operating_point import differ, from_columns, from_name, from_notes
from tripod_doe.measurements.record_file import Record, read_record
from tripod_doe.measurements.tachometer import angle_between_pulses, find_pulses, infer_pulses
from tripod_doe.number_text import number

_MOST_LOST = 0.2  # part of the samples; a record with more dropouts is refused
_LARGEST_THRUST = 1e9  # N: a wrong column or unit; squares of larger numbers overflow in fits
_LATEST = 4e9  # s since 1970, in 2096: a larger time is in another unit
_ZERO = 0.2  # degrees or N m: the zero of a sensor may be off by as much


@dataclass(frozen=True)
class Measurement:
    """A thrust signal over the rotation angle."""

    rotation_deg: FloatArray  # rotation angle from an arbitrary zero, not falling, unwrapped; degrees, shape (sample,)
    thrust_n: FloatArray  # thrust force in N, NaN at dropouts, shape (sample,)
    time_s: FloatArray | None  # time of the samples in s, shape (sample,); None if unknown
    zero: str  # the zero of the angle, in words
    lost_samples: int = 0  # rows without a value in any needed column
    lost_pulses: int = 0  # missing pulses, inferred from their neighbours and counted
    extra_pulses: int = 0  # edges that are not pulses: bounces and spikes
    # name, digest: the file and its SHA-256 (16 hex digits), for the record
    name: str = ""
    digest: str = ""
    # in words, the column assigned to each heading; empty if the file uses our names
    columns: str = ""
    # largest angle error that may repeat in all revolutions, deg
    angle_error_deg: float = 0.0
    # rising edges of the tachometer per revolution, given or assumed; None if the record has an angle
    pulses_per_revolution: int | None = None
    # joint angle, torque and speed as the record states them, by parameter
    operating: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()  # sentences on assumptions


def read_measurement(
    path: str | Path,
    pulses_per_revolution: int | None = None,
    columns: Mapping[str, str] | None = None,
    pattern: str | None = None,
    speed_rpm: float | None = None,
    sign: float = 1.0,
) -> Measurement:
    """Read a measured thrust signal and put it over the rotation angle.

    Args:
        path: Table with headings, see `read_record`.
        pulses_per_revolution: Rising edges of the tachometer per revolution of the housing; they are inferred if
            omitted, and the remarks say so.
        columns: Headings of the file by our names of the columns, for headings that are not recognised.
        pattern: Name of the file with fields for parameters, see `operating_point.from_name`.
        speed_rpm: Speed, if known from another source; it gives the pulses per revolution.
        sign: -1 if the force of the record is positive away from the intermediate shaft.

    Returns:
        Measurement

    Raises:
        InputError: If the file cannot be read, a column is missing or holds words, too many values are missing, time or
            angle runs backwards, or the tachometer shows no regular pulses. The message says what to change.
    """
    path = Path(path)
    stated = {} if pattern is None else from_name(path.name, pattern)
    try:
        record = read_record(path, columns)
        operating, lines, remarks = _operating(record, stated)
        measured = _from_record(record, pulses_per_revolution, speed_rpm or operating.get("speed_rpm"))
        digest = hashlib.sha256(read_regular(path, links=True)).hexdigest()[:16]
        return replace(
            measured,
            thrust_n=sign * measured.thrust_n,
            columns=", ".join(filter(None, [record.taken, *lines])),
            remarks=(*measured.remarks, *record.remarks, *remarks),
            name=path.name,
            digest=digest,
            operating=operating,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _operating(record: Record, stated: Mapping[str, float]) -> tuple[dict[str, float], list[str], list[str]]:
    """The operating point that a record states: the file name has priority over notes, notes over columns.

    Returns:
        The values; the lines that they are from, and remarks on lines that are not used.
    """
    columns, notes = from_columns(record.columns), from_notes(record.notes)
    sure = {name: statement.value for name, statement in notes.items() if not statement.trouble}
    for name, value in sure.items():
        if name in stated:
            other, place, small = stated[name], "the name of the file", 0.0
        elif name in columns and name != "speed_rpm":  # a run-up states its highest speed, perhaps
            other, place, small = columns[name], "its column", _ZERO
        else:
            continue
        if differ(other, value, small):
            raise InputError(f"{name} is {number(other)} by {place} and {number(value)} by its first lines")
    lines = [f"{name} = {number(sure[name], 6)} from {notes[name].line!r}" for name in sure if name not in stated]
    remarks = [
        f"The line {statement.line!r} of the record is not used for {name}: {statement.trouble}; state the value in "
        f"a table of records or in the name of the file ({option('pattern')})."
        for name, statement in notes.items()
        if statement.trouble and name not in stated
    ]
    return {**columns, **sure, **stated}, lines, remarks


def _from_record(record: Record, pulses: int | None, speed_rpm: float | None) -> Measurement:
    columns = record.columns
    over_angle = "rotation_deg" in columns or not {"time_s", "tacho"} & columns.keys()
    needed = ["thrust_n", "rotation_deg"] if over_angle else ["thrust_n", "time_s", "tacho"]
    for name in needed:
        if name not in columns:
            raise InputError(
                f"no column {name}{closest(name, record.headings)}; needed are thrust_n and rotation_deg, or thrust_n, "
                f"time_s and tacho; the file has {', '.join(record.headings)}; {option('column', f'{name}=HEADING')} "
                "names another one"
            )
    axes = [*needed[1:], *(["time_s"] if over_angle and "time_s" in columns else [])]
    columns = {name: columns[name] for name in ["thrust_n", *axes]}
    placed = np.logical_and.reduce([np.isfinite(columns[name]) for name in axes])
    lost = int(np.sum(~(placed & np.isfinite(columns["thrust_n"]))))
    if lost > _MOST_LOST * placed.size:
        raise InputError(
            f"{lost} of {placed.size} samples have no number in {', '.join(columns)}; at most {_MOST_LOST:.0%} may be "
            "missing: cut the record to its good part"
        )
    largest = np.nanmax(np.abs(columns["thrust_n"]), initial=0.0)
    if largest > _LARGEST_THRUST:
        raise InputError(
            f"thrust_n reaches {largest:.3g} N, at most {_LARGEST_THRUST:g} N are read: check this column and its unit"
        )
    kept = {name: values[placed] for name, values in columns.items()}
    rows, remarks = np.flatnonzero(placed), list[str]()
    if "time_s" in kept:
        if (even := _evenly_sampled(kept["time_s"], rows)) is not None:
            rate = (rows[-1] - rows[0]) / (even[-1] - even[0])
            remarks.append(f"Times of the record repeat, as they are rounded: taken as sampled at {rate:,.4g} Hz.")
            kept["time_s"] = even
        _check_growing("time_s", kept["time_s"], rows, strictly=True)
        if kept["time_s"].max(initial=0.0) > _LATEST:
            raise InputError(
                f"time_s reaches {kept['time_s'].max():.4g} s, later than 2096 where it counts from 1970: "
                f"{option('column', 'time_s=HEADING [UNIT]')} gives its unit, such as ms, us or ns"
            )
    if over_angle:
        rotation = _unwrapped(kept["rotation_deg"])
        _check_growing("rotation_deg", rotation, rows, strictly=False)
        read = Measurement(rotation, kept["thrust_n"], kept.get("time_s"), "the zero of rotation_deg", lost)
    else:
        read = rotation_from_tachometer(kept["time_s"], kept["tacho"], kept["thrust_n"], pulses, lost, speed_rpm)
    _refuse_fast(read)
    return replace(read, remarks=(*remarks, *read.remarks))


def _refuse_fast(read: Measurement) -> None:
    """Refuse a record that turns faster than any joint, as where its times are in days."""
    if read.time_s is None or read.time_s.size < 2:
        return
    speed = float(np.ptp(read.rotation_deg) / np.ptp(read.time_s) / 6)
    if speed > JOINT_PARAMETERS["speed_rpm"].high:
        raise InputError(
            f"the record turns at {speed:.3g} rpm by its times, at most {JOINT_PARAMETERS['speed_rpm'].high:g} rpm are "
            f"read: {option('column', 'time_s=HEADING [UNIT]')} gives the unit of the times, "
            f"{option('pulses_per_revolution')} the pulses of the tachometer"
        )


def _evenly_sampled(time_s: FloatArray, rows: IntArray) -> FloatArray | None:
    """Even times in place of rounded ones that repeat; None if none repeat, or if they are no rounded even times."""
    step = np.diff(time_s)
    if not (step == 0).any() or (step < 0).any() or not step.any():
        return None
    slope, start = np.polyfit(rows, time_s, 1)
    even = start + slope * rows
    return even if np.abs(time_s - even).max() <= step[step > 0].min() else None


def _unwrapped(degrees: FloatArray) -> FloatArray:
    """Unwrap an angle that starts again after each turn; keeps other backward steps, which are refused later."""
    turns = np.cumsum(np.diff(degrees, prepend=degrees[:1]) < -180)
    return degrees + 360.0 * turns


def _check_growing(name: str, values: FloatArray, rows: IntArray, strictly: bool) -> None:
    step = np.diff(values)
    wrong = np.flatnonzero(step <= 0 if strictly else step < 0)
    if wrong.size == 0:
        return
    at = wrong[0]
    hint = (
        "sort the rows by time" if name == "time_s" else "change the sign of the column if the joint turned backwards"
    )
    raise InputError(
        f"{name} must grow from row to row, but goes from {values[at]:g} to {values[at + 1]:g} at row "
        f"{rows[at + 1] + 1} ({wrong.size} such rows); {hint}"
    )


def rotation_from_tachometer(
    time_s: FloatArray,
    tacho: FloatArray,
    thrust_n: FloatArray,
    pulses_per_revolution: int | None = None,
    lost_samples: int = 0,
    speed_rpm: float | None = None,
) -> Measurement:
    """The rotation angle of every sample between the first and the last rising edge of a tachometer.

    The zero is at the first edge. An edge of a sampled square wave is known to half a sample. With N samples a
    revolution that is an angle error of at most 180/N deg, and of at most k 180/N deg in the phase of order k.

    Args:
        time_s, tacho, thrust_n: Time in s, tachometer in any unit, thrust force in N; shape (sample,) each.
        pulses_per_revolution: Rising edges per revolution; inferred if omitted.
        lost_samples: Rows left out before; stored in the result.
        speed_rpm: Speed, if known.

    Raises:
        InputError: If there are no pulses, too few pulses, or irregular pulses that cannot be repaired.
    """
    if pulses_per_revolution is not None and pulses_per_revolution < 1:
        raise InputError(f"{option('pulses_per_revolution', pulses_per_revolution)}: at least 1 is needed")
    pulses = find_pulses(time_s, tacho)
    between = (time_s >= pulses.times[0]) & (time_s <= pulses.times[-1])
    time, thrust, said = time_s[between], thrust_n[between], ""
    if pulses_per_revolution is None:
        pulses_per_revolution, said = infer_pulses(pulses, time, thrust, speed_rpm)
    rotation = angle_between_pulses(pulses, time, pulses_per_revolution)
    return Measurement(
        rotation,
        thrust,
        time,
        "the first rising edge of tacho",
        lost_samples,
        pulses.lost,
        pulses.extra,
        angle_error_deg=float(np.median(np.diff(rotation))) / 2,
        pulses_per_revolution=pulses_per_revolution,
        remarks=(said,) if said else (),
    )
