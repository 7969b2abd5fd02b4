"""Makes docs/explanation/choosing.md and its pictures from the results of two workflows: half an hour of CPU time.

tripod-doe workflow workflows/speed_accuracy.toml --out results/speed_accuracy --workers 1
tripod-doe workflow workflows/stability.toml --out results/stability
python docs/explanation/choosing.py results/speed_accuracy results/stability $(git rev-parse --short HEAD)

Without the second directory the stability limits of the page stay as they are.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

import tripod_doe as td
from tripod_doe.analyses.speed_accuracy.charts import ladder_charts
from tripod_doe.analyses.speed_accuracy.sentences import find_in_speed_accuracy, price_table
from tripod_doe.analyses.stability.charts import stability_charts
from tripod_doe.analyses.stability.sentences import border_text, measured_border
from tripod_doe.analyses.stability.stability import RunKind
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import level, number
from tripod_doe.page_parts.charts.chart import Chart

_ALLOWED = (0.1, 0.03, 0.01, 0.005)
_JOINT = "joint"

_PAGE = Path(__file__).with_suffix(".md")
_PICTURES = Path(__file__).parents[1] / "pictures"
_LIMITS, _FINDINGS = "\n## Stability limits\n", "\n## Findings of these runs\n"

_START = """\
# Choosing a model and a method

Written by `docs/explanation/choosing.py` from result cubes (its docstring gives the commands); do not edit. Prices
are CPU seconds per simulated second on one core, including all checks of a run. A run of four revolutions at 600 rpm is
0.4 s. Ratios apply to other machines, too; seconds do not. All numbers but the stability limits were measured with
commit {commit}, so default settings are from that version.

![Difference to the finest model over price, of all models and methods](../pictures/speed_accuracy.svg)

