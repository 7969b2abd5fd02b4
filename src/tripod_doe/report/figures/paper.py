"""Figures of the paper that no general chart shows: the cases, their local orders, the skew, orders over the angle."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from tripod_doe.report.figures.chart import COLOURS, HATCHES, INK, LINES, MARKERS, Chart, drawing, legend_above
from tripod_doe.report.responses import ORDINALS, factor_label, factor_names, finished, number, with_unit

__all__ = ["local_order_charts", "order_angle_chart", "point_label", "skew_chart", "waveforms_of_all"]

_MOST = 6
_BEAT = (2, 3, 4)  # the third order and its neighbours, whose sum beats once a revolution (paper 3.3)
_SKEWS = [f"initial_skew_{k}_deg" for k in (1, 2, 3)]


def _points(cube: xr.Dataset) -> list[xr.Dataset]:
    """The finished points, the first six."""
    dims = [str(dim) for dim in cube["outcome"].dims]
    at = np.argwhere(finished(cube).values)[:_MOST]
    return [cube.isel({dim: int(i) for dim, i in zip(dims, index, strict=True)}) for index in at]


def point_label(cube: xr.Dataset, point: xr.Dataset) -> str:
    """The factors that vary, the skews of the three trunnions as one."""
    names = [name for name in factor_names(cube) if np.unique(cube[name].values).size > 1]
    told = []
    if skews := [point[name].item() for name in names if name in _SKEWS]:
        told.append(f"skew {', '.join(number(skew) for skew in skews)} deg")
    told += [f"{factor_label(cube, name)} {_level(point[name].item())}" for name in names if name not in _SKEWS]
    return "; ".join(told)


def _level(value: object) -> str:
    return number(value) if isinstance(value, int | float) else str(value)


def _order_wave(size: np.ndarray, phase_deg: np.ndarray, orders: tuple[int, ...], angle: np.ndarray) -> np.ndarray:
    """Complex wave of some orders over the rotation angle."""
    turn = np.exp(1j * np.radians(np.asarray(phase_deg) + np.outer(angle, orders)))
    return np.asarray(turn @ np.asarray(size))


def waveforms_of_all(cube: xr.Dataset) -> list[Chart]:
    """Thrust of every point, its part in each groove, and the envelope of the beat: Figs. 10, 15, 18, 20."""
    if "thrust" not in cube or "thrust_phase_deg" not in cube:
        return []
    points = _points(cube)
    top = 1.1 * max((float(np.abs(point["thrust"]).max()) for point in points), default=1.0)
    charts = []
    for rank, point in enumerate(points):
        angle = point["rotation_deg"].values
        beat = point.sel(order=list(_BEAT))
        envelope = np.abs(_order_wave(beat["thrust_amplitude"].values, beat["thrust_phase_deg"].values, _BEAT, angle))
        data = pd.DataFrame({"rotation_deg": angle, "thrust_n": point["thrust"].values, "envelope_n": envelope})
        for groove in point["groove"].values:
            data[f"groove_{groove}_thrust_n"] = point["groove_thrust"].sel(groove=groove).values
        with drawing(3.5, 2.9) as (figure, axes):
            for groove in (1, 2, 3):
                axes.plot(angle, data[f"groove_{groove}_thrust_n"], LINES[groove], color=COLOURS[groove], lw=0.9,
                          label=f"groove {groove}")  # fmt: skip
            axes.plot(angle, data["thrust_n"], color=INK, lw=2, label="sum")
            axes.plot(angle, envelope, color=COLOURS[0], lw=0.9, label="envelope")
            axes.set_ylim(-top, top)
            _over_rotation(axes, 720, 180)
        sizes = point["thrust_amplitude"].values
        caption = (
            f"Thrust force, {point_label(cube, point)}: third order {number(round(float(sizes[3]), 3))} N, second "
            f"{number(round(float(sizes[2]), 3))} N; the envelope is that of the orders 2, 3 and 4."
        )
        charts.append(Chart(f"point-{rank + 1}", caption, figure, data))
    return charts


def _over_rotation(axes: Axes, end: int, step: int) -> None:
    axes.set_xlim(0, end)
    axes.set_xticks(range(0, end + 1, step))
    axes.set_xlabel("rotation angle of the housing (deg)")
    axes.set_ylabel("thrust force (N)")
    legend_above(axes, 3)


def local_order_charts(cube: xr.Dataset) -> list[Chart]:
    """Orders 1, 2 and 3 at the grooves and in the sum, for uneven and for equal skews: the paper's Figs. 16 and 17."""
    if "groove_thrust_phase_deg" not in cube or any(name not in cube.coords for name in _SKEWS):
        return []
    charts = []
    for rank, point in enumerate(_points(cube)):
        skews = np.array([float(point[name]) for name in _SKEWS])
        charts += [_local_chart(cube, point, order, rank) for order in (1, 2, 3) if skews.any() and (
            order == 2 or _most_uneven(cube) == tuple(skews))]  # fmt: skip
    return charts


