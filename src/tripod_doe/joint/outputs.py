"""Every output of the joint with unit and meaning, and how they follow from the thrust at the grooves."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.contact_outputs import CONTACT_OUTPUTS
from tripod_doe.joint.orders import amplitude_and_phase, complex_amplitudes, rms
from tripod_doe.joint.output_dimensions import CYCLE, GROOVE, ORDER, ROTATION, STATISTIC, TRUNNION
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.mechanics.stability.rates import RATE_OUTPUTS
from tripod_doe.model_interface import Dimension, Output, by_name

PARTS = (*MECHANISMS, "remainder")
"""Parts of the thrust: contributions of the mechanisms, and the remainder; see `thrust_parts`."""

VIBRATES = "vibrates"
"""Output that states whether a joint vibrates, if it was tested."""

VIBRATION_VERDICT = ("vibration_growth", "vibration_growth_rate_per_s", "vibration_frequency_hz")
"""Outputs that say whether a joint vibrates, in any model."""

VIBRATION_THIRD = "vibration_third_order"
"""Output of a balance: third order of the thrust with the vibration that the balance leaves out."""

VIBRATION_OUTPUTS = (*VIBRATION_VERDICT, "vibration_rms")
"""Outputs of a self-excited vibration."""

BY_CYCLE, SETTLED = "thrust_amplitude_by_cycle", "thrust_amplitude_settled"
STEP_ERROR = "thrust_amplitude_step_error"
CYCLE_OUTPUTS = (BY_CYCLE, SETTLED, STEP_ERROR)
"""Outputs: change of orders from one revolution to the next, their limits, and numerical errors of the needles."""

_STEP_ERROR_OVER_CHANGE = 3.0
"""Error of the needles' steps over the change with half steps. Errors proportional to the step would give 2; while
crowned needles turn over, errors decrease more slowly. 3 covers nine of ten errors over the whole field."""

PART_OUTPUTS = ("thrust_part_amplitude", "thrust_part_phase_deg")
"""Outputs that need the thrust split into its parts."""


_MECHANISM = Dimension("mechanism", np.array(MECHANISMS), "", "friction mechanism")
_PART = Dimension("part", np.array(PARTS), "", "friction mechanism that makes a part of the thrust, or the remainder")

_SIGN = "axial force on the housing, positive along the input axis towards the intermediate shaft"
_PHASE = (
    "thrust(phi) = A_0 cos(p_0) + sum over k of A_k cos(k phi + p_k) with the rotation angle phi of the housing, "
    "A_k >= 0 and -180 < p_k <= 180 degree; p_0 is 0 or 180 degree"
)
_SKEW = "positive counterclockwise about the outward normal of the trunnion surface"

_STILL = ("joint_angle_deg", "torque_n_m", "groove_sliding_friction", "groove_sliding")
"""Parameters without which no force acts along the grooves: if one is zero, the thrust is zero."""
_SKEWS = ("initial_skew_1_deg", "initial_skew_2_deg", "initial_skew_3_deg")
"""With all skews reversed, half a turn later, the thrust force is reversed."""

_OUTPUTS = [
    Output(
        "thrust",
        "N",
        "F",
        "thrust force on the housing, positive towards the intermediate shaft",
        (ROTATION,),
        convention=_SIGN,
        zero_at=_STILL,
    ),
    Output(
        "groove_thrust",
        "N",
        "F_k",
        "part of the thrust force in each groove",
        (GROOVE, ROTATION),
        convention=_SIGN,
        zero_at=_STILL,
    ),
    Output(
        "thrust_amplitude",
        "N",
        "A_k",
        "amplitude of the rotating orders of the thrust force",
        (ORDER,),
        convention=_PHASE,
        zero_at=_STILL,
        mirrored_by=_SKEWS,
    ),
    Output(
        "thrust_phase_deg",
        "degree",
        "p_k",
        "phase of the rotating orders of the thrust force",
        (ORDER,),
        convention=_PHASE,
    ),
    Output(
        "thrust_rms",
        "N",
        "A_k/sqrt(2)",
        "effective value of the rotating orders of the thrust force",
        (ORDER,),
        zero_at=_STILL,
        mirrored_by=_SKEWS,
    ),
    Output(
        "thrust_amplitude_scatter",
        "N",
        "",
        "difference of the thrust amplitude between the last two revolutions",
        (ORDER,),
    ),
    Output(
        BY_CYCLE,
        "N",
        "A_k",
        "amplitude of the rotating orders of the thrust force in each revolution by itself",
        (CYCLE, ORDER),
        optional=True,
        on_request=True,
        convention=_PHASE,
    ),
    Output(
        SETTLED,
        "N",
        "A_k",
        "amplitude of the rotating orders of the thrust force once the needles repeat from one revolution to the next",
        (ORDER,),
        optional=True,
        on_request=True,
        convention=_PHASE,
    ),
    Output(
        STEP_ERROR,
        "N",
        "",
        "error of the thrust amplitude from the steps in which needles are followed: three times what steps of half "
        "the size change",
        (ORDER,),
        optional=True,
        on_request=True,
    ),
    Output(
        "thrust_amplitude_error",
        "N",
        "",
        "error of the thrust amplitude: numerical, from tolerance or step, "
        "and twice the standard error of the mean over revolutions",
        (ORDER,),
        optional=True,
    ),
    Output(
        "groove_thrust_amplitude",
        "N",
        "A_k",
        "amplitude of the rotating orders of the thrust in each groove",
        (GROOVE, ORDER),
        convention=_PHASE,
        zero_at=_STILL,
    ),
    Output(
        "groove_thrust_phase_deg",
        "degree",
        "p_k",
        "phase of the rotating orders of the thrust in each groove",
        (GROOVE, ORDER),
        convention=_PHASE,
    ),
    Output(
        PART_OUTPUTS[0],
        "N",
        "A_k",
        "amplitude of the rotating orders of each mechanism's part of the thrust "
        "force, and of the remainder: inertia and numerical error",
        (_PART, ORDER),
    ),
    Output(
        PART_OUTPUTS[1],
        "degree",
        "p_k",
        "phase of the rotating orders of each mechanism's part of the thrust force",
        (_PART, ORDER),
        convention=_PHASE,
    ),
    Output("friction_power_w", "W", "P", "mean power dissipated by each friction mechanism", (_MECHANISM,)),
    Output(
        "needle_skew_deg",
        "degree",
        "psi",
        "skew of the most loaded needle at this rotation angle",
        (TRUNNION, ROTATION),
        optional=True,
        convention=_SKEW,
    ),
    Output(
        "needle_skew_summary_deg",
        "degree",
        "psi",
        "mean, smallest and largest skew per revolution of the most loaded needle",
        (TRUNNION, CYCLE, STATISTIC),
        optional=True,
        convention=_SKEW,
    ),
    Output(
        "largest_penetration_um", "um", "delta", "largest penetration of any contact, without the initial transient"
    ),
    Output(
        "energy_residual",
        "1",
        "",
        "input less output less friction power, over the friction power (or over a "
        "thousandth of the transmitted power, where that is larger); motion that a method damps instead of resolving "
        "it counts, as the rattling of needles",
    ),
    Output(
        VIBRATES,
        "1",
        "",
        "whether the joint vibrates by itself, 1 or 0; where no recorded joint of such an angle and such frictions "
        "vibrates, a balance does not look, and model rollers does",
        optional=True,
        if_missing=0.0,
    ),
    Output(
        VIBRATION_THIRD,
        "N",
        "A_3",
        "amplitude of the third order of the thrust with the vibration, with needles that keep their skew, where a "
        "balance looks for vibrations and the joint vibrates: within 10 % of model rollers at nine of ten joints",
        optional=True,
    ),
    Output(
        VIBRATION_OUTPUTS[0],
        "1",
        "",
        "factor by which a self-excited vibration grows per revolution while it is small; 1 where none grows",
        optional=True,
        on_request=True,
    ),
    Output(
        VIBRATION_OUTPUTS[1],
        "s-1",
        "",
        "rate at which a self-excited vibration grows while it is small, mean over a revolution; 0 where none grows",
        optional=True,
        on_request=True,
        response=True,
    ),
    Output(
        VIBRATION_OUTPUTS[2],
        "Hz",
        "",
        "frequency of a self-excited vibration while it is small; 0 where none grows",
        optional=True,
        on_request=True,
    ),
    Output(
        VIBRATION_OUTPUTS[3],
        "N",
        "",
        "effective value of the thrust force above order 12, with the vibration that was followed",
        optional=True,
        on_request=True,
        response=True,
    ),
    *CONTACT_OUTPUTS,
    *RATE_OUTPUTS,
]

JOINT_OUTPUTS = by_name(_OUTPUTS)
"""All outputs of the joint by name."""


def vibration_tests(keep: Collection[str]) -> tuple[bool, bool]:
    """Whether these outputs of a balance need a test for vibration at all joints, and at those that may vibrate."""
    return not set(VIBRATION_VERDICT).isdisjoint(keep), not {VIBRATES, VIBRATION_THIRD}.isdisjoint(keep)


def thrust_outputs(groove_thrust: FloatArray, keep: Collection[str]) -> dict[str, FloatArray]:
    """All outputs that follow from the thrust at the grooves.

    Args:
        groove_thrust: Axial force on the housing at each groove, shape (point, revolution, groove, sample), for the
            last revolutions: two or more, or one if all are equal. Orders are of the mean revolution; waveforms and
            scatter of the last two.
        keep: Names of the requested outputs; others are not computed.

    Returns:
        Every output by name, its first axis the point.
    """
    results: dict[str, FloatArray] = {}
    per_revolution = complex_amplitudes(groove_thrust)  # (point, revolution, groove, order)
    of_groove = per_revolution.mean(axis=1)
    results["groove_thrust_amplitude"], results["groove_thrust_phase_deg"] = amplitude_and_phase(of_groove)
    results["thrust_amplitude"], results["thrust_phase_deg"] = amplitude_and_phase(of_groove.sum(axis=1))
    results["thrust_rms"] = rms(results["thrust_amplitude"])
    last_two = slice(-2, None)
    amplitude = np.abs(per_revolution[:, last_two].sum(axis=2))
    results["thrust_amplitude_scatter"] = np.abs(amplitude[:, -1] - amplitude[:, 0])
    if "thrust" in keep or "groove_thrust" in keep:
        revolutions = np.moveaxis(
            np.broadcast_to(groove_thrust[:, last_two], (len(groove_thrust), 2, *groove_thrust.shape[2:])), 1, 2
        )
        results["groove_thrust"] = revolutions.reshape(*revolutions.shape[:2], -1)
        results["thrust"] = results["groove_thrust"].sum(axis=1)
    return {name: data for name, data in results.items() if name in keep}


def cycle_outputs(
    each: FloatArray, repeating: FloatArray, finer: FloatArray, keep: Collection[str]
) -> dict[str, FloatArray]:
    """Orders of single revolutions and of the periodic state, and errors of the needles' steps.

    Args:
        each: Axial force on the housing at each groove, shape (point, revolution, groove, sample).
        repeating: The same once needles repeat, shape (point, groove, sample).
        finer: The mean of the last two with needles in steps of half the size, shape (point, groove, sample).
        keep: Names of the wanted outputs.

    Returns:
        Every output by name, its first axis the point.
    """
    thrusts = {BY_CYCLE: each.sum(axis=2), SETTLED: repeating.sum(axis=1)}
    results = {name: np.abs(complex_amplitudes(thrust)) for name, thrust in thrusts.items() if name in keep}
    if STEP_ERROR in keep:
        change = complex_amplitudes(finer.sum(axis=1)) - complex_amplitudes(each[:, -2:].mean(axis=1).sum(axis=1))
        results[STEP_ERROR] = _STEP_ERROR_OVER_CHANGE * np.abs(change)
    return results


def part_outputs(thrust_parts: FloatArray, keep: Collection[str]) -> dict[str, FloatArray]:
    """Orders of the parts of the thrust; the complex amplitudes of all parts add up to the thrust's.

    Args:
        thrust_parts: Shape (point, revolution, part, sample), as in `thrust_outputs`.
        keep: Names of the wanted outputs.

    Returns:
        Every output by name, its first axis the point.
    """
    orders = amplitude_and_phase(complex_amplitudes(thrust_parts).mean(axis=1))
    return {name: data for name, data in zip(PART_OUTPUTS, orders, strict=True) if name in keep}


def skew_outputs(skew: FloatArray, samples: int) -> dict[str, FloatArray]:
    """Outputs of the skew of the most loaded needles.

    Args:
        skew: In degrees, over all revolutions, shape (point, trunnion, cycles sample).
        samples: Samples per revolution.

    Returns:
        Every output by name, its first axis the point.
    """
    by_cycle = skew.reshape(*skew.shape[:2], -1, samples)
    summary = np.stack([by_cycle.mean(-1), by_cycle.min(-1), by_cycle.max(-1)], axis=-1)
    return {"needle_skew_deg": skew[..., -2 * samples :], "needle_skew_summary_deg": summary}
