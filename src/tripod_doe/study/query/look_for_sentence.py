"""The points of a study, or the rows of another result, that a run looks for, in a sentence."""

from collections.abc import Iterable

import xarray as xr

from tripod_doe.errors import InputError
from tripod_doe.number_text import count_of, level
from tripod_doe.study.definition.study import Study
from tripod_doe.study.query.query import records


def found_points(study: Study, cube: xr.Dataset) -> str:
    """The sentence on the points that meet the condition of a study; empty where it has none."""
    return found_rows(study.file.run.look_for, cube, "outcome", study.factors, "point")


def found_rows(
    condition: str | None, cube: xr.Dataset, variable: str, named: Iterable[str], noun: str, of: str = ""
) -> str:
    """The sentence on the cells of a variable that meet a condition; empty where there is no condition.

    Args:
        named: Variables and coordinates whose values name the first such cell.
        noun, of: Name of a cell, and of its owner.
    """
    if condition is None:
        return ""
    try:
        rows = records(cube, variable, where=condition)
        count, total = len(rows[variable]), cube[variable].size
        if not count:
            return f"No {noun}{of} meets {condition}."
        first = {name: rows[name][0].item() for name in named if name in rows}
        for name in named:
            if name in cube.data_vars:
                first[name] = records(cube, name, where=condition)[name][0].item()
    except InputError as error:  # only results show the type of values: the results are kept in spite of the error
        return f"The condition of look_for failed: {error}"
    at = ", ".join(f"{name} = {value if isinstance(value, str) else level(value)}" for name, value in first.items())
    meet = "meets" if count == 1 else "meet"
    return f"{count:,} of {count_of(total, noun)}{of} {meet} {condition}" + (f"; the first at {at}." if at else ".")