def _most_uneven(cube: xr.Dataset) -> tuple[float, ...]:
    """Skews of the first finished point whose trunnions differ most: the paper's case 2."""
    rows = [tuple(float(point[name]) for name in _SKEWS) for point in _points(cube)]
    return max(rows, key=lambda row: round(float(np.ptp(row)), 9))


def _local_chart(cube: xr.Dataset, point: xr.Dataset, order: int, rank: int) -> Chart:
    angle = np.arange(0.0, 361.0, 2.0)
    data = pd.DataFrame({"rotation_deg": angle})
    part = point.sel(order=[order])
    with drawing(3.5, 2.6) as (figure, axes):
        for groove in (1, 2, 3):
            local = part.sel(groove=groove)
            wave = _order_wave(
                local["groove_thrust_amplitude"].values, local["groove_thrust_phase_deg"].values, (order,), angle
            )  # fmt: skip
            data[f"groove_{groove}_n"] = wave.real
            axes.plot(angle, wave.real, LINES[groove], color=COLOURS[groove], lw=1.1, label=f"groove {groove}")
        whole = _order_wave(part["thrust_amplitude"].values, part["thrust_phase_deg"].values, (order,), angle)
        data["sum_n"] = whole.real
        axes.plot(angle, whole.real, color=INK, lw=2, label="sum")
        _over_rotation(axes, 360, 90)
    caption = f"{ORDINALS[order].capitalize()} at each groove and in the sum, {point_label(cube, point)}."
    return Chart(f"order-{order}-point-{rank + 1}", caption, figure, data)


def order_angle_chart(cube: xr.Dataset) -> Chart | None:
    """Effective values of the orders 2 and 3 over the joint angle, a line a case of skew: the paper's Fig. 14."""
    if "thrust_rms" not in cube or "joint_angle_deg" not in cube.coords or cube["outcome"].dims != ("point",):
        return None
    labels = [point_label(cube.drop_vars("joint_angle_deg"), cube.isel(point=at)) for at in range(cube.sizes["point"])]
    rows = []
    with drawing(4.7, 3.2) as (figure, axes):
        for which, label in enumerate(dict.fromkeys(labels)):
            part = cube.isel(point=[at for at, own in enumerate(labels) if own == label]).sortby("joint_angle_deg")
            for order in (3, 2):
                effective = part["thrust_rms"].sel(order=order).values
                axes.plot(
                    part["joint_angle_deg"], effective, ls=LINES[which], marker=MARKERS[which], mfc="white",
                    color=COLOURS[3 - order], label=f"{ORDINALS[order]}, {label}",
                )  # fmt: skip
                rows += [(angle, label, order, value)
                         for angle, value in zip(part["joint_angle_deg"].values, effective, strict=True)]  # fmt: skip
        axes.set_yscale("log")  # the orders differ by a hundred
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlabel(with_unit("joint angle", "(deg)"))
        axes.set_ylabel("effective value of the thrust force (N)")
        legend_above(axes, 1)
    caption = "Effective values of the second and third order over the joint angle, a line a case of skew; logarithmic."
    return Chart("angle", caption, figure, pd.DataFrame(rows, columns=["joint_angle_deg", "case", "order", "rms_n"]))


def skew_chart(cube: xr.Dataset) -> Chart | None:
    """Initial skew beside mean, least and greatest of the fourth revolution, each trunnion: the paper's Fig. 11."""
    if "needle_skew_summary_deg" not in cube or any(name not in cube.coords for name in _SKEWS):
        return None
    points = _points(cube)
    rows = []
    with drawing(4.7, 3.0) as (figure, axes):
        for at, point in enumerate(points):
            summary = point["needle_skew_summary_deg"].isel(cycle=-1)
            mean, least, most = (summary.sel(statistic=name).values for name in ("mean", "min", "max"))
            start = np.array([float(point[name]) for name in _SKEWS])
            for k in range(3):
                x = at + 0.26 * (k - 1)
                axes.bar(x, mean[k], 0.22, color="#b9d0e8", edgecolor=COLOURS[0], hatch=HATCHES[k], lw=0.8,
                         label=f"trunnion {k + 1}" if at == 0 else None)  # fmt: skip
                axes.vlines(x, least[k], most[k], color=INK, lw=1.2)
                axes.plot(x, start[k], MARKERS[3], color=COLOURS[1], label="initial" if at == k == 0 else None)
                rows.append((at + 1, k + 1, start[k], mean[k], least[k], most[k]))
        axes.axhline(0, color=INK, lw=0.8)
        axes.set_xticks(range(len(points)), ["\n".join(number(float(p[name])) for name in _SKEWS) for p in points])
        axes.grid(axis="x", visible=False)
        axes.set_xlabel("initial skew on trunnions 1, 2, 3 (deg)")
        axes.set_ylabel("skew in the last revolution (deg)")
        legend_above(axes, 2)
    caption = (
        "Skew of the needle that carries the most: mean (bars), least and greatest (lines) of the last revolution, and "
        "initial value (diamonds)."
    )
    columns = ["point", "trunnion", "initial_deg", "mean_deg", "least_deg", "greatest_deg"]
    return Chart("skew", caption, figure, pd.DataFrame(rows, columns=columns))
