"""What is probably wrong where a record and a model hardly agree: pulses, units, sign of the force, eccentric encoder.

Such a mistake gives a smooth answer: amplitudes and phases of the wrong orders, or a force of another unit.
"""

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import ComplexArray
from tripod_doe.errors import option
from tripod_doe.measurements.measurement import Measurement
from tripod_doe.measurements.spectrum import FEWEST_CYCLES, cycle_amplitudes, longest_stop
from tripod_doe.number_text import count_of, number

_WEAK = 0.3  # part of the strongest oscillation below which the model's strongest order is missing from the record
_DEAD = 1e-6  # part of the model's strongest order below which a record does not oscillate
_NEAR = 0.04  # relative: how near a ratio must be to the one that explains it
_REVERSED = 0.6  # part of the difference that is left with the sign of the force reversed, below which it is doubted
_OPPOSITE = 30.0  # deg: how near half a turn the phase of the third order is where sign or reference angle is doubted
_SIDEBAND = 0.02  # part of the largest order by which an eccentric encoder may falsify another without a word
_STUCK = 180.0  # deg: a force that oscillates once per revolution or more does not stay so long the same
_THOUSAND = (300.0, 3000.0)  # a measurement and a model of the same joint differ by less


def record_doubts(measurement: Measurement, model: ComplexArray) -> list[str]:
    """Sentences on what does not fit, none where nothing is noticed.

    Args:
        measurement: Thrust force over the rotation angle.
        model: Complex amplitudes of the model's orders 0 to 12.
    """
    order = 1 + int(np.argmax(np.abs(model[1:])))
    expected = float(np.abs(model[order]))
    orders, amplitude = cycle_amplitudes(measurement.rotation_deg, measurement.thrust_n)
    if not expected or not amplitude.size:
        return []
    if not amplitude.max() > _DEAD * expected:
        level = float(np.nanmean(measurement.thrust_n))
        return [f"Check the force: the record stays at {number(level)} N, as a channel without a signal does."]
    at = int(np.argmax(amplitude))
    strongest, width = float(orders[at]), float(orders[0] / FEWEST_CYCLES)
    own = amplitude[np.abs(orders - order) <= max(2 * width, _NEAR * order)].max(initial=0.0)
    doubts = []
    stop, level = longest_stop(measurement.rotation_deg, measurement.thrust_n)
    turned = float(measurement.rotation_deg[-1] - measurement.rotation_deg[0])
    if stop > _STUCK:
        doubts.append(
            f"Check the force: it stays at exactly {number(level)} N over {number(100 * stop / turned, 2)} % of the "
            "record, as of a sensor that is stuck or at the end of its range."
        )
    if own < _WEAK * amplitude[at]:
        doubts += _angle_doubts(measurement, strongest, order)
    return doubts + _unit_doubts(float(amplitude[at]) / expected)


def doubts_of_record(measurement: Measurement, each: ComplexArray) -> list[str]:
    """Sentences on what no tripod joint does, whatever its frictions: its third order is the strongest.

    Args:
        measurement: Thrust force over the rotation angle.
        each: Complex amplitudes of each revolution of the record, shape (revolution, order).
    """
    joint = np.zeros(each.shape[1], complex)
    joint[3] = cycle_amplitudes(measurement.rotation_deg, measurement.thrust_n)[1].max(initial=0.0)
    return record_doubts(measurement, joint) + _encoder_doubts(measurement, each)


def doubts_of_fit(measured: ComplexArray, model: ComplexArray, known_phase: NDArray[np.bool_]) -> list[str]:
    """Sentences on a sign or a unit of the force that the third order of most records speaks against.

    Args:
        measured, model: Third order of each record and of the model, with unknowns in the middle of their ranges.
        known_phase: Whether phase and sign of the record are given, by its reference angle.
    """
    usable = np.isfinite(model) & (model != 0) & (measured != 0)
    ratio = measured[usable] / model[usable]
    opposite = np.abs(np.degrees(np.angle(ratio[known_phase[usable]]))) > 180 - _OPPOSITE
    doubts = []
    if opposite.sum() > opposite.size / 2:
        doubts.append(
            "Check the sign of the force and reference_angle_deg: the third order is about half a turn out of phase "
            f"with the model's in {opposite.sum()} of {count_of(opposite.size, 'record')}."
        )
    return doubts + _unit_doubts(float(np.median(np.abs(ratio)))) if ratio.size else doubts


def _unit_doubts(ratio: float) -> list[str]:
    """A sentence on the unit if the record and the model differ by about a factor of a thousand."""
    if not (_THOUSAND[0] < ratio < _THOUSAND[1] or _THOUSAND[0] < 1 / ratio < _THOUSAND[1]):
        return []
    text, unit = ("a thousand times", "mN") if ratio > 1 else ("a thousandth of", "kN")
    return [
        f"Check the unit of the force: measured amplitudes are about {text} the model's, as if the record were in "
        f"{unit}; write the unit into the heading, for instance thrust [{unit}]."
    ]


