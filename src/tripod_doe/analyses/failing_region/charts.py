"""The points that failed over the two factors that decide it, with the region that fails."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.failing_region.failing_region import failing_region_of
from tripod_doe.page_parts.charts.chart import COLOURS, MUTED, Chart, drawing, legend_above
from tripod_doe.page_parts.main_results import asked, finished, point_columns, waiting
from tripod_doe.page_parts.words import axis_label


def failing_region_chart(cube: xr.Dataset) -> Chart | None:
    """Failed and finished points over the factors of the failing region; None if there is no such region."""
    region = failing_region_of(cube)
    if region is None:
        return None
    rows = asked(cube).values & ~waiting(cube).values
    columns, good = point_columns(cube, rows), finished(cube).values[rows]
    names = list(dict.fromkeys(condition.factor for condition in region.conditions))
    names += [name for name, column in columns.items() if name not in names and column.dtype.kind in "fiu"]
    x, y = names[0], names[1] if len(names) > 1 else ""
    across = columns[x].astype(float)
    up = columns[y].astype(float) if y else np.zeros(across.size)
    with drawing(5.0, 3.4) as (figure, axes):
        axes.plot(across[good], up[good], ".", ms=3, color=MUTED, alpha=0.4, label="finished")
        axes.plot(across[~good], up[~good], "x", ms=5, color=COLOURS[1], label="failed")
        for condition in region.conditions:
            draw = axes.axvline if condition.factor == x else axes.axhline
            draw(condition.threshold, color=COLOURS[0], ls="--", lw=1)
        axes.set_xlabel(axis_label(cube, x))
        axes.set_ylabel(axis_label(cube, y) if y else "")
        legend_above(axes, 2)
    data = pd.DataFrame({x: across, y or "none": up, "finished": good})
    caption = f"Points fail {region.text}. Dashed lines: limits of this region, from a classification tree."
    return Chart("failing-region", "Where points fail", caption, figure, data)
