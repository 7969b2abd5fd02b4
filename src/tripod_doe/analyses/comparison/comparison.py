"""Comparison of a measured thrust force with a cube: orders, phases, beat, and their uncertainties.

The model is one point of the cube, or its points over speed: then each revolution of a run-up is compared with the
model at its own speed.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.comparison.model_point import (
    common_speeds,
    complex_orders,
    model_orders,
    model_uncertainty,
    model_waveform,
    orders_at_speeds,
    parameters_of,
    refuse_other_units,
)
from tripod_doe.analyses.comparison.plausibility import alignment_doubts, record_doubts
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.errors import InputError, option
from tripod_doe.joint.orders import ORDERS, amplitude_and_phase
from tripod_doe.measurements.measurement import Measurement, read_measurement
from tripod_doe.measurements.order_tracking import CELLS, resample, track_orders
from tripod_doe.number_text import number
from tripod_doe.page_parts.chosen_models import models_used
from tripod_doe.phases import shorter_way
from tripod_doe.study.cube.model_records import MODEL_ERROR
from tripod_doe.typed_numbers import typed_number

_BEAT = (2, 3, 4)  # the third order and its neighbours, whose sum beats once a revolution (paper 3.3)
_DECIMALS = 9  # of an angle in deg; what is smaller is rounding
_NOTHING = 1e-9  # part of the largest amplitude below which a model's order has no phase, and a difference is rounding
NOT_COMPARED = -1
"""The verdict of the mean force, which holds the preload of the sensor."""
NONE_IN_MODEL = -2
"""The verdict of an order that is zero in the model, as its parts are alike, and in the record is not."""
TOO_SMALL = -3
"""The verdict of an order that is smaller than its uncertainties, with which any other small one would agree."""
AGREES, DIFFERS, UNDECIDED = "agrees", "differs", "too small to tell"
VERDICTS = {
    1: AGREES,
    0: DIFFERS,
    NOT_COMPARED: "not compared",
    NONE_IN_MODEL: "none in the model",
    TOO_SMALL: UNDECIDED,
}
"""Verdicts in words: within the uncertainty of measurement and model together, beyond it, or none."""

_LARGEST_ANGLE = 36_000.0  # degrees: a hundred turns; a larger angle has lost its digits, or was none


def parse_speeds(text: str | None) -> tuple[float, float] | None:
    """A range of speeds in rpm from ``LOW:HIGH``; None for no text (InputError if the text has another form)."""
    if text is None:
        return None
    try:
        low, high = map(typed_number, text.split(":"))
    except ValueError as error:
        raise InputError(f"{option('speeds', text)}: write two speeds in rpm, LOW:HIGH") from error
    return low, high


@makes_kind("comparison")
def compare(
    measurement: Measurement | str | Path,
    point: xr.Dataset,
    reference_angle_deg: float | None = None,
    speeds_rpm: tuple[float, float] | None = None,
    confidence: float = 0.95,
) -> xr.Dataset:
    """Compare a measured thrust force with one point of a cube, with the uncertainty of the difference.

    The measured order is the mean of its complex amplitudes C_k over R revolutions. Its uncertainty is t s/sqrt(R)
    with s their deviation along the mean (amplitude) or across it (phase), and t Student's factor with R - 1 degrees
    of freedom. The sampling of a tachometer may shift its edges by up to half a sample, in each revolution alike: with
    a given reference angle, k times this angle is part of the uncertainty of the phase of order k. The uncertainty of
    the model is its error on record, with the difference between its last two revolutions and its numerical error, as
    the root of squares; the difference has both. An order that noise alone would make as large, and that is no larger
    in the model, is uncertain by what noise makes. The beat's envelope is
    |sum of C_k exp(i k phi)| over the orders 2, 3, 4 (paper 3.3).

    Args:
        measurement: Thrust force over the rotation angle, or its file, see `read_measurement`.
        point: One point of a cube, or points over speed, see `model_point`. Over speed, the model's complex amplitudes
            are interpolated to the speed of each revolution, and the uncertainty is of the mean difference.
        reference_angle_deg: Rotation angle phi of the housing (0 with roller 1 between both axes in their plane) at the
            zero of the measurement. If omitted, the measurement is aligned by the phase of its third order; of the
            three possible angles, 120 deg apart, the one with the smallest difference over all orders is used. The
            phases of the other orders are then relative to the third.
        speeds_rpm: Only revolutions with a mean speed in this range are compared; the tracked orders keep all.
        confidence: Level of the uncertainties.

    Returns:
        Over ``order``: measured_amplitude, model_amplitude, amplitude_difference (measured minus model),
        measured_phase_deg, model_phase_deg, phase_difference_deg, their ``_uncertainty`` and ``agrees`` (1 where the
        amplitudes differ by no more than both uncertainties together, 0 where by more, -1 of order 0, -2 where the
        model's is zero, as its trunnions are identical, and the measured one exceeds its own uncertainty, -3 where both
        are below these uncertainties). Over
        ``rotation_deg``: measured_thrust about the mean of the model and without drift (attribute ``preload_n``: what
        was taken off), its deviation measured_thrust_scatter, model_thrust, measured_envelope with its uncertainty,
        model_envelope. Over ``revolution``: the tracked orders, and over speed model_amplitude_at_speed, NaN outside of
        the cube's speeds. The attribute ``model_uncertainty_origin`` says where the model's error comes from (empty
        where none is known), and ``doubts`` holds sentences on units or pulses that are probably wrong, one per line.
        Phases of orders that do not differ significantly from zero are NaN.

    Raises:
        CubeError: If the point is in other units than the joint gives, or states none.
        InputError: If the record is too short or has too many gaps, or fewer than two revolutions have such a speed.
    """
    from scipy.special import stdtrit  # quantiles of Student's t

    if reference_angle_deg is not None and not abs(reference_angle_deg) <= _LARGEST_ANGLE:
        given = option("reference_angle", reference_angle_deg)
        raise InputError(f"{given}: must be a finite angle within {_LARGEST_ANGLE:,.0f} degrees of 0")
    if not isinstance(point, xr.Dataset):
        raise InputError(
            f"point: {type(point).__name__} is no point of a cube; choose one from td.open_cube(DIR) by isel"
        )
    refuse_other_units(point)
    if isinstance(measurement, str | Path):
        measurement = read_measurement(measurement)
    beside = _side_by_side(measurement, point, reference_angle_deg, speeds_rpm)
    factor = float(stdtrit(beside.count - 1, (1 + confidence) / 2)) / np.sqrt(beside.count)
    unsure, turned, origin = model_uncertainty(point, np.abs(beside.model), confidence)
    shared = 0.0 if reference_angle_deg is None else confidence * measurement.angle_error_deg  # of a uniform error
    level, shown = _without_drift(measurement, beside)
    variables = _order_variables(beside, (unsure, turned), factor, shared, confidence)
    variables |= _angle_variables(measurement.rotation_deg + beside.shift, shown, point, beside, factor)
    attrs = _provenance(measurement, point) | {
        "alignment": beside.alignment,
        "shift_deg": beside.shift,
        "preload_n": level,
        "confidence_level": confidence,
        "revolutions_compared": beside.count,
        "model_uncertainty_origin": origin,
        "doubts": "\n".join(
            [
                *record_doubts(measurement, beside.model),
                *alignment_doubts(measurement, beside.each, beside.model, reference_angle_deg),
            ]
        ),
    }
    rotation = ("rotation_deg", np.arange(CELLS, dtype=float), _attrs("degree", "rotation angle of the housing"))
    return beside.tracked.assign(variables).assign_coords(rotation_deg=rotation).assign_attrs(attrs)


@dataclass(frozen=True)
class _Beside:
    """Revolutions of a record next to the model, brought to the same rotation angle."""

    tracked: xr.Dataset  # orders of all revolutions, see `track_orders`
    revolutions: NDArray[np.int32]  # those compared
    each: ComplexArray  # their orders, each changed by what the model says of its speed, shape (revolution, order)
    model: ComplexArray  # shape (order,)
    shift: float  # added to the angle of the record, deg
    alignment: str  # where that comes from, in words

    @property
    def count(self) -> int:
        """Number of the revolutions compared."""
        return len(self.each)

    @property
    def mean(self) -> ComplexArray:
        """Mean orders of the record, shape (order,)."""
        return np.asarray(self.each.mean(axis=0), np.complex128)


def _side_by_side(
    measurement: Measurement, point: xr.Dataset, reference: float | None, speeds: tuple[float, float] | None
) -> _Beside:
    tracked = track_orders(measurement.rotation_deg, measurement.thrust_n, measurement.time_s)
    at_speed = orders_at_speeds(tracked, point)
    if at_speed is not None:
        tracked["model_amplitude_at_speed"] = (
            ("revolution", "order"),
            np.abs(at_speed),
            _attrs("N", "amplitude of the model at the speed of the revolution"),
        )
    chosen = _of_speed(tracked, common_speeds(point, speeds), speeds)
    each = complex_orders(chosen)
    models = None if at_speed is None else at_speed[np.isin(tracked["revolution"], chosen["revolution"])]
    model = model_orders(point) if models is None else models.mean(axis=0)
    shift, alignment = _alignment(each.mean(axis=0), model, reference, measurement.zero)
    each = each * np.exp(-1j * np.radians(shift) * ORDERS)
    if models is not None:  # what speed changes is no scatter
        each = each - models + model
    return _Beside(tracked, chosen["revolution"].values, each, model, shift, alignment)


def _without_drift(measurement: Measurement, beside: _Beside) -> tuple[float, FloatArray]:
    """Offset of a record from the model at its start, N, and the force of the record without offset and drift."""
    drift = float(beside.tracked.attrs["drift_n_per_revolution"])
    turned = (measurement.rotation_deg - measurement.rotation_deg[0]) / 360
    level = float(beside.mean[0].real - beside.model[0].real)
    middle = float(beside.revolutions.mean()) - 0.5
    compared = np.isin(np.floor(turned).astype(int) + 1, beside.revolutions)
    force = np.where(compared, measurement.thrust_n, np.nan)
    return level, np.asarray(force - level - drift * (turned - middle), float)


def _provenance(measurement: Measurement, point: xr.Dataset) -> dict[str, Any]:
    """Attributes that state which measurement was compared with which point."""
    factors = {str(name): label.item() for name, label in point.coords.items() if label.ndim == 0}
    values = parameters_of(point)
    error = float(point[MODEL_ERROR].max()) if MODEL_ERROR in point else math.nan
    return {
        "title": "measured thrust force against a model",
        "measurement": measurement.name or "a measurement",
        "measurement_hash": measurement.digest or "not recorded",
        "study": point.attrs.get("title", "a cube"),
        "study_hash": point.attrs.get("study_hash", "not recorded"),
        "source": point.attrs.get("source", "not recorded"),
        "model": ", ".join(models_used(point)) or str(values.get("model", "not recorded")),
        "columns": measurement.columns,
        "lost_samples": measurement.lost_samples,
        "lost_pulses": measurement.lost_pulses,
        "extra_pulses": measurement.extra_pulses,
        "remarks": "\n".join(measurement.remarks),
        "point": json.dumps(factors),
        "point_units": json.dumps(
            {name: point[name].attrs["units"] for name in factors if "units" in point[name].attrs}
        ),
        **({"model_speed_rpm": values["speed_rpm"]} if "speed_rpm" in values else {}),
        **({"model_error": error} if math.isfinite(error) else {}),
    }


def _of_speed(tracked: xr.Dataset, speeds: tuple[float, float] | None, asked: tuple[float, float] | None) -> xr.Dataset:
    """The revolutions with a requested speed that a point of the model has."""
    if speeds is None:
        return tracked
    if "speed_rpm" not in tracked:
        raise InputError("the speed of the record is not known: add a column time_s to the measurement")
    speed = tracked["speed_rpm"].values
    chosen = tracked.isel(revolution=np.flatnonzero((speed >= speeds[0]) & (speed <= speeds[1])))
    if chosen.sizes["revolution"] < 2:
        if asked is not None and speeds[0] > speeds[1]:
            raise InputError(
                f"{option('speeds', f'{asked[0]:g}:{asked[1]:g}')}: the model has no point at such a speed"
            )
        raise InputError(
            f"speeds from {speeds[0]:g} to {speeds[1]:g} rpm: {chosen.sizes['revolution']} revolutions have such a "
            f"speed, and two are needed; speeds of the record are between {number(float(speed.min()), 4)} and "
            f"{number(float(speed.max()), 4)} rpm"
        )
    return chosen


def _alignment(measured: ComplexArray, model: ComplexArray, reference: float | None, zero: str) -> tuple[float, str]:
    """Angle in deg to add to the measurement's, and in words where it comes from."""
    if reference is not None:
        return reference, f"given: {zero} is at a rotation angle of {reference:g} deg"
    if not (abs(measured[3]) > _NOTHING * np.abs(model).max() and abs(model[3])):
        return 0.0, f"not fitted: no reference angle is given, and {zero} does not follow without a third order"
    third = np.degrees(np.angle(measured[3] / model[3])) / 3
    candidates = [float(shorter_way(third + turn)) for turn in (0, 120, 240)]
    residual = [np.abs(measured * np.exp(-1j * np.radians(shift) * ORDERS) - model).sum() for shift in candidates]
    shift = candidates[int(np.argmin(residual))]
    return shift, (
        f"fitted: no reference angle is given, so {zero} was set to {shift:.4g} deg, where the third orders are in "
        "phase. Of the three such angles, the one with the smallest difference over all orders was used. Phases are "
        "relative to the third order, and the phase of the third order itself is not a result"
    )


