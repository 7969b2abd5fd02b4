"""The page that helps to choose, in Markdown: which model and method for which question, and where each breaks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import xarray as xr

from tripod_doe.analysis.stability import RunKind
from tripod_doe.joint.models import MODELS
from tripod_doe.report.responses import number
from tripod_doe.report.speed_accuracy import find_in_speed_accuracy, price_table
from tripod_doe.report.stability import border_text, measured_border
from tripod_doe.simulator import Outcome

__all__ = ["choosing_page"]

_ALLOWED = (0.1, 0.03, 0.01, 0.005)
_JOINT = "joint"

_START = """\
# Choosing a model and a method

Made from result cubes by `python docs/choosing.py`, which tells how; do not edit. Prices are CPU seconds per simulated
second of one core with all checks of a run. A run of four revolutions at 600 rpm is 0.4 s. Ratios travel between
machines, seconds do not.
"""

_PILOT = """
These errors are those of one operating point. Where the question spans many, let a pilot measure them there:
`model = "auto"` with `[accuracy]` (README).
"""


_VIBRATING = """
At low torque and low speed, the more so the higher the friction in the grooves, the joint vibrates by itself, which
every affordable step damps away (`joint/vibration.py`). `rollers` and `needles` refuse points where the vibration
would take more than 5 % of the third order; of others that vibrate they say so in `outcome_detail`. `kinetostatic`
answers for the motion without vibration.
"""


def choosing_page(accuracy: xr.Dataset, borders: Mapping[str, xr.Dataset]) -> str:
    """Write the page.

    Parameters
    ----------
    accuracy
        Analysis of kind speed-accuracy, with the scene ``joint`` among its cases.
    borders
        Analyses of kind stability by the name of their study.

    Returns
    -------
    str
        Markdown.
    """
    parts = [
        _START,
        "## Which model\n\nThe cheapest run that comes within the allowed error of the finest model, and how many "
        "times cheaper it is than `needles` at its default:\n",
        _table(["Asked", "Within", "Model", "Method and setting", "Off by", "Price", "Cheaper by"],
               _choices(accuracy.sel(run=accuracy["scene"] == _JOINT))),
        _PILOT,
        "Outputs that a model lacks, and parameters that it ignores:\n",
        _table(["Model", "Has no", "Ignores"], [_blind_spots(name) for name in MODELS]),
        _VIBRATING,
        "\n## Which method\n\nA study that names none takes the default. Price at "
        f"{100 * float(accuracy.attrs['target']):g} % error of each scene's first quantity:\n",
        _table(*price_table(accuracy)),
        "\n## Where each breaks\n\nLargest step or tolerance up to which every run is right, in the base case of each "
        "study; what theory says; and what became of all runs beyond, over all that the study varies:\n",
        _table(["Study", "Method", "Right up to", "Predicted", "Rejected", "Wrong, undetected"],
               [row for name, data in borders.items() for row in _breaks(name, data)]),
        "\nWhat the runs above showed besides:\n",
        *(f"- {sentence}\n" for sentence in find_in_speed_accuracy(accuracy)[1:]),
    ]  # fmt: skip
    return "\n".join(part.rstrip("\n") if part.startswith("- ") else part for part in parts) + "\n"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _choices(runs: xr.Dataset) -> list[list[str]]:
    """A row a quantity of the joint and allowed error."""
    price = runs["cpu_per_second"].values
    default = (runs["is_default"].values == 1) & (runs["model"].values == "needles")
    of_default = float(price[default][0]) if default.any() else np.nan
    rows = []
    for quantity in runs["quantity"].values:
        part = runs.sel(quantity=quantity)
        # an error of the method that cancels one of the model is no merit
        error = np.fmax(part["model_error"].values, part["numerical_error"].values)
        good = (part["outcome"].values == Outcome.FINISHED) & np.isfinite(error)
        known_to = float(error[good].min()) if good.any() else np.nan
        for allowed in _ALLOWED if good.any() else ():
            found = np.flatnonzero(good & (error <= allowed))
            start = [str(part["quantity_meaning"].item()), f"{100 * allowed:g} %"]
            if not found.size:
                rows.append([*start, "–", "–", f"{100 * known_to:.2g} % at best", "–", "–"])
                continue
            at = found[np.argmin(price[found])]
            kind = "step" if part["setting_kind"].values[at] == "step_s" else "tolerance"
            rows.append([
                *start, str(part["model"].values[at]), f"{part['run_method'].values[at]}, {kind} "
                f"{float(part['setting'].values[at]):g}", f"{100 * error[at]:.2g} %", number(float(f"{price[at]:.3g}")),
                f"{of_default / price[at]:.3g}",
            ])  # fmt: skip
    return rows


def _blind_spots(name: str) -> list[str]:
    model, every = MODELS[name], set().union(*(other.outputs for other in MODELS.values()))
    missing, ignored = (", ".join(f"`{part}`" for part in sorted(parts)) or "–"
                        for parts in (every - model.outputs, model.ignores))  # fmt: skip
    return [name, missing, ignored]


def _breaks(name: str, borders: xr.Dataset) -> list[list[str]]:
    """A row a method of one study."""
    base, kind = borders.isel(case=0), borders["run_kind"].values
    counted = {which: (kind == which).sum(axis=(1, 2)) for which in (RunKind.REFUSED, RunKind.WRONG)}
    return [
        [
            name.replace("_", " "), str(method), measured_border(borders, base.isel(method=m)),
            border_text(borders, float(base["border_predicted"][m])), str(int(counted[RunKind.REFUSED][m])),
            str(int(counted[RunKind.WRONG][m])),
        ]
        for m, method in enumerate(borders["method"].values)
    ]  # fmt: skip
