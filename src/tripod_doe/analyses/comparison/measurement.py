"""A measured thrust force over the rotation angle: read from a file, with the angle from a tachometer where needed.

Columns, recognised by their names or common synonyms (`record_file`); others are ignored:

- ``thrust_n``: thrust force on the housing in N, positive towards the intermediate shaft; empty or NaN at a dropout;
- ``rotation_deg``: rotation angle of the housing in degrees, growing; a jump back by a whole turn is taken as one;
- or ``time_s`` in seconds, growing, and ``tacho`` in any unit: pulses or a square wave, whose rising edges count.

With ``rotation_deg`` a column ``time_s`` is optional: it gives the speeds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tripod_doe.analyses.comparison.record_file import Record, read_record
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError, closest, option

_MOST_LOST = 0.2  # of the samples; with more dropouts a record is refused
_LOW, _HIGH = 0.35, 0.65  # thresholds of an edge within the range of the tachometer: noise between them makes no edge
_NEIGHBOURS = 5  # intervals whose median is the local time between pulses
_LOOSE = 1.5  # times the next interval, from which the first or last one may hide a pulse
_UNEVEN = 0.3  # part of an interval by which it may differ from a whole multiple of its neighbours


@dataclass(frozen=True)
class Measurement:
    """A thrust signal over the rotation angle."""

    rotation_deg: FloatArray  # rotation angle from an arbitrary zero, not falling, unwrapped; degrees, shape (sample,)
    thrust_n: FloatArray  # thrust force in N, NaN at dropouts, shape (sample,)
    time_s: FloatArray | None  # time of the samples in s, shape (sample,); None where it is not known
    zero: str  # what the zero of the angle is, in words
    lost_samples: int = 0  # rows without a value in any needed column
    lost_pulses: int = 0  # missing pulses, inferred from their neighbours and counted
    # name, digest: the file and its SHA-256 (16 hex digits), for the record
    name: str = ""
    digest: str = ""
    # in words, which headings of the file were taken for which columns; empty where they are named as ours
    columns: str = ""
    # largest error of the angle that may be the same in all revolutions, deg
    angle_error_deg: float = 0.0
    # rising edges of the tachometer per revolution that were given; None with an angle of its own
    pulses_per_revolution: int | None = None


def read_measurement(
    path: str | Path, pulses_per_revolution: int = 1, columns: Mapping[str, str] | None = None
) -> Measurement:
    """Read a measured thrust signal and put it over the rotation angle.

    Args:
        path: Text file with one line of column names; lines that start with # are ignored.
        pulses_per_revolution: Rising edges of the tachometer per revolution of the housing.
        columns: Headings of the file by our names of the columns, where they are not known.

    Returns:
        Measurement

    Raises:
        InputError: If the file cannot be read, a column is missing or holds words, too many values are missing, time or
            angle runs backwards, or the tachometer shows no regular pulses. The message says what to change.
    """
    path = Path(path)
    try:
        record = read_record(path, columns)
        measured = _from_record(record, pulses_per_revolution)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        return replace(measured, columns=record.taken, name=path.name, digest=digest)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _from_record(record: Record, pulses: int) -> Measurement:
    over_angle = "rotation_deg" in record.columns or not {"time_s", "tacho"} & record.columns.keys()
    needed = ["thrust_n", "rotation_deg"] if over_angle else ["thrust_n", "time_s", "tacho"]
    for name in needed:
        if name not in record.columns:
            raise InputError(
                f"no column {name}{closest(name, record.headings)}; needed are thrust_n and rotation_deg, or thrust_n, "
                f"time_s and tacho; the file has {', '.join(record.headings)}; {option('column', f'{name}=HEADING')} "
                "names another one"
            )
    axes = [*needed[1:], *(["time_s"] if over_angle and "time_s" in record.columns else [])]
    columns = {name: record.columns[name] for name in ["thrust_n", *axes]}
    placed = np.logical_and.reduce([np.isfinite(columns[name]) for name in axes])
    lost = int(np.sum(~(placed & np.isfinite(columns["thrust_n"]))))
    if lost > _MOST_LOST * placed.size:
        raise InputError(
            f"{lost} of {placed.size} samples have no number in {', '.join(columns)}; at most {_MOST_LOST:.0%} may be "
            "missing: cut the record to its good part"
        )
    kept = {name: values[placed] for name, values in columns.items()}
    if "time_s" in kept:
        _check_growing("time_s", kept["time_s"], np.flatnonzero(placed), strictly=True)
    if not over_angle:
        return rotation_from_tachometer(kept["time_s"], kept["tacho"], kept["thrust_n"], pulses, lost)
    rotation = _unwrapped(kept["rotation_deg"])
    _check_growing("rotation_deg", rotation, np.flatnonzero(placed), strictly=False)
    return Measurement(rotation, kept["thrust_n"], kept.get("time_s"), "the zero of rotation_deg", lost)


def _unwrapped(degrees: FloatArray) -> FloatArray:
    """An angle that starts again after each turn, made to run on; other steps backwards stay to be refused."""
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
    time_s: FloatArray, tacho: FloatArray, thrust_n: FloatArray, pulses_per_revolution: int = 1, lost_samples: int = 0
) -> Measurement:
    """The rotation angle of every sample between the first and the last rising edge of a tachometer.

    A cubic spline runs through the instants of the edges, at 360/n deg each: constant acceleration is followed
    exactly, ripple within the time between two pulses is not seen. The zero is at the first edge. Computed order
    tracking after Fyfe and Munck, Mechanical Systems and Signal Processing 11 (1997) 187-205.

    Args:
        time_s, tacho, thrust_n: Time in s, tachometer in any unit, thrust force in N; shape (sample,) each.
        lost_samples: Rows that were left out before, for the record.

    An edge of a sampled square wave is known to half a sample. With N samples a revolution that is an angle error
    of at most 180/N deg, and of at most k 180/N deg in the phase of order k.

    Raises:
        InputError: If there are no pulses, too few, or irregular ones.
    """
    from scipy.interpolate import CubicSpline

    if pulses_per_revolution < 1:
        raise InputError(f"{option('pulses_per_revolution', pulses_per_revolution)}: at least 1 is needed")
    edges = _without_loose_ends(edge_times(time_s, tacho))
    if edges.size < 2:
        raise InputError(
            f"{edges.size or 'no'} rising edge{'s' if edges.size != 1 else ''} in tacho; give a pulse or square wave "
            "with at least one rising edge per revolution, or a column rotation_deg"
        )
    numbers = pulse_numbers(edges)
    between = (time_s >= edges[0]) & (time_s <= edges[-1])
    angle: Callable[[FloatArray], FloatArray] = CubicSpline(edges, numbers * (360.0 / pulses_per_revolution))
    rotation = angle(time_s[between])
    if np.any(np.diff(rotation) < 0):
        raise InputError(
            "the angle between tachometer pulses runs backwards; the record needs more pulses per revolution"
        )
    lost_pulses = int(numbers[-1]) + 1 - edges.size
    zero = "the first rising edge of tacho"
    return Measurement(
        rotation,
        thrust_n[between],
        time_s[between],
        zero,
        lost_samples,
        lost_pulses,
        angle_error_deg=float(np.median(np.diff(rotation))) / 2,
        pulses_per_revolution=pulses_per_revolution,
    )


def edge_times(time_s: FloatArray, tacho: FloatArray) -> FloatArray:
    """Instants in s at which a pulse train or square wave rises through the middle of its range.

    A rise counts when it goes from below 35 % to above 65 % of the range, so that noise up to 15 % makes no edge.

    Args:
        time_s, tacho: Time in s and tachometer in any unit, shape (sample,).

    Returns:
        ndarray, shape (edge,)
    """
    low, high = (float(end) for end in (np.min(tacho), np.max(tacho))) if tacho.size else (0.0, 0.0)
    state = np.where(tacho > low + _HIGH * (high - low), 1, 0) - np.where(tacho < low + _LOW * (high - low), 1, 0)
    decided = np.flatnonzero(state)
    rising = np.flatnonzero(np.diff(state[decided]) > 0)
    before, after = decided[rising], decided[rising + 1]
    part = ((low + high) / 2 - tacho[before]) / (tacho[after] - tacho[before])
    return np.asarray(time_s[before] + part * (time_s[after] - time_s[before]), float)


def _without_loose_ends(edges: FloatArray) -> FloatArray:
    """Edges without a first or last interval much longer than the next one.

    At the ends of a record a missing pulse and a start from rest look alike, so neither is counted.
    """
    while edges.size > 3 and edges[1] - edges[0] > _LOOSE * (edges[2] - edges[1]):
        edges = edges[1:]
    while edges.size > 3 and edges[-1] - edges[-2] > _LOOSE * (edges[-2] - edges[-3]):
        edges = edges[:-1]
    return edges


def pulse_numbers(edges: FloatArray) -> IntArray:
    """Number each edge of a tachometer, the first 0; a gap of a whole number of pulses counts those that are missing.

    Args:
        edges: Instants in s, shape (edge,).

    Raises:
        InputError: If an interval is no whole multiple of the median of its neighbours, within 30 % of one.
    """
    from scipy.ndimage import median_filter

    interval = np.diff(edges)
    ratio = interval / median_filter(interval, size=_NEIGHBOURS, mode="nearest")
    count = np.rint(ratio).astype(np.int64)
    uneven = np.flatnonzero((count < 1) | (np.abs(ratio - count) > _UNEVEN))
    if uneven.size:
        at = uneven[0]
        raise InputError(
            f"the pulses of tacho are irregular: {interval[at]:.4g} s between those at {edges[at]:.6g} s and "
            f"{edges[at + 1]:.6g} s, where their neighbours are {interval[at] / ratio[at]:.4g} s apart; clean the "
            "tachometer signal or cut the record there"
        )
    return np.concatenate([[0], np.cumsum(count)])
