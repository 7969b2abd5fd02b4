"""Which region of a study fails."""

from __future__ import annotations

import xarray as xr

from tripod_doe.analyses.failing_region.failing_region import FailingRegion, failing_region
from tripod_doe.analyses.main_effects.sentences import point_columns, varies
from tripod_doe.report.responses import asked, finished, waiting


def failing_region_of(cube: xr.Dataset) -> FailingRegion | None:
    """The region of a study in which most of its failed points lie, None where they do not lie together."""
    rows = asked(cube).values & ~waiting(cube).values
    columns = {name: column for name, column in point_columns(cube, rows).items() if varies(column)}
    return failing_region(columns, ~finished(cube).values[rows])
