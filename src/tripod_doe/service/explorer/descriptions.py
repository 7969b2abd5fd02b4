"""Cubes and analyses in words and numbers for a page: what can be chosen, and the findings."""

from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import kind_of
from tripod_doe.analyses.registry import findings_of, table_of
from tripod_doe.number_text import plain_json


def describe_cube(cube: xr.Dataset) -> dict[str, Any]:
    """A cube without its values.

    Returns:
        ``sizes`` of the dimensions; ``coordinates`` by name with dims, units, meaning and values; ``variables`` with
        dims, units, meaning and the words of flags; ``attributes``.
    """
    return {
        "sizes": {str(name): int(size) for name, size in cube.sizes.items()},
        "coordinates": {
            str(name): _meaning(array) | {"values": plain_json(array.values.tolist())}
            for name, array in cube.coords.items()
        },
        "variables": {str(name): _meaning(array) for name, array in cube.data_vars.items()},
        "attributes": {str(name): plain_json(_listed(value)) for name, value in cube.attrs.items()},
    }


def describe_analysis(name: str, result: xr.Dataset) -> dict[str, Any]:
    """The result of an analysis: its kind, its findings in sentences, its table, and its variables."""
    table = table_of(result)
    description = describe_cube(result)
    return {
        "name": name,
        "kind": kind_of(result),
        "findings": findings_of(name, result),
        "table": None if table is None else {"heads": table[0], "rows": table[1]},
    } | description


def _meaning(array: xr.DataArray) -> dict[str, Any]:
    attributes = array.attrs
    description: dict[str, Any] = {
        "dims": [str(dim) for dim in array.dims],
        "units": str(attributes.get("units", "")),
        "long_name": str(attributes.get("long_name", "")),
    }
    if {"flag_values", "flag_meanings"} <= attributes.keys():
        values = np.atleast_1d(attributes["flag_values"]).tolist()
        description["flags"] = dict(zip(map(str, values), str(attributes["flag_meanings"]).split(), strict=False))
    return description


def _listed(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
