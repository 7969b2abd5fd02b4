"""Order tracking: the rotating orders and the waveform of every revolution of a measured signal.

The orders of each revolution are fitted to its samples at their angles, without interpolation across dropouts. For
evenly spaced samples the result equals the Fourier transform.

A drift of s per revolution would add a sawtooth to every revolution, s / (pi k) to order k. So the drift is estimated
from the change of the mean from one revolution to the next, and its sawtooth is subtracted.
"""

from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import ComplexArray, FloatArray, IntArray
from tripod_doe.errors import InputError, option
from tripod_doe.joint.orders import ORDERS, amplitude_and_phase
from tripod_doe.phases import PHASE_ATTRIBUTES

CELLS = 360
"""Cells of a resampled revolution, 1 deg each."""

_UNKNOWNS = 2 * ORDERS.size - 1
_WIDEST_GAP = 360.0 / _UNKNOWNS  # deg: the spacing that just resolves order 12
_FEWEST_SAMPLES = 32  # per revolution: more than the 25 unknowns


def track_orders(rotation_deg: FloatArray, thrust_n: FloatArray, time_s: FloatArray | None = None) -> xr.Dataset:
    """Rotating orders 0 to 12 of every whole revolution: order tracking, for instance of a run-up.

    In each revolution f(phi_i) = sum_k Re(C_k exp(i k phi_i)) is solved for C_k by least squares over its samples.
    With N evenly spaced samples and white noise of standard deviation sigma, an amplitude has the standard deviation
    sigma sqrt(2/N), and a phase this value divided by the amplitude, in rad. A gap raises both: revolutions with a gap
    wider than 360/25 = 14.4 deg are left out. A linear drift adds nothing. Cost: 2 N 25^2 operations per revolution.

    Args:
        rotation_deg: Rotation angle, not falling, in degrees, shape (sample,).
        thrust_n: Thrust force in N, NaN at dropouts, shape (sample,).
        time_s: Time of the samples in s.

    Returns:
        thrust_amplitude and thrust_phase_deg (revolution, order), samples(revolution), and with time speed_rpm
        (revolution); attributes ``revolutions_used``, ``revolutions_left_out`` and ``drift_n_per_revolution``.

    Raises:
        InputError: If there are fewer than two whole revolutions without wide gaps, or they have too few samples.
    """
    there = np.isfinite(thrust_n)
    bounds = _revolutions(rotation_deg)
    angle, force = rotation_deg[there], thrust_n[there]
    time = None if time_s is None else time_s[there]
    first = np.searchsorted(angle, bounds)
    rows, ramps, used = [], [], []
    for revolution, (start, end) in enumerate(pairwise(first)):
        gaps = np.diff(np.concatenate([[bounds[revolution]], angle[start:end], [bounds[revolution + 1]]]))
        if end - start >= _FEWEST_SAMPLES and gaps.max() <= _WIDEST_GAP:
            ramp = (angle[start:end] - bounds[revolution]) / 360 - 0.5
            orders, sawtooth = _fit(angle[start:end], np.stack([force[start:end], ramp], axis=1)).T
            rows.append(orders)
            ramps.append(sawtooth)
            used.append(revolution)
    if len(used) < 2:
        samples = int(np.median(np.diff(first)))
        raise InputError(
            f"only {len(used)} of {bounds.size - 1} revolutions can be used: each needs {_FEWEST_SAMPLES} samples "
            f"(the median is {samples}) and no gap wider than {_WIDEST_GAP:.1f} deg; sample faster, "
            "or remove the dropouts"
        )
    orders, sawteeth = np.array(rows), np.array(ramps)
    drift = np.gradient(orders[:, 0].real, used)
    orders[:, 1:] -= (drift[:, None] * sawteeth)[:, 1:]
    tracked = _labelled(orders, np.array(used), np.diff(first)[used].astype(np.int32))
    if time is not None:
        ends = [(first[r], first[r + 1] - 1) for r in used]
        speed = [(angle[b] - angle[a]) / (time[b] - time[a]) / 6 for a, b in ends]
        tracked["speed_rpm"] = ("revolution", np.array(speed), _meaning("rpm", "mean speed of the revolution"))
    return tracked.assign_attrs(
        revolutions_used=len(used),
        revolutions_left_out=bounds.size - 1 - len(used),
        drift_n_per_revolution=float(drift.mean()),
    )


def _labelled(orders: ComplexArray, revolutions: IntArray, samples: NDArray[np.int32]) -> xr.Dataset:
    """Complex amplitudes (revolution, order) as amplitudes and phases with their labels."""
    amplitude, phase = amplitude_and_phase(orders)
    by_order = ("revolution", "order")
    return xr.Dataset(
        {
            "thrust_amplitude": (by_order, amplitude, _meaning("N", "measured amplitude, each revolution")),
            "thrust_phase_deg": (
                by_order,
                phase,
                _meaning("degree", "measured phase, each revolution") | PHASE_ATTRIBUTES,
            ),
            "samples": ("revolution", samples, _meaning("1", "samples in the revolution")),
        },
        coords={
            "revolution": ("revolution", revolutions.astype(np.int32) + 1, _meaning("1", "number of the revolution")),
            "order": ("order", ORDERS.astype(np.int32), _meaning("1", "rotating order")),
        },
    )


