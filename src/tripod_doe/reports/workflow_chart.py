"""Diagram of a workflow: its steps from left to right, their inputs and their states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd

from tripod_doe.page_parts.charts.chart import INK, MUTED, Chart, drawing
from tripod_doe.quantities import duration

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes

_GROUNDS = {
    "finished": "#cfe6d8",
    "reused": "#e6edf5",
    "failed": "#f6c9bd",
    "blocked": "#fff4e0",
    "not selected": "#ffffff",
}
_WIDTH, _HEIGHT, _ACROSS, _DOWN = 1.7, 0.62, 2.25, 0.9  # inches: of a box, and from box to box


@dataclass(frozen=True)
class StepView:
    """A step as the diagram and the table of a page show it."""

    # name, kind: its name, and its kind of step
    name: str
    kind: str
    inputs: tuple[str, ...]  # names of the steps that it needs
    # ``finished`` (run now), ``reused`` (finished before), ``failed``, ``blocked`` (needs a failed step) or ``not
    # selected``
    state: str
    seconds: float | None = None  # wall time in s of the run that finished it; None if it did not finish
    detail: str = ""  # reason of a failure, or the kind of its result
    link: str = ""  # its report or files, relative to the page; empty if there are none


def step_time(step: StepView) -> str:
    """Wall time of a step as text with its unit, empty if it has none."""
    if step.seconds is None:
        return ""
    return duration(step.seconds)


def chain_chart(steps: Sequence[StepView]) -> Chart:
    """Draw the steps as boxes in columns, each to the right of its inputs, with state and time."""
    place = _places(steps)
    columns, rows = (1 + max(at[axis] for at in place.values()) for axis in (0, 1))
    with drawing(0.25 + _ACROSS * columns, 0.3 + _DOWN * rows) as (figure, axes):
        axes.set_axis_off()
        axes.set_xlim(-0.1, _ACROSS * columns - 0.4)
        axes.set_ylim(-_DOWN * rows + 0.15, 0.1)
        for start, end in _arrows(steps):
            _draw_arrow(axes, place[start], place[end])
        for step in steps:
            _draw_box(axes, step, place[step.name])
    failed = [step.name for step in steps if step.state == "failed"]
    caption = (
        "Steps with their state and wall time, each to the right of its inputs; arrows that follow from others are "
        "left out"
    )
    caption += f". Failed: {', '.join(failed)}." if failed else "."
    data = pd.DataFrame(
        {
            "step": [step.name for step in steps],
            "kind": [step.kind for step in steps],
            "inputs": [" ".join(step.inputs) for step in steps],
            "state": [step.state for step in steps],
            "seconds": [step.seconds for step in steps],
        }
    )
    return Chart("chain", "Steps of the workflow", caption, figure, data)


def _places(steps: Sequence[StepView]) -> dict[str, tuple[int, int]]:
    """Column (length of the longest path from a first step) and row of each step: beside its last input, or below.

    So a chain is a straight line, and no arrow crosses another step's box.
    """
    place: dict[str, tuple[int, int]] = {}
    for step in steps:
        column, row = max((place[needed] for needed in step.inputs), default=(-1, 0), key=lambda at: at[0])
        column += 1
        while (column, row) in place.values():
            row += 1
        place[step.name] = (column, row)
    return place


def _arrows(steps: Sequence[StepView]) -> list[tuple[str, str]]:
    """Dependencies between steps without the redundant ones: no arrow where a longer path exists."""
    ways: dict[str, set[str]] = {}  # all steps that a step needs, directly or not
    for step in steps:
        ways[step.name] = set(step.inputs).union(*(ways[needed] for needed in step.inputs))
    return [
        (needed, step.name)
        for step in steps
        for needed in step.inputs
        if not any(needed in ways[other] for other in step.inputs)
    ]


def _corner(place: tuple[int, int]) -> tuple[float, float]:
    return _ACROSS * place[0], -_DOWN * place[1] - _HEIGHT


def _draw_arrow(axes: Axes, start: tuple[int, int], end: tuple[int, int]) -> None:
    (x0, y0), (x1, y1) = _corner(start), _corner(end)
    axes.annotate(
        "",
        (x1 - 0.04, y1 + _HEIGHT / 2),
        (x0 + _WIDTH + 0.04, y0 + _HEIGHT / 2),
        arrowprops={"arrowstyle": "-|>", "color": MUTED, "lw": 1.1, "shrinkA": 0, "shrinkB": 0},
        zorder=0.5,
    )


def _draw_box(axes: Axes, step: StepView, place: tuple[int, int]) -> None:
    from matplotlib.patches import FancyBboxPatch

    x, y = _corner(place)
    dashed = "--" if step.state in ("blocked", "not selected") else "-"
    axes.add_patch(
        FancyBboxPatch(
            (x, y),
            _WIDTH,
            _HEIGHT,
            boxstyle="round,pad=0,rounding_size=0.07",
            facecolor=_GROUNDS[step.state],
            edgecolor=INK,
            lw=0.9,
            ls=dashed,
        )
    )
    name = step.name if len(step.name) <= 22 else step.name[:21] + "\N{HORIZONTAL ELLIPSIS}"
    axes.text(x + 0.09, y + 0.42, name, fontsize=8.5, fontweight="bold", color=INK, va="center")
    text = " · ".join(part for part in (step.kind, step.state, step_time(step)) if part)
    axes.text(x + 0.09, y + 0.18, text, fontsize=7, color=INK, va="center")
