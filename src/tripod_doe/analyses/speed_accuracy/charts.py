"""Error over CPU time: one line per method, failed runs, the Pareto front, and the errors of the models."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import capital
from tripod_doe.page_parts.charts.chart import COLOURS, INK, MARKERS, MUTED, Chart, drawing, panels
from tripod_doe.page_parts.words import listed

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes

_CROSSES = {Outcome.DIVERGED: "x", Outcome.INACCURATE: "X", Outcome.STEP_LIMIT: "+", Outcome.EVALUATION_LIMIT: "1"}
_OTHER = "*"
_X_LABEL = "CPU seconds per simulated second (-)"


def ladder_charts(data: xr.Dataset, name: str = "") -> list[Chart]:
    """One picture per scene with several models: all models and methods side by side in the first two quantities.

    Error is the difference to the finest model, so that models and methods compare on one scale. Front, defaults and
    failed runs are in it.

    Parameters
    ----------
    data
        An analysis of kind speed-accuracy.
    """
    charts = []
    for scene in dict.fromkeys(data["scene"].values.tolist()):
        runs = data.isel(run=np.flatnonzero(data["scene"].values == scene))
        known = np.isfinite(runs["model_error"].values)
        several = [
            str(quantity)
            for at, quantity in enumerate(runs["quantity"].values)
            if np.unique(runs["model"].values[known[:, at]]).size > 1
        ]
        if several:
            cases = data.isel(case=np.flatnonzero(data["case_scene"].values == scene))
            charts.append(
                _ladder_chart(runs, cases, str(scene), sorted(several, key=lambda each: each != "third_order")[:2])
            )
    return charts


def _ladder_chart(runs: xr.Dataset, cases: xr.Dataset, scene: str, quantities: list[str]) -> Chart:
    """Errors over price; an unresolved error, below the finest model's reference, is drawn at its edge."""
    price, models = runs["cpu_per_second"].values, list(dict.fromkeys(runs["model"].values.tolist()))
    finest, tables = str(cases["case_model"].values[-1]), []
    floors = [100 * max(float(cases["reference_error"].sel(quantity=each)[-1]), 1e-14) for each in quantities]
    errors = 100 * runs["model_error"].sel(quantity=quantities).values
    least = float(errors.min(initial=np.nanmax(errors), where=errors > floors))
    low, high = max(min(floors), least / 2) / 3, 2 * float(np.nanmax(errors))
    with panels(len(quantities), len(quantities), 4.1, 4.3) as (figure, axes):
        for panel, quantity, floor in zip(axes, quantities, floors, strict=True):
            of = runs.sel(quantity=quantity)
            error = np.maximum(100 * of["model_error"].values, max(floor, 1.5 * low))
            done = np.isfinite(error)
            _frame(panel, "", "")
            panel.set_title(str(of["quantity_meaning"].item()))
            for at, model in enumerate(models):
                mine = (runs["model"].values == model) & done
                panel.plot(price[mine], error[mine], MARKERS[at], color=COLOURS[at], alpha=0.75, ls="none", label=model)
            _mark(panel, (of["model_front"].values == 1) & done, price, error, "front")
            default = (runs["is_default"].values == 1) & done
            panel.plot(
                price[default], error[default], "o", ms=12, mfc="none", mec=INK, mew=1.4, ls="none", label="default"
            )
            panel.axhspan(low, max(floor, low), color=MUTED, alpha=0.12, lw=0, label="below the reference's error")
            panel.set_ylim(low, 4 * high)
            _failed_at_top(panel, runs, done, models, 2 * high)
            tables.append(of)
        axes[0].set_ylabel(f"difference to {finest} (%)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=4, frameon=False, fontsize=8)
    columns = ["model", "run_method", "setting_kind", "setting", "cpu_per_second", "outcome", "outcome_detail"]
    table = runs[columns].to_dataframe()[columns]
    table["outcome"] = [Outcome(int(kind)).label for kind in runs["outcome"].values]
    for of in tables:
        table[f"{of['quantity'].item()}_error_percent"] = 100 * of["model_error"].values
    caption = (
        f"Difference to the finest model, {finest}, over price: runs of all models and methods. On the broad line no "
        "run is cheaper and more exact; rings are the defaults. Crosses at the top: failed runs, at their price until "
        f"the failure: {_why_failed(runs) or 'none'}. Grey: below the error of the reference, "
        f"{listed([f'{floor:.2g} %' for floor in floors])}, where no difference is known."
    )
    return Chart(f"{scene}-ladder", "All models and methods: error over price", caption, figure, table)


def _failed_at_top(panel: Axes, runs: xr.Dataset, done: np.ndarray, models: list[str], top: float) -> None:
    """An axis that holds the finished runs; failed ones are crosses at the top, at its ends if they lie beyond."""
    price = runs["cpu_per_second"].values
    if not done.any():
        return
    left, right = price[done].min() / 2, price[done].max() * 2
    panel.set_xlim(left, right)
    failed = (runs["outcome"].values != Outcome.FINISHED) & np.isfinite(price)
    for at, model in enumerate(models):
        mine = failed & (runs["model"].values == model)
        shown = np.clip(price[mine], left * 1.1, right / 1.1)
        panel.plot(shown, np.full(mine.sum(), top), "x", color=COLOURS[at], ms=6, mew=1.3)
    panel.plot([], [], "x", color=MUTED, ms=6, mew=1.3, ls="none", label="failed")


def _why_failed(runs: xr.Dataset) -> str:
    """Number of failed runs by their outcome."""
    kinds = [Outcome(int(kind)) for kind in runs["outcome"].values if kind != Outcome.FINISHED]
    counts = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}
    return ", ".join(f"{count} {kind.label.replace('_', ' ')}" for kind, count in counts.items())


