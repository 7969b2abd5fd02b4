"""The model's side of a comparison with a measurement: a point of a cube, or its points over speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.diff.definitions import fixed_parameters
from tripod_doe.analyses.fit.model_error import model_error
from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.errors import CubeError, InputError, option
from tripod_doe.joint.known_errors.other_orders import SOURCE, deviations_of_orders
from tripod_doe.joint.orders import ORDERS, complex_amplitudes
from tripod_doe.joint.outputs import JOINT_OUTPUTS
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.order_tracking import CELLS
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.chosen_models import models_used
from tripod_doe.study.cube.model_records import MODEL_ERROR
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.query.query import query

_UNSURE = ("thrust_amplitude_scatter", "thrust_amplitude_error")
_MODEL_OUTPUTS = ("thrust_amplitude", "thrust_phase_deg", *_UNSURE, "thrust")
_SPEED = "speed_rpm"
_SPEED_PLAY = 1e-3  # relative: how far from the speeds of a cube a revolution still counts as at their end


def model_point(cube: xr.Dataset, select: Sequence[str] = (), nearest: bool = False) -> xr.Dataset:
    """The point of a cube that a measurement is compared with, or its points over speed where several are left.

    Args:
        select: ``name=value`` for each factor with more than one value; speed_rpm may keep several.
        nearest: Take the nearest value where none matches.

    Returns:
        thrust_amplitude, thrust_phase_deg and thrust_amplitude_scatter (order), thrust(rotation_deg), as far as the
        cube has them, over ``speed_rpm`` where several speeds are left; the other factors as scalar coordinates.

    Raises:
        InputError: If the cube holds no thrust force, the selection leaves none or several points other than over
            speed, or the point did not finish.
    """
    wanted = [name for name in _MODEL_OUTPUTS if name in cube]
    if "thrust" not in wanted and not {"thrust_amplitude", "thrust_phase_deg"} <= set(wanted):
        raise InputError(
            "the cube holds neither thrust nor thrust_amplitude with thrust_phase_deg; add them to [keep] outputs and "
            f"run the study with another {option('out')}"
        )
    wanted += [name for name in (MODEL_ERROR, "model_used") if name in cube]
    chosen = xr.merge([query(cube, name, select, nearest) for name in wanted], compat="equals", join="exact")
    design = [str(dim) for dim in chosen["outcome"].dims]
    counts = {dim: chosen.sizes[dim] for dim in design if chosen.sizes[dim] != 1}
    if counts.keys() == {_SPEED} and chosen.sizes[_SPEED] > 1:
        return _over_speed(chosen.squeeze([dim for dim in design if dim != _SPEED])).assign_attrs(cube.attrs)
    if counts:
        none = [dim for dim, count in counts.items() if count == 0]
        asked = ", ".join(text for text in select if text.partition("=")[0] in none[:1])
        text = (
            f"no point has {asked}: {none[0]} is {_levels(cube[none[0]])}; {option('nearest', True)} takes the nearest"
            if none
            else "choose one point: " + " ".join(option("select", f"{dim}={_levels(chosen[dim])}") for dim in counts)
        )
        raise InputError(f"the selection leaves {int(np.prod(list(counts.values())))} points; {text}")
    point = chosen.squeeze(design)
    if (outcome := Outcome(int(point["outcome"]))) is not Outcome.FINISHED:
        raise InputError(f"this point of the cube has no thrust force: its outcome is {outcome.label}; choose another")
    return point.assign_attrs(cube.attrs)


def refuse_other_units(cube: xr.Dataset) -> None:
    """Refuse a cube or a point that another program has converted to other units than a comparison states.

    A value without a unit is refused, too: xarray drops the unit of what it calculates.

    Raises:
        CubeError: If a parameter or a compared output does not state the unit that the joint gives it.
    """
    expected = {name: JOINT_OUTPUTS[name].unit for name in _MODEL_OUTPUTS} | {"rotation_deg": "degree"}
    expected |= {name: parameter.unit for name, parameter in JOINT_PARAMETERS.items() if parameter.kind != "choice"}
    for name, needed in expected.items():
        if name not in cube.variables:
            continue
        attrs = cube[name].attrs
        unnamed = "1" if attrs.get("source") == "user function" else needed  # an argument has its unit in its name
        if (unit := attrs.get("units")) not in (needed, unnamed):
            known = "states no unit" if unit is None else f"is in {unit!r}"
            raise CubeError(
                f"{name} of this cube {known}, where a comparison needs {needed!r}: convert it back, and set its "
                "attribute units"
            )


def _over_speed(points: xr.Dataset) -> xr.Dataset:
    """The finished points over speed, by growing speed."""
    finished = points.isel({_SPEED: np.flatnonzero(points["outcome"].values == Outcome.FINISHED)}).sortby(_SPEED)
    if finished.sizes[_SPEED] < 2:
        raise InputError(f"only {finished.sizes[_SPEED]} of {points.sizes[_SPEED]} points over speed finished")
    return finished


def _levels(labels: xr.DataArray) -> str:
    shown = [f"{value:g}" if isinstance(value, float) else str(value) for value in labels.values[:6].tolist()]
    return "|".join(shown) + ("|..." if labels.size > 6 else "")


def orders_at_speeds(tracked: xr.Dataset, point: xr.Dataset) -> ComplexArray | None:
    """Complex amplitudes of the model at the speed of every revolution, shape (revolution, order).

    NaN outside of the model's speeds, with the play of `common_speeds`; None for a model of one speed.
    """
    if _SPEED not in point.dims:
        return None
    if _SPEED not in tracked:
        raise InputError(
            "the cube has several speeds and the record none: add a column time_s to the measurement, or choose a "
            f"speed: {option('select', f'{_SPEED}={_levels(point[_SPEED])}')}"
        )
    speeds, known = tracked[_SPEED].values, point[_SPEED].values
    orders = np.array([model_orders(point.isel({_SPEED: i})) for i in range(known.size)])
    edges = known[0] * (1 - _SPEED_PLAY), known[-1] * (1 + _SPEED_PLAY)
    speeds = np.where((speeds < edges[0]) | (speeds > edges[1]), speeds, np.clip(speeds, known[0], known[-1]))
    parts = [np.interp(speeds, known, part, left=np.nan, right=np.nan) for part in (*orders.real.T, *orders.imag.T)]
    real, imaginary = np.split(np.array(parts).T, 2, axis=1)
    return np.asarray(real + 1j * imaginary, np.complex128)


def common_speeds(point: xr.Dataset, wanted: tuple[float, float] | None) -> tuple[float, float] | None:
    """The speeds that are compared: as wanted, and within those of a cube over speed, or a thousandth beyond.

    So much a record at the first speed of the cube may miss it by rounded times.
    """
    if _SPEED not in point.dims:
        return wanted
    low, high = float(point[_SPEED].min()) * (1 - _SPEED_PLAY), float(point[_SPEED].max()) * (1 + _SPEED_PLAY)
    return (low, high) if wanted is None else (max(low, wanted[0]), min(high, wanted[1]))


def own_uncertainty(point: xr.Dataset) -> FloatArray:
    """Change between the last two revolutions and numerical error of the model, N, the mean over speed, (order,)."""
    parts = np.zeros(ORDERS.size)
    for name in (name for name in _UNSURE if name in point):
        part = point[name]
        parts = np.hypot(parts, np.nan_to_num(part.mean(_SPEED) if _SPEED in part.dims else part))
    return np.asarray(parts, float)


def parameters_of(point: xr.Dataset) -> dict[str, Any]:
    """Parameters of a point of the joint by name; of points over speed, their mean speed. Empty for other points.

    The model is the one that answers, which a pilot or a retry may have chosen; of several the coarsest.
    """
    if "parameters" in point.attrs:  # from `simulate`
        known = dict(point.attrs["parameters"])
    elif str(point.attrs.get("source", "")).endswith("simulator joint"):
        known = fixed_parameters(point)
    else:
        return {}
    known |= {str(name): label.item() for name, label in point.coords.items() if label.ndim == 0}
    if _SPEED in point.dims:
        known[_SPEED] = float(point[_SPEED].mean())
    if answering := models_used(point):
        known["model"] = answering[0]
    known = {name: value for name, value in known.items() if name in JOINT_PARAMETERS}
    return known if "torque_n_m" in known else {}


def model_uncertainty(
    point: xr.Dataset, amplitude: FloatArray, confidence: float
) -> tuple[FloatArray, FloatArray, str]:
    """Half widths of the intervals of the model's amplitudes and phases, and where its error comes from.

    The error on record against the finest model, what a run still changes between its revolutions, and its numerical
    error count as normal deviations. Of a model without records the last two alone count, and no origin is stated.

    Returns:
        Amplitudes (N) and phases (deg), shape (order,) each, a phase NaN where its error is not known; and the origin.

    Raises:
        InputError: If the point has no torque.
    """
    from scipy.special import ndtri  # quantiles of the normal distribution

    deviation, origin, known = own_uncertainty(point), "", parameters_of(point)
    turned = np.zeros(ORDERS.size)
    if known:
        if known["torque_n_m"] == 0:
            raise InputError(
                "there is nothing to compare with at torque_n_m = 0: only inertia presses the rollers into their "
                "grooves, which no model follows; compare a record under load"
            )
        simulator = load_simulator("joint")
        columns = simulator.columns(known, {}, 1)
        others, phases = (each[0] for each in deviations_of_orders(simulator, columns, amplitude[None]))
        recorded = np.isfinite(others).any()
        asked = [3] if recorded else ORDERS[1:].tolist()  # the mean force is not compared
        error = model_error(simulator, columns, asked, amplitude[None, asked].astype(complex), "recorded")
        whole, origin = np.full(ORDERS.size, np.nan), error.source
        whole[asked] = error.whole[0]
        if recorded:
            whole, turned = np.where(np.isnan(others), whole, others), phases
            origin = f"{origin.partition('; of phases')[0]}; other orders and phases from {SOURCE}"
        else:
            turned = np.degrees(np.arctan2(whole, amplitude))
        deviation = np.hypot(whole, deviation)
    wide = float(ndtri((1 + confidence) / 2))
    return np.asarray(wide * deviation, float), np.asarray(wide * turned, float), origin


def complex_orders(orders: xr.Dataset) -> ComplexArray:
    """Complex amplitudes of orders, from their amplitudes and phases."""
    amplitude, phase = orders["thrust_amplitude"].values, orders["thrust_phase_deg"].values
    return np.asarray(amplitude * np.exp(1j * np.radians(phase)), np.complex128)


def model_orders(point: xr.Dataset) -> ComplexArray:
    """Complex amplitudes of the model, shape (order,)."""
    if "thrust_amplitude" in point and "thrust_phase_deg" in point:
        return complex_orders(point)
    return complex_amplitudes(point["thrust"].values.reshape(2, -1)).mean(axis=0)


def model_waveform(point: xr.Dataset, model: ComplexArray, wave: ComplexArray) -> FloatArray:
    """The model's last revolution over 0 .. 359 deg; of a cube without waveforms the sum of its orders."""
    last = np.asarray(point["rotation_deg"].values >= 360 if "rotation_deg" in point.coords else False)
    if "thrust" not in point or _SPEED in point.dims or not last.any():
        return np.asarray((wave @ model).real, float)
    rotation, thrust = point["rotation_deg"].values, point["thrust"].values
    return np.asarray(np.interp(np.arange(CELLS), rotation[last] - 360, thrust[last], period=360), float)