def _order_variables(
    beside: _Beside, of_model: tuple[FloatArray, FloatArray], factor: float, angle_error_deg: float, confidence: float
) -> dict[str, Any]:
    """Amplitudes, phases and differences with their uncertainties, over ``order``."""
    each, mean, model = beside.each, beside.mean, beside.model
    model_unsure, turned = of_model
    amplitude, phase = amplitude_and_phase(mean)
    direction = np.exp(-1j * np.radians(phase))
    along, across = (part.std(axis=0, ddof=1) * factor for part in ((each * direction).real, (each * direction).imag))
    model_amplitude, model_phase = amplitude_and_phase(model)
    model_told = model_amplitude > _NOTHING * model_amplitude.max()
    nothing = ~model_told & model_told.any() & (ORDERS > 0) & (amplitude > _NOTHING * model_amplitude.max())
    ways = np.where(nothing, nothing.sum(), 1)  # that none of them is there is one statement
    noise = _largest_of_noise(each, (1 - confidence) / ways)
    drowned = (amplitude <= noise) & (model_amplitude <= amplitude)
    along = np.where(drowned, np.maximum(along, noise), along)
    known = (amplitude > np.hypot(along, across)) | (np.maximum(along, across) == 0)
    known &= amplitude > _NOTHING * amplitude.max()
    sure, both = np.degrees(np.arctan2(across, amplitude)), np.hypot(along, model_unsure)
    sure = np.hypot(sure, ORDERS * angle_error_deg)
    close = np.abs(amplitude - model_amplitude) <= both + _NOTHING * model_amplitude.max()
    agrees = np.where(close & (drowned | ~nothing), 1, np.where(nothing, NONE_IN_MODEL, 0)).astype(np.int8)
    agrees[(agrees == 1) & (np.fmax(amplitude, model_amplitude) <= both)] = TOO_SMALL
    agrees[ORDERS == 0] = NOT_COMPARED
    _, difference = amplitude_and_phase(mean * np.conj(model))
    difference = np.round(difference, _DECIMALS) + 0.0
    difference[~(known & model_told & np.isfinite(turned))] = np.nan  # no difference that model errors may have made
    phase, sure = (np.where(known, np.round(angle, _DECIMALS), np.nan) for angle in (phase, sure))
    rows = {
        "measured_amplitude": (amplitude, "N", "amplitude of the measured mean over revolutions"),
        "measured_amplitude_uncertainty": (along, "N", "its uncertainty from the scatter between revolutions"),
        "model_amplitude": (model_amplitude, "N", "amplitude of the model"),
        "model_amplitude_uncertainty": (model_unsure, "N", "its uncertainty, from errors on record and its own run"),
        "amplitude_difference": (amplitude - model_amplitude, "N", "measured minus model amplitude"),
        "amplitude_difference_uncertainty": (both, "N", "uncertainty of measurement and model together"),
        "measured_phase_deg": (phase, "degree", "phase of the measured mean over revolutions"),
        "measured_phase_uncertainty_deg": (sure, "degree", "its uncertainty from scatter and sampled tachometer edges"),
        "model_phase_deg": (np.where(model_told, model_phase, np.nan), "degree", "phase of the model"),
        "phase_difference_deg": (difference, "degree", "measured minus model phase, -180 to 180"),
        "phase_difference_uncertainty_deg": (
            np.hypot(sure, turned),
            "degree",
            "uncertainty of measurement and model together",
        ),
        "agrees": (
            agrees,
            "1",
            "1: the amplitudes differ by at most both uncertainties together; 0: by more; -1: order 0, not "
            "compared; -2: the model's is zero, and the measured one exceeds its own uncertainty; -3: both are "
            "smaller than these uncertainties",
        ),
    }
    return {name: ("order", values, _attrs(unit, meaning)) for name, (values, unit, meaning) in rows.items()}


