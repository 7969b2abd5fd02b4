"""The points of a study that it looks for, in a sentence."""

import xarray as xr

from tripod_doe.errors import InputError
from tripod_doe.quantities import count_of, level
from tripod_doe.study.definition.study import Study
from tripod_doe.study.query.arrays import cube_arrays
from tripod_doe.study.query.query import records


def found_by(study: Study, cube: xr.Dataset) -> str:
    """The sentence on the points that meet the condition of a study; empty where it has none."""
    condition = study.file.run.look_for
    if condition is None:
        return ""
    try:
        columns = records(cube_arrays(cube), "outcome", where=condition)
    except InputError as error:  # values of a kind that only the results show: they are kept whatever is looked for
        return f"Nothing could be looked for: {error}"
    count, total = len(columns["outcome"]), cube["outcome"].size
    if not count:
        return f"No point meets {condition}."
    first = {name: columns[name][0].item() for name in study.factors if name in columns}
    at = ", ".join(f"{name} = {value if isinstance(value, str) else level(value)}" for name, value in first.items())
    return f"{count:,} of {count_of(total, 'point')} meet {condition}" + (f"; the first at {at}." if at else ".")