{advice} {caption}
"""

_PILOT = """
These errors hold for one operating point. For a study of many operating points, `model = "auto"` with `[accuracy]`
measures them in a pilot ([Automatic choice of the model](automatic_choice.md)).
"""


_VIBRATING = """
Many joints vibrate by themselves: with high friction in the grooves or of the needles, with large joint angles, and at
low torque and low speed. `rollers` and `needles` follow the vibration, which takes several times as long, and
`outcome_detail` states its frequency, growth and size ([Vibration](vibration.md)). `kinetostatic` computes the
motion without vibration, and where it finds that the joint vibrates, about what the vibration makes of the third order
(`vibration_third_order`).
"""


def choosing_page(accuracy: xr.Dataset, limits: str, commit: str) -> str:
    """Write the page.

    Parameters
    ----------
    accuracy
        Analysis of kind speed-accuracy, with the scene ``joint`` among its cases.
    limits
        The section on stability limits, see `stability_section`.
    commit
        Version of the sources with which the analysis was made.

    Returns
    -------
    str
        Markdown.
    """
    (advice, *_), caption = find_in_speed_accuracy(accuracy), ladder_charts(accuracy)[0].caption
    parts = [
        _START.format(commit=commit, advice=advice, caption=caption),
        "## Which model\n\nThe cheapest run within the allowed error, relative to the finest model; the last column "
        "is the price of `needles` with default settings divided by the price of this run:\n",
        _table(
            ["Quantity", "Allowed error", "Model", "Method and setting", "Error", "Price", "Price ratio"],
            _choices(accuracy.sel(run=accuracy["scene"] == _JOINT)),
        ),
        _PILOT,
        "Outputs that a model lacks, and parameters that it ignores:\n",
        _table(["Model", "Lacks", "Ignores"], [_blind_spots(name) for name in MODELS]),
        _VIBRATING,
        "\n## Which method\n\nA study without `method` uses the default. Price at "
        f"{level(100 * float(accuracy.attrs['target']))} % error of each scene's first quantity:\n",
        _table(*price_table(accuracy)),
        limits,
        _FINDINGS,
        *(f"- {sentence}\n" for sentence in find_in_speed_accuracy(accuracy)[1:]),
    ]
    return "\n".join(part.rstrip("\n") if part.startswith("- ") else part for part in parts) + "\n"


def stability_section(borders: Mapping[str, xr.Dataset], commit: str) -> str:
    """Write the section on stability limits, from analyses of kind stability by the name of their study."""
    picture = ""
    if _JOINT in borders:
        caption = stability_charts(borders[_JOINT])[0].caption
        picture = f"![Runs of the joint over step](../pictures/stability.svg)\n\n{caption}\n\n"
    return (
        f"{_LIMITS}\nMeasured with commit {commit}.\n\n{picture}Largest step or tolerance up to "
        "which all runs are right, in the base case of each study; the limit that theory predicts; and, over all cases "
        "of the study, how many runs were rejected by their own checks or finished with a wrong result:\n\n"
    ) + _table(
        ["Study", "Method", "Stability limit", "Predicted", "Rejected", "Wrong, undetected"],
        [row for name, data in borders.items() for row in _breaks(name, data)],
    )


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _choices(runs: xr.Dataset) -> list[list[str]]:
    """One row per quantity of the joint and allowed error."""
    price = runs["cpu_per_second"].values
    default = (runs["is_default"].values == 1) & (runs["model"].values == "needles")
    of_default = float(price[default][0]) if default.any() else np.nan
    rows = []
    for quantity in runs["quantity"].values:
        part = runs.sel(quantity=quantity)
        error = part["total_error"].values
        good = (part["outcome"].values == Outcome.FINISHED) & np.isfinite(error)
        known_to = float(error[good].min()) if good.any() else np.nan
        for allowed in _ALLOWED if good.any() else ():
            found = np.flatnonzero(good & (error <= allowed))
            start = [str(part["quantity_meaning"].item()), f"{level(100 * allowed)} %"]
            if not found.size:
                rows.append([*start, "–", "–", f"{number(100 * known_to, 2)} % at best", "–", "–"])
                continue
            at = found[np.argmin(price[found])]
            rows.append(
                [
                    *start,
                    str(part["model"].values[at]),
                    str(part["described"].values[at]),
                    f"{number(100 * error[at], 2)} %",
                    number(float(price[at])),
                    number(of_default / price[at]),
                ]
            )
    return rows


def _blind_spots(name: str) -> list[str]:
    model, every = MODELS[name], set().union(*(other.outputs for other in MODELS.values()))
    missing, ignored = (
        ", ".join(f"`{part}`" for part in sorted(parts)) or "–" for parts in (every - model.outputs, model.ignores)
    )
    return [name, missing, ignored]


def _breaks(name: str, borders: xr.Dataset) -> list[list[str]]:
    """One row per method of one study."""
    base, kind = borders.isel(case=0), borders["run_kind"].values
    counted = {which: (kind == which).sum(axis=(1, 2)) for which in (RunKind.REFUSED, RunKind.WRONG)}
    return [
        [
            name.replace("_", " "),
            str(method),
            measured_border(borders, base.isel(method=m)),
            border_text(borders, float(base["border_predicted"][m])),
            str(int(counted[RunKind.REFUSED][m])),
            str(int(counted[RunKind.WRONG][m])),
        ]
        for m, method in enumerate(borders["method"].values)
    ]


def main(speed: Path, stability: Path | None, commit: str) -> None:
    """Write page and pictures."""
    accuracy = td.open_cube(speed / "steps/accuracy/cube.nc")
    _draw("speed_accuracy", ladder_charts(accuracy)[0])
    if stability is None:
        limits = _LIMITS + _PAGE.read_text(encoding="utf-8").partition(_LIMITS)[2].partition(_FINDINGS)[0]
    else:
        paths = sorted(stability.glob("steps/*_borders/cube.nc"))
        borders = {path.parent.name.removesuffix("_borders"): td.open_cube(path) for path in paths}
        _draw("stability", stability_charts(borders[_JOINT])[0])
        limits = stability_section(borders, commit)
    _PAGE.write_text(choosing_page(accuracy, limits, commit), encoding="utf-8")


def _draw(name: str, chart: Chart) -> None:
    (_PICTURES / f"{name}.svg").write_text(chart.svg(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 3 else None, sys.argv[-1])
