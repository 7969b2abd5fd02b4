"""Figures of the paper without a general chart: friction law, cases, orders at the grooves, orders over the angle."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.number_text import level, level_or_word, number, with_unit
from tripod_doe.page_parts.charts.chart import COLOURS, HATCHES, INK, LINES, MUTED, Chart, drawing, legend_above, series
from tripod_doe.page_parts.main_results import factor_names, finished
from tripod_doe.page_parts.words import ORDINALS, factor_label

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes

_MOST = 6
_FLOOR = 1e-4  # bars of a spectrum end at this part of the largest one
_QUARTER = 0.25  # transition velocity over the largest sliding velocity, paper 3.1
_BEAT = (2, 3, 4)  # the third order and its neighbours, whose sum beats once a revolution (paper 3.3)
SKEWS = [f"initial_skew_{k}_deg" for k in (1, 2, 3)]
"""Parameters that hold the initial skews of the three trunnions."""


def first_points(cube: xr.Dataset) -> list[xr.Dataset]:
    """The finished points, the first six."""
    dims = [str(dim) for dim in cube["outcome"].dims]
    at = np.argwhere(finished(cube).values)[:_MOST]
    return [cube.isel({dim: int(i) for dim, i in zip(dims, index, strict=True)}) for index in at]


def point_label(cube: xr.Dataset, point: xr.Dataset) -> str:
    """The factors of a point that vary, as text; the skews of the three trunnions count as one factor."""
    names = [name for name in factor_names(cube) if np.unique(cube[name].values).size > 1]
    text = []
    if skews := [point[name].item() for name in names if name in SKEWS]:
        text.append(f"skew {', '.join(level(skew) for skew in skews)} deg")
    text += [f"{factor_label(cube, name)} {level_or_word(point[name].item())}" for name in names if name not in SKEWS]
    return "; ".join(text)


def _order_wave(size: np.ndarray, phase_deg: np.ndarray, orders: tuple[int, ...], angle: np.ndarray) -> np.ndarray:
    """Complex wave of some orders over the rotation angle."""
    turn = np.exp(1j * np.radians(np.asarray(phase_deg) + np.outer(angle, orders)))
    return np.asarray(turn @ np.asarray(size))


def waveforms_of_all(cube: xr.Dataset) -> list[Chart]:
    """Thrust of every point, its part in each groove, and the envelope of the beat: Figs. 10, 15, 18, 20."""
    if "thrust" not in cube or "thrust_phase_deg" not in cube:
        return []
    points = first_points(cube)
    top = 1.1 * max((float(np.abs(point["thrust"]).max()) for point in points), default=1.0)
    charts = []
    for rank, point in enumerate(points):
        angle = point["rotation_deg"].values
        beat = point.sel(order=list(_BEAT))
        envelope = np.abs(_order_wave(beat["thrust_amplitude"].values, beat["thrust_phase_deg"].values, _BEAT, angle))
        data = pd.DataFrame({"rotation_deg": angle, "thrust_n": point["thrust"].values, "envelope_n": envelope})
        for groove in point["groove"].values:
            data[f"groove_{groove}_thrust_n"] = point["groove_thrust"].sel(groove=groove).values
        with drawing(3.5, 3.1) as (figure, axes):
            for groove in (1, 2, 3):
                axes.plot(
                    angle,
                    data[f"groove_{groove}_thrust_n"],
                    LINES[groove],
                    color=COLOURS[groove],
                    lw=0.9,
                    label=f"groove {groove}",
                )
            axes.plot(angle, data["thrust_n"], color=INK, lw=2, label="sum")
            axes.plot(angle, envelope, color=COLOURS[0], lw=0.9, label="envelope")
            axes.set_ylim(-top, top)
            _over_rotation(axes, 720, 180, 2)
        sizes = point["thrust_amplitude"].values
        caption = (
            f"Thrust force, {point_label(cube, point)}: third order {number(float(sizes[3]))} N, second "
            f"{number(float(sizes[2]))} N. Envelope of the orders 2, 3 and 4."
        )
        charts.append(Chart(f"point-{rank + 1}", f"Thrust force, {point_label(cube, point)}", caption, figure, data))
    return charts


def _over_rotation(axes: Axes, end: int, step: int, columns: int) -> None:
    axes.set_xlim(0, end)
    axes.set_xticks(range(0, end + 1, step))
    axes.set_xlabel("rotation angle of the housing (deg)")
    axes.set_ylabel("thrust force (N)")
    legend_above(axes, columns)


def local_order_charts(cube: xr.Dataset) -> list[Chart]:
    """Orders at the grooves and in the sum: the paper's Figs. 16 and 17.

    First the orders 1, 2 and 3 of the point whose skews differ most, then the second order of all others with skew.
    """
    if "groove_thrust_phase_deg" not in cube or any(name not in cube.coords for name in SKEWS):
        return []
    points = dict(enumerate(first_points(cube)))
    skews = {rank: tuple(float(point[name]) for name in SKEWS) for rank, point in points.items()}
    if not points:
        return []
    uneven = max(points, key=lambda rank: round(float(np.ptp(skews[rank])), 9))
    others = [rank for rank in points if rank != uneven and any(skews[rank])]
    wanted = [(uneven, order) for order in (1, 2, 3) if any(skews[uneven])] + [(rank, 2) for rank in others]
    return [_local_chart(cube, points[rank], order, rank) for rank, order in wanted]


def _local_chart(cube: xr.Dataset, point: xr.Dataset, order: int, rank: int) -> Chart:
    angle = np.arange(0.0, 361.0, 2.0)
    data = pd.DataFrame({"rotation_deg": angle})
    part = point.sel(order=[order])
    with drawing(3.5, 2.6) as (figure, axes):
        for groove in (1, 2, 3):
            local = part.sel(groove=groove)
            wave = _order_wave(
                local["groove_thrust_amplitude"].values, local["groove_thrust_phase_deg"].values, (order,), angle
            )
            data[f"groove_{groove}_n"] = wave.real
            axes.plot(angle, wave.real, LINES[groove], color=COLOURS[groove], lw=1.1, label=f"groove {groove}")
        whole = _order_wave(part["thrust_amplitude"].values, part["thrust_phase_deg"].values, (order,), angle)
        data["sum_n"] = whole.real
        axes.plot(angle, whole.real, color=INK, lw=2, label="sum")
        _over_rotation(axes, 360, 90, 2)
    caption = f"{ORDINALS[order].capitalize()} at each groove and in the sum, {point_label(cube, point)}."
    title = f"{ORDINALS[order].capitalize()} at each groove"
    return Chart(f"order-{order}-point-{rank + 1}", title, caption, figure, data)


def spectrum_of_all(cube: xr.Dataset) -> Chart | None:
    """Amplitudes of the rotating orders of every point on a logarithmic axis: the paper's Fig. 13."""
    points = first_points(cube) if "thrust_amplitude" in cube else []
    if not points:
        return None
    orders = cube["order"].values
    data, width = pd.DataFrame({"order": orders}), 0.84 / len(points)
    with drawing(5.4, 3.2) as (figure, axes):
        for rank, point in enumerate(points):
            data[f"amplitude_n_{rank + 1}"] = point["thrust_amplitude"].values
            axes.bar(
                orders + (rank - (len(points) - 1) / 2) * width,
                point["thrust_amplitude"],
                width,
                label=point_label(cube, point),
                color=COLOURS[rank],
                hatch=HATCHES[rank % len(HATCHES)],
                edgecolor="white",
                lw=0.4,
            )
        largest = float(data.iloc[:, 1:].to_numpy().max())
        axes.set_yscale("log")
        axes.set_ylim(_FLOOR * largest, 2 * largest)
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xticks(orders)
        axes.grid(axis="x", visible=False)
        axes.set_xlabel("rotating order (-)")
        axes.set_ylabel("amplitude of the thrust force (N)")
        legend_above(axes, 2)
    text = "; ".join(
        f"{point_label(cube, point)}: second {_newton(point, 2)}, fourth {_newton(point, 4)}" for point in points
    )
    caption = (
        f"Amplitudes of the rotating orders at each point; the logarithmic axis starts at {_FLOOR:g} times the "
        f"largest. Orders of the beat: {text}."
    )
    return Chart("spectrum", "Orders at each point", caption, figure, data)


