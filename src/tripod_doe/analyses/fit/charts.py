"""Charts of a fit: intervals, measured and fitted, residuals, profiles, and what to measure next."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.fit.sentences import candidate_text
from tripod_doe.array_types import FloatArray
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.page_parts.charts.chart import COLOURS, INK, Chart, drawing
from tripod_doe.page_parts.charts.orders import agreement, differences
from tripod_doe.page_parts.words import spoken, unit_text, with_brackets

_OVER = ("joint_angle_deg", "torque_n_m", "speed_rpm")
_MOST_CANDIDATES = 20


def fit_charts(fit: xr.Dataset, name: str = "") -> list[Chart]:
    """All figures of a fit, the intervals first."""
    charts = [_intervals(fit), _measured(fit), *_left_over(fit), *_profiles(fit)]
    if fit.sizes["unknown"] > 1:
        charts.append(_correlations(fit))
    if "next" in fit and np.isfinite(fit["next"]).any():
        charts.append(_next(fit))
    return charts


def _intervals(fit: xr.Dataset) -> Chart:
    """Intervals of all unknowns within their bounds."""
    rows = []
    for name in fit["unknown"].values.tolist():
        own = fit.sel(unknown=name)
        low, high = float(own["bound_low"]), float(own["bound_high"])
        parts = [[float(own[key])] for key in ("value", "low", "high")]
        if not np.isfinite(parts[0][0]):
            parts = [own[f"{key}_of_record"].values.tolist() for key in ("value", "low", "high")]
        for value, start, end in zip(*parts, strict=True):
            place = [100 * (part - low) / (high - low) for part in (value, start, end)]
            rows.append((name, value, start, end, *place))
    columns = ["unknown", "value", "low", "high", "value_percent", "low_percent", "high_percent"]
    data = pd.DataFrame(rows, columns=columns)
    names = list(dict.fromkeys(data["unknown"]))
    with drawing(5.2, 1.2 + 0.35 * len(names)) as (figure, axes):
        at = np.array([names.index(name) for name in data["unknown"]], float)
        spread = data.groupby("unknown").cumcount() / data.groupby("unknown")["value"].transform("size")
        at = at + 0.6 * np.where(data["unknown"].duplicated(keep=False), spread - 0.4, 0)
        middle, left, right = (data[f"{name}_percent"].to_numpy() for name in ("value", "low", "high"))
        ends = np.clip([middle - left, right - middle], 0, None)
        axes.errorbar(middle, at, xerr=ends, fmt="o", color=COLOURS[0], ecolor=INK, capsize=2.5)
        axes.set_yticks(range(len(names)), [spoken(name) for name in names])
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xlim(-2, 102)
        axes.set_xlabel("place between lower and upper bound (%)")
    caption = "Fitted values with their 95 % intervals, each within the bounds of its search."
    return Chart("intervals", "Fitted values and their intervals", caption, figure, data)


def _measured(fit: xr.Dataset) -> Chart:
    """Fitted over measured amplitudes."""
    data = fit[["measured", "measured_error", "fitted", "model_error", "left_out"]].to_dataframe().reset_index()
    data = data[["record", "order", "measured", "measured_error", "fitted", "model_error", "left_out"]]
    figure = agreement(data, "fitted", "model_error", data[data["left_out"] == 1])
    caption = (
        "Fitted over measured amplitudes of all records, with the 95 % uncertainties of both; the line is agreement."
    )
    return Chart("measured", "Measured and fitted", caption, figure, data)


def _left_over(fit: xr.Dataset) -> list[Chart]:
    """Relative differences over what varies between the records."""
    charts = []
    for name in _OVER:
        if name not in fit.coords or fit[name].dims != ("record",) or np.unique(fit[name].values).size < 3:
            continue
        parts = []
        for order in fit["order"].values.tolist():
            own = fit.sel(order=order)
            whole = np.hypot(own["measured_error"].values, own["model_error"].values)
            columns = {
                "record": own["record"].values,
                name: own[name].values.astype(float),
                "order": order,
                "residual": own["residual"].values,
                "uncertainty": whole,
            }
            parts.append(pd.DataFrame(columns))
        data = pd.concat(parts, ignore_index=True)
        figure = differences(data, name, "residual", "measured minus fitted (N)")
        caption = (
            f"Measured minus fitted amplitudes over {spoken(name)}, with the 95 % uncertainty of measurement and model "
            "together: the fit explains what lies within it."
        )
        charts.append(Chart(f"left-over-{name}", f"Differences over {spoken(name)}", caption, figure, data))
    return charts


def _profiles(fit: xr.Dataset) -> list[Chart]:
    """Growth of chi squared along each unknown that all records share."""
    shared = [name for name in fit["unknown"].values.tolist() if np.isfinite(float(fit["value"].sel(unknown=name)))]
    charts = []
    allowed = float(fit.attrs["growth_at_ends"])
    for name in shared:
        own = fit.sel(unknown=name)
        data = pd.DataFrame({name: own["profile_value"].values, "growth": own["profile_growth"].values}).dropna()
        if len(data) < 3:
            continue
        with drawing(4.0, 2.5) as (figure, axes):
            curve = _profile_curve(data[name].to_numpy(), data["growth"].to_numpy())
            axes.plot(*curve, color=COLOURS[0])
            axes.plot(data[name], data["growth"], "o", color=COLOURS[0])
            axes.axhline(allowed, color=COLOURS[1], ls="--", lw=1)
            axes.set_xlabel(with_brackets(spoken(name), unit_text(JOINT_PARAMETERS[name].unit)))
            axes.set_ylabel("growth of chi squared")
            axes.set_ylim(0, 2 * allowed)
        caption = (
            f"Growth of chi squared where {spoken(name)} has another value and all other unknowns are fitted "
            "again; the 95 % interval ends at the dashed line."
        )
        charts.append(Chart(f"profile-{name}", f"Profile of {spoken(name)}", caption, figure, data))
    return charts


def _profile_curve(values: FloatArray, growth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A profile between its points: the root of growth, with the sign of its side, is nearly a straight line."""
    root = np.sqrt(growth) * np.sign(np.arange(values.size) - int(np.argmin(growth)))
    fine = np.linspace(values[0], values[-1], 101)
    return fine, np.asarray(np.interp(fine, values, root) ** 2, float)