def _largest_of_noise(each: ComplexArray, chance: FloatArray) -> FloatArray:
    """Amplitude that the mean of revolutions without this order exceeds with a chance, N, shape (order,).

    Noise alone has an amplitude, which grows as the root of F with 2 and 2 (R - 1) degrees of freedom.
    """
    from scipy.special import fdtri  # quantiles of F

    count = len(each)
    square = (np.abs(each - each.mean(axis=0)) ** 2).sum(axis=0) / (2 * (count - 1))  # of the real part
    return np.asarray(np.sqrt(2 * fdtri(2, 2 * (count - 1), 1 - chance) * square / count), float)


def _angle_variables(
    rotation_deg: FloatArray, thrust_n: FloatArray, point: xr.Dataset, beside: _Beside, factor: float
) -> dict[str, Any]:
    """Waveforms and envelopes over one revolution."""
    each, model = beside.each, beside.model
    wave = np.exp(1j * np.radians(np.arange(CELLS))[:, None] * ORDERS)
    revolutions = resample(rotation_deg, thrust_n)
    count = np.isfinite(revolutions).sum(axis=0)
    mean = np.where(count > 0, np.nansum(revolutions, axis=0) / np.maximum(count, 1), np.nan)
    spread = np.sqrt(np.nansum((revolutions - mean) ** 2, axis=0) / np.maximum(count - 1, 1))
    beats = each[:, list(_BEAT)] @ wave[:, list(_BEAT)].T
    beat = beats.mean(axis=0)
    envelope = np.abs(beat)
    along = (beats * np.conj(beat) / np.maximum(envelope, 1e-300)).real.std(axis=0, ddof=1)
    rows = {
        "measured_thrust": (mean, "measured thrust force about the model's mean, without drift, mean over revolutions"),
        "measured_thrust_scatter": (np.where(count > 1, spread, np.nan), "its standard deviation between revolutions"),
        "model_thrust": (model_waveform(point, model, wave), "thrust force of the model"),
        "measured_envelope": (envelope, "envelope of the measured orders 2, 3 and 4"),
        "measured_envelope_uncertainty": (along * factor, "its uncertainty from the scatter between revolutions"),
        "model_envelope": (np.abs(wave[:, list(_BEAT)] @ model[list(_BEAT)]), "envelope of the model's orders 2 to 4"),
    }
    return {name: ("rotation_deg", values, _attrs("N", meaning)) for name, (values, meaning) in rows.items()}


def _attrs(unit: str, meaning: str) -> dict[str, str]:
    return {"units": unit, "long_name": meaning}