def _newton(point: xr.Dataset, order: int) -> str:
    return f"{number(float(point['thrust_amplitude'].sel(order=order)))} N"


def friction_law_chart(cube: xr.Dataset) -> Chart | None:
    """Sliding friction coefficient at a tilted roller over sliding velocity: the paper's Fig. 4."""
    if "axial_force_n" not in cube or cube["outcome"].dims != ("transition_ratio",):
        return None
    fixed = json.loads(str(cube.attrs["fixed_parameters"]))
    velocity = 1 / cube["transition_ratio"].values
    normal = fixed["load_n"] * abs(np.sin(np.radians(fixed["tilt_deg"])))
    data = pd.DataFrame({"velocity_over_v_st": velocity, "coefficient": cube["axial_force_n"].values / normal})
    data["law"] = fixed["friction"] * np.tanh(velocity)
    fine = np.linspace(0, velocity.max(), 200)
    with drawing(4.6, 3.0) as (figure, axes):
        axes.plot(
            fine, fixed["friction"] * np.tanh(fine), color=COLOURS[0], label="\N{GREEK SMALL LETTER MU} tanh(v / v_st)"
        )
        axes.plot(velocity, data["coefficient"], "o", color=COLOURS[1], mfc="white", label="roller in its groove")
        axes.axvline(1 / _QUARTER, color=MUTED, lw=0.9, ls="--", label="largest slip of a run")
        axes.set_xlabel("sliding velocity over transition velocity (-)")
        axes.set_ylabel("sliding friction coefficient (-)")
        axes.set_ylim(0, None)
        legend_above(axes, 2)
    off = float((data["coefficient"] - data["law"]).abs().max())
    caption = (
        "Sliding friction coefficient over sliding velocity: axial force of a tilted roller divided by its load and "
        f"the sine of its tilt, and the friction law; largest difference {off:.1g}. Dashed: largest velocity of a run "
        "if the transition velocity is a quarter of it, as in the paper."
    )
    return Chart("friction-law", "Friction law", caption, figure, data)


