"""Indices over the number of samples, which shows whether there are enough, and over the rotation angle."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.kinds import kind_of
from tripod_doe.analyses.sensitivity import RANKED
from tripod_doe.report.charts.chart import COLOURS, LINES, MARKERS, Chart, drawing, legend_above
from tripod_doe.report.responses import spoken

_SHOWN = 6  # factors that a picture can tell apart


def convergence_chart(key: str, name: str, what: str, part: xr.Dataset, kind: str) -> Chart | None:
    """The index of the strongest factors over nested subsamples; None where there is only one size.

    Parameters
    ----------
    key, name
        Name of the chart, and of the analysis.
    what
        The output in words.
    part
        Indices of one output, as `sensitivity_parts` gives them, with dimension ``samples``.
    kind
        Kind of the analysis.
    """
    index = RANKED[kind]
    over = f"{index}_over_samples"
    if over not in part or part.sizes.get("samples", 1) < 2:
        return None
    order = np.argsort(-np.nan_to_num(part[index].values))[:_SHOWN]
    counts = part["samples"].values
    rows = []
    with drawing(5.0, 3.2) as (figure, axes):
        for rank, at in enumerate(order):
            factor = str(part["factor"].values[at])
            values = part[over].isel(factor=int(at)).values
            half = part[f"{over}_conf"].isel(factor=int(at)).values
            shift = 2.0 ** (0.06 * (rank - len(order) / 2))  # beside each other, not on top
            axes.errorbar(
                counts * shift,
                values,
                yerr=half,
                color=COLOURS[rank],
                marker=MARKERS[rank],
                ls=LINES[rank],
                elinewidth=1,
                capsize=2.5,
                label=spoken(factor),
            )
            rows += [(factor, n, v, h) for n, v, h in zip(counts, values, half, strict=True)]
        axes.set_xscale("log", base=2)
        axes.set_xticks(counts, [f"{count:,}" for count in counts])
        axes.minorticks_off()
        axes.set_xlabel("samples used")
        axes.set_ylabel(f"index {index}")
        legend_above(axes, 2)
    level = 100 * float(part.attrs.get("confidence_level", 0.95))
    caption = (
        f"The index {index} of {what} from the first eighth, quarter and half of the samples and from all of them, "
        f"with {level:g} % confidence intervals (analysis {name}). The samples suffice where "
        "lines are level and intervals short."
    )
    data = pd.DataFrame(rows, columns=["factor", "samples", index, f"{index}_conf"])
    return Chart(f"{key}-convergence", f"Convergence for {what}", caption, figure, data)


def rotation_charts(name: str, result: xr.Dataset) -> list[Chart]:
    """The index of each factor over the rotation angle, one chart for each waveform that has no further dimension."""
    index = RANKED[kind_of(result)]
    found = []
    for key, values in result.data_vars.items():
        own = str(key) == index or str(key).endswith(f"_{index}")
        if not own or set(values.dims) != {"factor", "rotation_deg"} or not values.notnull().any():
            continue
        waveform = str(key).removesuffix(index).rstrip("_") or str(result.attrs["outputs"])
        found.append(_rotation_chart(name, waveform, index, values.transpose("factor", "rotation_deg")))
    return found


def _rotation_chart(name: str, waveform: str, index: str, values: xr.DataArray) -> Chart:
    order = np.argsort(-np.nan_to_num(values.mean("rotation_deg").values))[:_SHOWN]
    angle = values["rotation_deg"].values
    with drawing(6.0, 3.0) as (figure, axes):
        for rank, at in enumerate(order):
            label = spoken(str(values["factor"].values[at]))
            axes.plot(angle, values.values[at], color=COLOURS[rank], ls=LINES[rank], label=label)
        axes.set_xlabel("rotation angle (deg)")
        axes.set_ylabel(f"index {index}")
        axes.set_xlim(angle[0], angle[-1])
        legend_above(axes, 3)
    names = [str(factor) for factor in values["factor"].values[order]]
    data = pd.DataFrame({"rotation_deg": angle} | dict(zip(names, values.values[order], strict=True)))
    caption = f"The index {index} of {spoken(waveform)} at each rotation angle (analysis {name})."
    return Chart(
        f"{name}-{waveform}-rotation", f"Indices of {spoken(waveform)} over a revolution", caption, figure, data
    )
