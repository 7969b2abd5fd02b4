"""What a run was to look for, and found: points that meet a condition of the study file, in a sentence that is kept."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tripod_doe.errors import InputError, TripodDoeError, printable
from tripod_doe.study.journal import Journal, journal_path

if TYPE_CHECKING:  # the service reads the sentence without xarray
    import xarray as xr

    from tripod_doe.study.definition.study import Study

FOUND = "found"
"""Note in the journal: the sentence on the points that meet the condition of the study."""

_LONGEST = 1_000  # characters of a sentence


def found_by(study: Study, cube: xr.Dataset) -> str:
    """The sentence on the points that meet the condition of a study; empty where it has none."""
    from tripod_doe.quantities import count_of, level
    from tripod_doe.study.query.arrays import cube_arrays
    from tripod_doe.study.query.query import records

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


def found_in(directory: Path) -> str:
    """The sentence of the latest run of a result directory; empty where there is none."""
    if journal_path(directory).is_file():
        with suppress(TripodDoeError), Journal(directory, read_only=True) as journal:
            return printable(journal.recall(FOUND) or "")[:_LONGEST]
    return ""