def order_angle_chart(cube: xr.Dataset) -> Chart | None:
    """Effective values of the orders 2 and 3 over the joint angle, one line per case of skew: the paper's Fig. 14."""
    if "thrust_rms" not in cube or "joint_angle_deg" not in cube.coords or cube["outcome"].dims != ("point",):
        return None
    labels = [point_label(cube.drop_vars("joint_angle_deg"), cube.isel(point=at)) for at in range(cube.sizes["point"])]
    rows = []
    with drawing(4.7, 3.2) as (figure, axes):
        for which, label in enumerate(dict.fromkeys(labels)):
            part = cube.isel(point=[at for at, own in enumerate(labels) if own == label]).sortby("joint_angle_deg")
            for order in (3, 2):
                effective = part["thrust_rms"].sel(order=order).values
                style = series(which) | {"color": COLOURS[3 - order]}
                axes.plot(part["joint_angle_deg"], effective, mfc="white", label=f"{ORDINALS[order]}, {label}", **style)
                rows += [
                    (angle, label, order, value)
                    for angle, value in zip(part["joint_angle_deg"].values, effective, strict=True)
                ]
        axes.set_yscale("log")  # the orders differ by a factor of a hundred
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel(with_unit("joint angle", "(deg)"))
        axes.set_ylabel("effective value of the thrust force (N)")
        legend_above(axes, 1)
    caption = (
        "Effective values of the second and third order over the joint angle, one line per case of skew; "
        "logarithmic axis."
    )
    data = pd.DataFrame(rows, columns=["joint_angle_deg", "case", "order", "rms_n"])
    return Chart("angle", "Orders over the joint angle", caption, figure, data)
