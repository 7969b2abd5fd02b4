"""Figures of an optimisation: the front, its candidates over all axes, the course of a search, waveforms."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.optimisation.candidate_text import unit_of, values_text
from tripod_doe.analyses.optimisation.pareto_front import knee
from tripod_doe.analyses.optimisation.problem import Problem
from tripod_doe.analyses.optimisation.result import Solved, best_so_far
from tripod_doe.analyses.optimisation.tables import dominated_count
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import count_of, number
from tripod_doe.page_parts.charts.chart import COLOURS, INK, LINES, MUTED, Chart, drawing, legend_above
from tripod_doe.page_parts.words import listed, with_brackets

_MOST_DRAWN = 1500  # dominated candidates of a figure
_MOST_LINES = 60  # candidates over parallel axes


def optimisation_charts(problem: Problem, solved: Solved, waves: xr.Dataset | None) -> list[Chart]:
    """All figures, the one that answers first."""
    charts: list[Chart] = []
    if len(problem.objectives) == 1:
        charts.append(_course(problem, solved))
    elif len(solved.front.units):
        names = list(problem.objectives)
        pairs = [(0, 1)] if len(names) == 2 else [(a, b) for a in range(len(names)) for b in range(a + 1, len(names))]
        charts += [_pair(problem, solved, a, b) for a, b in pairs]
    if len(solved.front.units) > 1:
        charts.append(_parallel(problem, solved))
    if waves is not None:
        charts += _waveforms(problem, waves)
    return charts


def _axis(problem: Problem, name: str) -> str:
    return with_brackets(name, unit_of(problem, problem.objectives[name].output))


def _course(problem: Problem, solved: Solved) -> Chart:
    """The best objective so far over the candidates."""
    (name,) = problem.objectives
    judged = solved.archive.judged
    best = best_so_far(solved.archive, float(problem.signs[0]))
    tried = np.arange(1, len(best) + 1)
    own = np.where(judged.feasible, judged.objectives[:, 0], np.nan)
    data = pd.DataFrame({"candidate": tried, "value": own, "best_so_far": best})
    with drawing(4.7, 3.0) as (figure, axes):
        axes.plot(tried, own, ".", color=MUTED, ms=2.5, alpha=0.5, label="feasible candidate")
        axes.step(tried, best, where="post", color=COLOURS[0], label="best so far")
        if np.isfinite(best).any():
            low, high = np.nanquantile(own, [0, 0.9])
            axes.set_ylim(low - 0.1 * (high - low or 1), high + 0.1 * (high - low or 1))
        axes.set_xlabel("candidates tried")
        axes.set_ylabel(_axis(problem, name))
        legend_above(axes, 2)
    caption = f"{name} of the feasible candidates in the order of the search; the highest tenth may lie outside."
    return Chart("course", "Course of the search", caption, figure, data)


def _pair(problem: Problem, solved: Solved, a: int, b: int) -> Chart:
    """Two objectives: the front, the candidates that it dominates, and the start."""
    names, judged = list(problem.objectives), solved.archive.judged
    rows = np.flatnonzero(judged.feasible)
    shown = rows[np.unique(np.linspace(0, rows.size - 1, _MOST_DRAWN).astype(int))] if rows.size > _MOST_DRAWN else rows
    front = solved.front.judged.objectives
    errors = solved.front.judged.objective_errors
    data = pd.DataFrame({"candidate": np.arange(len(front)), names[a]: front[:, a], names[b]: front[:, b]})
    middle = knee(front * problem.signs)
    with drawing(4.7, 3.4) as (figure, axes):
        axes.plot(
            judged.objectives[shown, a],
            judged.objectives[shown, b],
            ".",
            color=MUTED,
            ms=2.5,
            alpha=0.4,
            label="feasible",
        )
        order = np.argsort(front[:, a])
        style = "-" if len(names) == 2 else ""
        axes.plot(front[order, a], front[order, b], f"o{style}", color=COLOURS[0], ms=4, lw=1.0, label="front")
        _error_bars(axes, front, errors, a, b)
        axes.plot(front[middle, a], front[middle, b], "D", color=COLOURS[1], ms=7, label=f"knee (candidate {middle})")
        start = solved.start.objectives[0]
        if np.isfinite(start[[a, b]]).all():
            mark = "start" if solved.start.feasible[0] else "start (not feasible)"
            axes.plot(start[a], start[b], "s", color=COLOURS[2], ms=6, label=mark)
        _around_front(axes, np.vstack([front[:, [a, b]], start[None, [a, b]]]))
        axes.set_xlabel(_axis(problem, names[a]))
        axes.set_ylabel(_axis(problem, names[b]))
        legend_above(axes, 2)
    drawn = f", {_MOST_DRAWN:,} of them drawn" if rows.size > _MOST_DRAWN else ""
    feasible = count_of(rows.size, "candidate")
    by = f", by {problem.model}" if problem.confirm != problem.model else ""
    judged_by = f", by {problem.confirm}," if problem.confirm != problem.model else ""
    caption = (
        f"The front{judged_by} and the candidates of the search{by}: {feasible} feasible{drawn}, of which "
        f"others dominate {dominated_count(problem, solved):,}. Candidates far from the front may be outside "
        "of the axes."
    )
    return Chart(f"front-{names[a]}-{names[b]}", f"{names[a]} against {names[b]}", caption, figure, data)


def _error_bars(axes: Any, front: FloatArray, errors: FloatArray, a: int, b: int) -> None:
    if np.isfinite(errors[:, [a, b]]).any():
        x, y = (np.nan_to_num(errors[:, at]) for at in (a, b))
        axes.errorbar(front[:, a], front[:, b], xerr=x, yerr=y, fmt="none", ecolor=COLOURS[0], elinewidth=0.7)


def _around_front(axes: Any, values: FloatArray) -> None:
    """Limits that show the front and the start, and some of what lies around."""
    values = values[np.isfinite(values).all(axis=1)]
    low, high = values.min(axis=0), values.max(axis=0)
    wide = np.where(high > low, high - low, np.maximum(np.abs(high), 1e-12))
    axes.set_xlim(low[0] - 0.1 * wide[0], high[0] + 0.5 * wide[0])
    axes.set_ylim(low[1] - 0.1 * wide[1], high[1] + 0.5 * wide[1])


def _parallel(problem: Problem, solved: Solved) -> Chart:
    """Candidates of the front over variables and objectives, each axis from the smallest to the largest value."""
    front, names = solved.front, list(problem.objectives)
    middle = knee(front.judged.objectives * problem.signs)
    count, drawn = len(front.units), min(len(front.units), _MOST_LINES)
    rows = np.union1d(np.linspace(0, count - 1, drawn).round().astype(int), middle)
    columns = {
        name: column for name, column in problem.variables.columns(front.units).items() if column.dtype.kind in "fi"
    }
    table = pd.DataFrame(columns | {name: front.judged.objectives[:, at] for at, name in enumerate(names)})
    low, high, table = table.min(), table.max(), table.iloc[rows]
    places = (table - low) / (high - low).where(high > low, 1.0)
    places.loc[:, high == low] = 0.5
    first = places[names[0]].to_numpy()
    across = np.arange(len(table.columns))
    with drawing(max(6.2, 0.95 * len(across) + 1.5), 3.6) as (figure, axes):
        for at, (row, line) in enumerate(zip(rows.tolist(), places.to_numpy(), strict=True)):
            is_knee = row == middle
            axes.plot(
                across,
                line,
                color=COLOURS[1] if is_knee else COLOURS[0],
                lw=2.4 if is_knee else 0.9,
                alpha=1.0 if is_knee else 0.25 + 0.6 * (1 - first[at]),
                zorder=3 if is_knee else 2,
            )
        for at, name in enumerate(table.columns):
            axes.axvline(at, color=INK, lw=0.7)
            axes.annotate(number(float(high[name]), 3), (at, 1.04), ha="center", fontsize=7.5, annotation_clip=False)
            axes.annotate(number(float(low[name]), 3), (at, -0.1), ha="center", fontsize=7.5, annotation_clip=False)
        axes.set_ylim(-0.02, 1.02)
        axes.set_yticks([])
        axes.grid(False)
        axes.set_xticks(across, [str(name).replace("_", "\n") for name in table.columns], fontsize=7.5)
        axes.tick_params(axis="x", pad=14)
        for side in axes.spines.values():
            side.set_visible(False)
    some = f"{rows.size} of the {count:,} candidates" if rows.size < count else "Candidates"
    caption = (
        f"{some} of the front over their variables and {listed(names)}, each axis from the smallest to the largest "
        f"value on the front. Strong lines have a small {names[0]}; the thick one is the knee."
    )
    return Chart("parallel", "Candidates of the front", caption, figure, table.assign(candidate=rows))


def _waveforms(problem: Problem, waves: xr.Dataset) -> list[Chart]:
    """The thrust over the rotation angle where the start has the largest thrust, and its orders."""
    course = waves["thrust"]
    size = (course.max("rotation_deg") - course.min("rotation_deg")).isel(joint=0).values
    if not np.isfinite(size).any():
        size = (course.max("rotation_deg") - course.min("rotation_deg")).max("joint").values
    if not np.isfinite(size).any():
        return []
    place = int(np.nanargmax(size))
    own = waves.isel(place=place)
    at = problem.operating.values[place]
    where = values_text(problem, at)
    angle = own["rotation_deg"].values
    once = angle < 360
    data = pd.DataFrame({"rotation_deg": angle[once]})
    spectrum = pd.DataFrame({"order": own["order"].values})
    names = [str(name) for name in own["joint"].values]
    for which, name in enumerate(names):
        data[name] = own["thrust"].values[which][once]
        spectrum[name] = own["thrust_amplitude"].values[which]
    with drawing(4.7, 3.0) as (figure, axes):
        for which, name in enumerate(names):
            axes.plot(data["rotation_deg"], data[name], ls=LINES[which % len(LINES)], color=_colour(which), label=name)
        axes.set_xlim(0, 360)
        axes.set_xticks(range(0, 361, 90))
        axes.set_xlabel("rotation angle of the housing (deg)")
        axes.set_ylabel("thrust force (N)")
        legend_above(axes, 3)
    with drawing(4.7, 3.0) as (bars, other):
        width = 0.8 / len(names)
        for which, name in enumerate(names):
            other.bar(
                spectrum["order"] + (which - len(names) / 2 + 0.5) * width,
                spectrum[name],
                width,
                color=_colour(which),
                label=name,
            )
        other.set_xticks(range(0, 13))
        other.set_xlabel("rotating order")
        other.set_ylabel("amplitude (N)")
        legend_above(other, 3)
    text = f"At {where}, by {problem.model}." if where else f"By {problem.model}."
    return [
        Chart("waveforms", "Thrust force of start and best", text, figure, data),
        Chart("orders", "Orders of start and best", text, bars, spectrum),
    ]


def _colour(which: int) -> str:
    return MUTED if which == 0 else COLOURS[(which - 1) % len(COLOURS)]
