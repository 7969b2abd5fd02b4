"""The locus of a needle between two plates: the paper's Fig. 8(b)."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.page_parts.charts.chart import COLOURS, LINES, Chart, drawing, legend_above
from tripod_doe.page_parts.main_results import finished, point_text

_MOST = 6


def locus_chart(cube: xr.Dataset) -> Chart | None:
    """Drift across the plate's velocity over travel along it, one line per finished point (the first six)."""
    if "axial_path_mm" not in cube or "travel_path_mm" not in cube:
        return None
    points = np.argwhere(finished(cube).values)[:_MOST]
    if not len(points):
        return None
    data: dict[str, np.ndarray] = {}
    with drawing(4.6, 3.4) as (figure, axes):
        for rank, index in enumerate(points):
            point = cube.isel(dict(zip(map(str, cube["outcome"].dims), map(int, index), strict=True)))
            travel, drift = point["travel_path_mm"].values, point["axial_path_mm"].values
            axes.plot(travel, drift, ls=LINES[rank], color=COLOURS[rank], label=point_text(cube, point))
            data |= {f"travel_mm_{rank + 1}": travel, f"drift_mm_{rank + 1}": drift}
        axes.set_xlabel("travel along the plate's velocity (mm)")
        axes.set_ylabel("drift across it (mm)")
        legend_above(axes, 1)
    caption = (
        "Locus of the needle's centre, viewed from above plate A, one line per point; compare the paper's Fig. 8(b)."
    )
    return Chart("loci", "Locus of the needle", caption, figure, pd.DataFrame(data))
