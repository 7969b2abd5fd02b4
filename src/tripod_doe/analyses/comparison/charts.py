"""Charts of a measurement and the model: waveform, orders, orders over speed, and beat."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.number_text import count_of, number
from tripod_doe.page_parts.charts.chart import COLOURS, INK, LINES, MARKERS, Chart, drawing, legend_above
from tripod_doe.page_parts.words import ORDINALS

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes

_RUN_UP = 0.05  # change of speed over its mean from which a record is a run-up
_MOST_POINTS = 60  # revolutions that are drawn one by one; more are averaged in classes of speed
_CLASSES = 30
_MODEL, _MEASURED = COLOURS[0], COLOURS[1]


def comparison_charts(comparison: xr.Dataset, name: str = "") -> list[Chart]:
    """Figures of a comparison: waveform, orders, beat envelope and, of a run-up, orders over speed.

    Args:
        comparison: From `tripod_doe.analyses.comparison.comparison.compare`.
    """
    charts = [_waveform(comparison), _orders(comparison), _envelope(comparison)]
    speed = comparison["speed_rpm"].values if "speed_rpm" in comparison else np.array([1.0])
    return [*charts, _run_up(comparison, speed)] if np.ptp(speed) > _RUN_UP * speed.mean() else charts


def _percent(comparison: xr.Dataset) -> str:
    return f"{100 * comparison.attrs['confidence_level']:.3g} %"


def _waveform(comparison: xr.Dataset) -> Chart:
    data = _columns(comparison, "rotation_deg", "measured_thrust", "measured_thrust_scatter", "model_thrust")
    revolutions = int(comparison.attrs["revolutions_compared"])
    with drawing(4.7, 3.1) as (figure, axes):
        _band(axes, data, "measured_thrust", "measured_thrust_scatter", "measured")
        axes.plot(data["rotation_deg"], data["model_thrust"], color=_MODEL, lw=1.8, label="model")
        _over_rotation(axes, "thrust force (N)")
    apart = float(comparison.attrs["preload_n"])
    caption = (
        "Thrust force over one revolution: measured mean over "
        f"{count_of(revolutions, 'revolution')}{' with its standard deviation (band)' * (revolutions > 1)}, and model. "
        "The measured force is shown about the mean of the model; its own is "
        f"{number(abs(apart))} N {'lower' if apart < 0 else 'higher'}, with the preload of the sensor."
    )
    return Chart("waveform", "Thrust force over one revolution", caption, figure, data)


def _envelope(comparison: xr.Dataset) -> Chart:
    data = _columns(comparison, "rotation_deg", "measured_envelope", "measured_envelope_uncertainty", "model_envelope")
    with drawing(4.7, 3.1) as (figure, axes):
        _band(axes, data, "measured_envelope", "measured_envelope_uncertainty", "measured")
        axes.plot(data["rotation_deg"], data["model_envelope"], color=_MODEL, lw=1.8, label="model")
        axes.set_ylim(bottom=0)
        _over_rotation(axes, "envelope of the beat (N)")
    caption = (
        "Beat: envelope of the orders 2, 3 and 4 over one revolution, with the "
        f"{_percent(comparison)} uncertainty of the measured one (band). A horizontal line means no beat."
    )
    return Chart("beat", "Envelope of the beat", caption, figure, data)


def _columns(comparison: xr.Dataset, axis: str, *names: str) -> pd.DataFrame:
    return pd.DataFrame({name: comparison[name].values for name in (axis, *names)})


def _band(axes: Axes, data: pd.DataFrame, mean: str, spread: str, label: str) -> None:
    low, high = data[mean] - data[spread], data[mean] + data[spread]
    axes.fill_between(data["rotation_deg"], low, high, color=_MEASURED, alpha=0.22, lw=0)
    axes.plot(data["rotation_deg"], data[mean], LINES[1], color=_MEASURED, label=label)


def _over_rotation(axes: Axes, label: str) -> None:
    axes.set_xlim(0, 360)
    axes.set_xticks(range(0, 361, 60))
    axes.set_xlabel("rotation angle of the housing (deg)")
    axes.set_ylabel(label)
    legend_above(axes, 2)


def _orders(comparison: xr.Dataset) -> Chart:
    data = _columns(
        comparison,
        "order",
        "measured_amplitude",
        "measured_amplitude_uncertainty",
        "model_amplitude",
        "model_amplitude_uncertainty",
        "amplitude_difference",
        "phase_difference_deg",
        "phase_difference_uncertainty_deg",
    )
    with drawing(4.7, 3.1) as (figure, axes):
        at, width = data["order"], 0.38
        axes.bar(at + width / 2, data["model_amplitude"], width, color="#b9d0e8", edgecolor=_MODEL, label="model")
        axes.bar(
            at - width / 2, data["measured_amplitude"], width, color="#f6d9c9", edgecolor=_MEASURED, label="measured"
        )
        for side, name in ((-width / 2, "measured_amplitude"), (width / 2, "model_amplitude")):
            unsure = data[f"{name}_uncertainty"].fillna(0)
            axes.errorbar(at + side, data[name], unsure, fmt="none", ecolor=INK, elinewidth=1.2, capsize=2.5)
        axes.grid(axis="x", visible=False)
        axes.set_ylim(bottom=0)
        axes.set_xticks(at)
        axes.set_xlabel("rotating order (-)")
        axes.set_ylabel("amplitude of the thrust force (N)")
        legend_above(axes, 2)
    caption = (
        f"Amplitudes of the rotating orders, measured and model; whiskers are the {_percent(comparison)} uncertainties "
        "of each, as far as they are known."
    )
    return Chart("orders", "Rotating orders", caption, figure, data)


def _run_up(comparison: xr.Dataset, speed: FloatArray) -> Chart:
    """The largest orders of each revolution over its speed; those of the model as horizontal lines."""
    mean = comparison["thrust_amplitude"].mean("revolution").values.copy()
    mean[0] = 0
    shown = sorted({3, 2, *np.argsort(mean)[-2:].tolist()})[:4]
    amplitude = comparison["thrust_amplitude"].sel(order=shown).values
    classes = _classes(speed)
    data = pd.DataFrame({"speed_rpm": [speed[rows].mean() for rows in classes], "revolutions": [*map(len, classes)]})
    for column, order in enumerate(shown):
        data[f"amplitude_n_order_{order}"] = [amplitude[rows, column].mean() for rows in classes]
    with drawing(4.7, 3.1) as (figure, axes):
        for which, order in enumerate(shown):
            axes.plot(
                data["speed_rpm"],
                data[f"amplitude_n_order_{order}"],
                MARKERS[which],
                color=COLOURS[which],
                ms=3.5,
                ls="-",
                lw=0.8,
                label=ORDINALS[order],
            )
            _model_over_speed(axes, comparison.sel(order=order), COLOURS[which])
        axes.set_ylim(bottom=0)
        axes.set_xlabel("speed (rpm)")
        axes.set_ylabel("amplitude of the thrust force (N)")
        legend_above(axes, 2)
    what = "every revolution" if len(classes) == speed.size else f"means of {_CLASSES} classes of speed"
    caption = f"Run-up: measured orders over speed, {what}; dashed lines are the model."
    return Chart("run-up", "Orders over speed", caption, figure, data)


def _model_over_speed(axes: Axes, of_order: xr.Dataset, colour: str) -> None:
    """One order of the model: over the speeds of the revolutions, or the same everywhere."""
    dashed: Any = {"color": colour, "ls": (0, (5, 3)), "lw": 1}
    if "model_amplitude_at_speed" not in of_order:
        axes.axhline(float(of_order["model_amplitude"]), **dashed)
        return
    sorted_by_speed = of_order.sortby("speed_rpm")
    axes.plot(sorted_by_speed["speed_rpm"], sorted_by_speed["model_amplitude_at_speed"], **dashed)


def _classes(speed: FloatArray) -> list[IntArray]:
    """Orders over speed: of each revolution if there are few, else means over classes of equal width."""
    if speed.size <= _MOST_POINTS:
        return list(np.argsort(speed, kind="stable")[:, None])
    edges = np.linspace(speed.min(), speed.max(), _CLASSES + 1)
    group = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, _CLASSES - 1)
    return [np.flatnonzero(group == which) for which in np.unique(group)]