def speed_accuracy_charts(data: xr.Dataset, name: str = "") -> list[Chart]:
    """Numerical error of every case and quantity with a reference, in the order of the cases."""
    charts = []
    for case in data["case"].values:
        of_case = data.sel(case=case)
        chosen = (data["scene"] == of_case["case_scene"]) & (data["model"] == of_case["case_model"])
        known = data["quantity"].values[np.isfinite(of_case["reference_error"].values)]
        runs = of_case.isel(run=np.flatnonzero(chosen))
        charts += [_error_chart(runs.sel(quantity=quantity)) for quantity in known]
    return charts


def _error_chart(data: xr.Dataset) -> Chart:
    """Error over price of one case and quantity."""
    floor, case = 100 * max(float(data["reference_error"]), 1e-14), str(data["case"].item())
    error, price = np.maximum(100 * data["numerical_error"].values, floor), data["cpu_per_second"].values
    finished, name = np.isfinite(error), str(data["quantity"].item())
    top = 10 * float(error[finished].max())
    left, right = price[finished].min() / 2, price[finished].max() * 2
    with drawing(5.6, 5.4) as (figure, axes):
        _frame(axes, f"{case.replace('_', ' ')}: {data['quantity_meaning'].item()}", "numerical error (%)")
        for method in dict.fromkeys(data["run_method"].values):
            mine = data["run_method"].values == method
            _line(axes, str(method), price[mine & finished], error[mine & finished])
        for kind in dict.fromkeys(data["outcome"].values[~finished]):
            failed = ~finished & (data["outcome"].values == kind) & np.isfinite(price)
            shown = np.clip(price[failed], 1.1 * left, right / 1.1)
            _crosses(axes, Outcome(int(kind)), data["run_method"].values[failed], shown, top)
        _mark(axes, data["front"].values == 1, price, error, "Pareto front")
        at = (data["is_default"].values == 1) & finished
        axes.plot(price[at], error[at], "o", ms=13, mfc="none", mec=INK, mew=1.4, label="default")
        axes.axhline(100 * float(data.attrs["target"]), color=MUTED, lw=0.8, ls=":")
        axes.axhspan(floor / 30, floor, color=MUTED, alpha=0.12, lw=0, label="below the reference's error")
        axes.set_xlim(left, right)
        axes.set_ylim(max(floor / 3, float(error[finished].min()) / 10), 3 * top)
        _legend(axes)
    caption = (
        f"Numerical error of the {data['quantity_meaning'].item()} over price, one line per method, coarse settings on "
        f"the left. Reference: {data['reference'].item()}; its own error is {floor:.2g} %. Crosses at the top: failed "
        "runs, with their price per second simulated until the failure, or at the end beyond which it lies. "
        "Dotted: error at which prices are compared."
    )
    table = pd.DataFrame(
        {
            "method": data["run_method"].values,
            data["setting_kind"].values[0] or "setting": data["setting"].values,
            "cpu_per_second": price,
            "error_percent": 100 * data["numerical_error"].values,
            "steps": data["steps"].values,
            "force_evaluations": data["force_evaluations"].values,
            "solves": data["solves"].values,
            "outcome": [Outcome(int(kind)).label for kind in data["outcome"].values],
        }
    )
    title = f"{capital(data['quantity_meaning'].item())}: error over price"
    return Chart(f"{case.replace(' ', '-')}-{name}", title, caption, figure, table)