def _revolutions(rotation_deg: FloatArray) -> FloatArray:
    """Bounds of the whole revolutions of a record, from its first sample on."""
    if rotation_deg.size < 2:
        raise InputError(f"the record has {rotation_deg.size} samples with an angle; two whole revolutions are needed")
    if not rotation_deg[-1] - rotation_deg[0] <= 360.0 * rotation_deg.size:  # also if it is not a number
        raise InputError(
            f"the record has {rotation_deg.size:,} samples and covers {(rotation_deg[-1] - rotation_deg[0]) / 360:.3g} "
            f"revolutions, more than one a sample: check its rotation angle, or {option('pulses_per_revolution')}"
        )
    # the last sample stands for the step behind it: 0, 1, ... 719 deg are two revolutions; and where pulses bound a
    # record, its first and its last sample lie up to a step within whole revolutions
    span, steps = rotation_deg[-1] - rotation_deg[0], np.diff(rotation_deg)
    step = max(float(np.median(steps)), steps[-1])
    count = int((span + max(step, min(2 * step, _WIDEST_GAP))) / 360 + 1e-6)
    if count < 2:
        raise InputError(
            f"the record covers {span / 360:.2f} revolutions; at least two whole ones are needed to compute "
            f"the scatter between revolutions: measure longer, or check {option('pulses_per_revolution')}"
        )
    return rotation_deg[0] + 360.0 * np.arange(count + 1)


def _fit(angle_deg: FloatArray, force: FloatArray) -> ComplexArray:
    """Complex amplitudes of signals over one revolution, shape (sample, signal) -> (order, signal)."""
    wave = np.exp(1j * np.radians(angle_deg)[:, None] * ORDERS)
    basis = np.hstack([wave.real, -wave.imag[:, 1:]])
    real = np.linalg.solve(basis.T @ basis, basis.T @ force)  # well conditioned: gaps are no wider than 1/25 turn
    return real[: ORDERS.size] + 1j * np.concatenate([np.zeros_like(real[:1]), real[ORDERS.size :]])


def resample(rotation_deg: FloatArray, thrust_n: FloatArray) -> FloatArray:
    """The thrust force over 0, 1, ... 359 deg of every whole revolution, as means over 1 deg.

    The signal is integrated over the angle and differenced at the ends of the cells: this averages faster sampling,
    which prevents aliasing of noise, and joins slower sampling with straight lines. Order k is multiplied by
    sin(x)/x, x = pi k/360: 0.2 % smaller at order 12. Dropouts, and cells in gaps wider than two and a half median
    steps, are NaN.

    Args:
        rotation_deg: Rotation angle, not falling, in degrees, shape (sample,).
        thrust_n: Thrust force in N, NaN at dropouts, shape (sample,).

    Returns:
        ndarray, shape (revolution, 360)
    """
    there = np.isfinite(thrust_n)
    angle, force = rotation_deg[there], thrust_n[there]
    integral = np.concatenate([[0.0], np.cumsum(np.diff(angle) * (force[1:] + force[:-1]) / 2)])
    first, last = int(np.ceil(rotation_deg[0])), int(np.ceil(rotation_deg[-1]))
    centre = np.arange(first, last + 1, dtype=float)
    ends = np.clip([centre - 0.5, centre + 0.5], angle[0], angle[-1])
    cells = np.diff(_integral_at(ends, angle, force, integral), axis=0)[0]
    cells = np.where(ends[1] - ends[0] < 1, np.interp(centre, angle, force), cells)  # half cells at the record's ends
    behind = np.clip(np.searchsorted(angle, centre), 1, angle.size - 1)
    step = np.maximum(2.5 * np.median(np.diff(angle)), 1.0)
    inside = (centre >= angle[0]) & (centre <= angle[-1])
    cells[~inside | (angle[behind] - angle[behind - 1] > step)] = np.nan
    whole = cells.size // CELLS * CELLS
    return np.roll(cells[:whole].reshape(-1, CELLS), first % CELLS, axis=1)


def _integral_at(at: FloatArray, angle: FloatArray, force: FloatArray, integral: FloatArray) -> FloatArray:
    """The integral of the straight lines between samples, at any angle among them."""
    row = np.clip(np.searchsorted(angle, at, side="right") - 1, 0, angle.size - 1)
    return integral[row] + (at - angle[row]) * (force[row] + np.interp(at, angle, force)) / 2


def _meaning(unit: str, meaning: str) -> dict[str, str]:
    return {"units": unit, "long_name": meaning}