def _correlations(fit: xr.Dataset) -> Chart:
    """Correlations of the fitted values."""
    names = fit["unknown"].values.tolist()
    values = fit["correlation"].values
    data = pd.DataFrame(values, columns=names).assign(unknown=names)[["unknown", *names]]
    side = 1.6 + 0.42 * len(names)
    with drawing(side + 1.2, side) as (figure, axes):
        axes.imshow(np.abs(values), cmap="Blues", vmin=0, vmax=1.6)
        for row in range(len(names)):
            for column in range(len(names)):
                axes.text(column, row, f"{values[row, column]:.2f}", ha="center", va="center", fontsize=7.5)
        axes.set_xticks(range(len(names)), [spoken(name) for name in names], rotation=40, ha="right")
        axes.set_yticks(range(len(names)), [spoken(name) for name in names])
        axes.grid(visible=False)
    caption = "Correlations of the fitted values: near 1 or -1, the records determine only a combination of both."
    return Chart("correlations", "Correlations", caption, figure, data)


def _next(fit: xr.Dataset) -> Chart:
    """Gain by one more record at each candidate."""
    part = fit["next"].values
    order = [at for at in np.argsort(part) if np.isfinite(part[at])][:_MOST_CANDIDATES]
    texts = [candidate_text(fit, int(at)) for at in order]
    data = pd.DataFrame({"operating_point": texts, "shorter_percent": 100 * (1 - part[order])})
    with drawing(6.0, 1.0 + 0.22 * len(order)) as (figure, axes):
        axes.barh(range(len(order)), data["shorter_percent"], color=COLOURS[0])
        axes.set_yticks(range(len(order)), texts)
        axes.invert_yaxis()
        axes.set_xlabel("interval shorter by (%)")
    caption = f"By how much one more record at each point would shorten the interval of {fit.attrs['next_unknown']}."
    return Chart("next", "What to measure next", caption, figure, data)