def _frame(axes: Axes, title: str, label: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(_X_LABEL)
    axes.set_ylabel(label)
    if title:
        axes.figure.suptitle(title, x=0.02, ha="left", fontsize=9, fontweight="bold", color=INK)


def _legend(axes: Axes) -> None:
    """Three narrow columns above the axes: a dozen methods and the signs of failures need them."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.12, 1.0),
        ncols=3,
        fontsize=7,
        handlelength=2.2,
        columnspacing=1.0,
        alignment="left",
        borderaxespad=0.3,
    )


def _style(method: str) -> tuple[str, str, str]:
    """Colour, marker and line of a method, the same in every chart; SciPy's are dashed."""
    known = [*METHODS]
    at = known.index(method) if method in known else len(known)
    return COLOURS[at % len(COLOURS)], MARKERS[at % len(MARKERS)], "--" if method.startswith("scipy") else "-"


def _line(axes: Axes, method: str, price: np.ndarray, error: np.ndarray) -> None:
    colour, marker, line = _style(method)
    second = list(METHODS).index(method) >= len(COLOURS) if method in METHODS else False
    axes.plot(price, error, line, marker=marker, color=colour, mfc="white" if second else colour, lw=1.1, label=method)


def _crosses(axes: Axes, kind: Outcome, methods: np.ndarray, price: np.ndarray, top: float) -> None:
    """Failed runs at the top of the chart; the marker is the outcome, the colour the method."""
    sign = _CROSSES.get(kind, _OTHER)
    for method in dict.fromkeys(methods):
        mine = methods == method
        axes.plot(price[mine], np.full(mine.sum(), top), sign, color=_style(str(method))[0], ms=6, mew=1.3)
    axes.plot([], [], sign, color=MUTED, ms=6, mew=1.3, label=kind.label.replace("_", " "))


def _mark(axes: Axes, chosen: np.ndarray, price: np.ndarray, error: np.ndarray, label: str) -> None:
    """A broad line through the runs of the front."""
    order = np.argsort(price[chosen])
    axes.plot(price[chosen][order], error[chosen][order], color="#f2c14e", lw=6, alpha=0.55, zorder=0.5, label=label)


def model_error_charts(data: xr.Dataset, name: str = "") -> list[Chart]:
    """Difference of every finished run to the finest model, one chart per scene and quantity with several models."""
    charts = []
    for scene in dict.fromkeys(data["scene"].values):
        of_scene = data.isel(run=np.flatnonzero(data["scene"].values == scene))
        for quantity in data["quantity"].values:
            part = of_scene.sel(quantity=quantity)
            models = part["model"].values[np.isfinite(part["model_error"].values)]
            if np.unique(models).size > 1:
                charts.append(_model_chart(part, str(scene)))
    return charts


def _model_chart(data: xr.Dataset, scene: str) -> Chart:
    """Difference to the finest model over price, with all its methods."""
    cases = data.isel(case=np.flatnonzero(data["case_scene"].values == scene))
    floor = 100 * max(float(cases["reference_error"].values[-1]), 1e-14)
    error, price = np.maximum(100 * data["model_error"].values, floor), data["cpu_per_second"].values
    finest = str(cases["case_model"].values[-1])
    with drawing(5.6, 4.8) as (figure, axes):
        _frame(axes, f"{scene.replace('_', ' ')}: {data['quantity_meaning'].item()}", f"difference to {finest} (%)")
        for at, model in enumerate(dict.fromkeys(data["model"].values)):
            mine = (data["model"].values == model) & np.isfinite(error)
            axes.plot(price[mine], error[mine], MARKERS[at], color=COLOURS[at], label=model, alpha=0.8)
        _mark(axes, data["model_front"].values == 1, price, error, "Pareto front of all")
        default = (data["is_default"].values == 1) & np.isfinite(error)
        axes.plot(price[default], error[default], "o", ms=12, mfc="none", mec=INK, mew=1.4, ls="none", label="default")
        axes.axhspan(floor / 30, floor, color=MUTED, alpha=0.12, lw=0, label="below the reference's error")
        axes.set_ylim(bottom=floor / 3)
        _legend(axes)
    caption = (
        f"Model and numerical error together: difference of the {data['quantity_meaning'].item()} to the "
        f"finest model, {finest} ({cases['reference'].values[-1]}; own error {floor:.2g} %), over price. Points are "
        "all finished runs, with any method and setting."
    )
    names = ["model", "run_method", "setting", "cpu_per_second", "model_error"]
    title = f"Models: {data['quantity_meaning'].item()} over price"
    return Chart(f"{scene}-{data['quantity'].item()}", title, caption, figure, data[names].to_dataframe()[names])
