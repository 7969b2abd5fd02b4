"""Labels of logarithmic axes as plain text, so that matplotlib reads no text of a chart as a formula.

Charts show names, units and words of a study unchanged; matplotlib would read two dollar signs as a formula, and
drawing would end with a syntax error.
"""

import re
from collections.abc import Sequence

from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, LogFormatterMathtext

_RAISED = str.maketrans("-\N{MINUS SIGN}.0123456789", "⁻⁻·⁰¹²³⁴⁵⁶⁷⁸⁹")


class PlainPowers(Formatter):
    """The labels of a logarithmic axis with raised digits in place of matplotlib's formulas."""

    def __init__(self, own: Formatter) -> None:
        self._own = own

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of a tick."""
        text = self._own(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$").replace(r"\times", "×")
        return re.sub(r"\^\{([^}]*)\}", lambda match: match[1].translate(_RAISED), text)

    def set_axis(self, axis: Axis | None) -> None:  # type: ignore[override]
        """Know the axis."""
        super().set_axis(axis)
        self._own.set_axis(axis)

    def set_locs(self, locs: Sequence[float]) -> None:
        """Know all ticks: only some of the small ones get a label."""
        super().set_locs(locs)  # type: ignore[arg-type]
        self._own.set_locs(locs)  # type: ignore[arg-type]


def write_powers_plainly(figure: Figure) -> None:
    """Give all logarithmic axes of a figure labels of plain text."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(large := axis.get_major_formatter(), LogFormatterMathtext):
                axis.set_major_formatter(PlainPowers(large))
            if isinstance(small := axis.get_minor_formatter(), LogFormatterMathtext):
                axis.set_minor_formatter(PlainPowers(small))