def alignment_doubts(
    measurement: Measurement, each: ComplexArray, model: ComplexArray, reference_angle_deg: float | None
) -> list[str]:
    """Sentences on a sign of the force, a reference angle or an encoder that does not fit.

    Args:
        measurement: Thrust force over the rotation angle.
        each: Complex amplitudes of each revolution of the record, aligned with the model, shape (revolution, order).
        model: Those of the model, shape (order,).
        reference_angle_deg: The reference angle, None where the record was aligned by its third order.
    """
    return _encoder_doubts(measurement, each) + _sign_doubts(each, model, reference_angle_deg)


def _sign_doubts(each: ComplexArray, model: ComplexArray, reference_angle_deg: float | None) -> list[str]:
    measured, noise = each.mean(axis=0), each.std(axis=0).sum() / np.sqrt(len(each))
    if not (abs(model[3]) and abs(measured[3]) > noise):
        return []
    if reference_angle_deg is not None:
        apart = abs(float(np.degrees(np.angle(measured[3] / model[3]))))
        if apart < 180 - _OPPOSITE:
            return []
        return [
            f"Check the sign of the force and {option('reference_angle', reference_angle_deg)}: the measured third "
            f"order is {number(apart)} deg out of phase with the model's."
        ]
    as_given = _difference(measured, model)
    turns = (np.exp(1j * np.radians(angle) * np.arange(model.size)) for angle in (60, 180, -60))
    reversed_sign = min(_difference(-measured * turn, model) for turn in turns)
    if reversed_sign < _REVERSED * as_given and as_given - reversed_sign > 2 * noise:
        return ["Check the sign of the force: with the sign reversed, the record agrees better with the model."]
    return []


def _difference(measured: ComplexArray, model: ComplexArray) -> float:
    return float(np.abs(measured - model).sum())


def _eccentricity(measurement: Measurement) -> float:
    """How far the angle runs ahead and behind once per revolution of even turning, deg; 0 where no time is known."""
    angle, time = measurement.rotation_deg, measurement.time_s
    turns = np.arange(np.ceil(angle[0] / 360), angle[-1] / 360) * 360
    if time is None or turns.size < FEWEST_CYCLES:
        return 0.0
    from scipy.interpolate import CubicSpline

    even = CubicSpline(np.interp(turns, angle, time), turns)
    within = (angle >= turns[0]) & (angle < turns[-1])
    wave = np.exp(-1j * np.radians(angle[within]))
    return float(2 * np.abs(((angle[within] - even(time[within])) * wave).mean()))


def _encoder_doubts(measurement: Measurement, each: ComplexArray) -> list[str]:
    """What an encoder out of centre adds to an order: k a / 2 times order k, at its neighbours k - 1 and k + 1."""
    swing = _eccentricity(measurement)
    amplitude = np.abs(each.mean(axis=0))
    sides = np.radians(swing) / 2 * np.arange(amplitude.size) * amplitude
    wrong = np.append(sides[1:], 0.0) + np.append(0.0, sides[:-1])
    wrong[0] = 0.0
    order = int(np.argmax(wrong))
    if not wrong[order] > _SIDEBAND * amplitude[1:].max():
        return []
    edges = measurement.angle_error_deg  # a swing within it may be of the samples, not of the encoder
    what = "encoder" if swing > edges else f"sampling rate, which shows pulses to {number(edges, 2)} deg"
    return [
        f"Check the {what}: the angle runs ahead and behind by {number(swing, 2)} deg once per revolution. If the "
        f"shaft turned evenly, this falsifies the order {order} by up to {number(float(wrong[order]), 2)} N."
    ]


def _angle_doubts(measurement: Measurement, strongest: float, order: int) -> list[str]:
    """What could make the strongest oscillation of the record the model's strongest order."""
    start = (
        f"Check the rotation angle: the record oscillates most {strongest:.3g} times per revolution, the model {order}"
    )
    pulses = measurement.pulses_per_revolution
    if pulses is not None:
        wanted = pulses * order / strongest
        if round(wanted) != pulses and round(wanted) >= 1 and abs(wanted / round(wanted) - 1) < _NEAR:
            return [f"{start} times; with {option('pulses_per_revolution', round(wanted))} they would be the same."]
        return []
    for factor, unit in ((180 / np.pi, "rad"), (360.0, "rev")):
        if abs(strongest / (order * factor) - 1) < _NEAR:
            return [f"{start} times, as if rotation_deg were in {unit}; write the heading as rotation [{unit}]."]
    return []
