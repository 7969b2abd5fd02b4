"""The points that two cubes share, by the values of every factor of either study."""

import json
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.diff.definitions import fixed_parameters
from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError
from tripod_doe.study.cube.dataset import ROW_OF_PART
from tripod_doe.study.designs import SAMPLE

_LABELS = ("point", "varied", SAMPLE)
_MATCH = 1e-9  # relative, as selections match


def factors_of(cube: xr.Dataset) -> list[str]:
    """Names of the factors of a cube: the coordinates of its points, but for numbers and labels of points and rows."""
    points = set(cube["outcome"].dims)
    return [
        str(name)
        for name in cube.coords
        if name not in _LABELS
        and cube[name].attrs.get("long_name") != ROW_OF_PART
        and cube[name].dims
        and set(cube[name].dims) <= points
    ]


def shared_points(a: xr.Dataset, b: xr.Dataset) -> tuple[pd.DataFrame, IntArray, IntArray]:
    """Points of equal factors in two cubes; numbers match to 1e-9 relative.

    A factor of one study alone has its fixed value in the other cube. Points that a study has twice count once.

    Returns:
        Values of all factors, a row for each shared point, in the order of the first cube; the numbers of these points
        in the first and in the second cube, in the order of `np.ravel` over its design.

    Raises:
        InputError: If one study has a factor that the other has neither as a factor nor with one value.
    """
    names = list(dict.fromkeys([*factors_of(a), *factors_of(b)]))
    first, second = _table(a, names, "A"), _table(b, names, "B")
    codes = {name: _codes(first[name].to_numpy(), second[name].to_numpy()) for name in names}
    left = pd.DataFrame({name: code[0] for name, code in codes.items()}).assign(row_a=np.arange(len(first)))
    right = pd.DataFrame({name: code[1] for name, code in codes.items()}).assign(row_b=np.arange(len(second)))
    if not names:
        left, right = left.assign(one=0), right.assign(one=0)
    keys = names or ["one"]
    both = left.drop_duplicates(keys).merge(right.drop_duplicates(keys), on=keys).sort_values("row_a")
    rows_a, rows_b = both["row_a"].to_numpy(np.int64), both["row_b"].to_numpy(np.int64)
    return first.iloc[rows_a].reset_index(drop=True), rows_a, rows_b


def _table(cube: xr.Dataset, names: list[str], side: str) -> pd.DataFrame:
    """Values of factors at all points of a cube, a row for each."""
    sizes = {str(dim): size for dim, size in cube["outcome"].sizes.items()}
    fixed, columns = fixed_parameters(cube), {}
    own = set(factors_of(cube))
    for name in names:
        if name in own:
            shape = [sizes[dim] if dim in cube[name].dims else 1 for dim in sizes]
            values = cube[name].transpose(*(dim for dim in sizes if dim in cube[name].dims)).values
            columns[name] = np.broadcast_to(values.reshape(shape), tuple(sizes.values())).ravel()
        elif name in fixed:
            columns[name] = np.repeat(np.array([fixed[name]]), int(np.prod(list(sizes.values()))))
        else:
            raise InputError(
                f"{side} has no value of {name}, a factor of the other study: the points cannot be matched "
                f"(fixed there: {', '.join(fixed) or json.dumps(fixed)})"
            )
    return pd.DataFrame(columns, index=range(int(np.prod(list(sizes.values())))))


def _codes(a: NDArray[Any], b: NDArray[Any]) -> tuple[IntArray, IntArray]:
    """Equal numbers for equal values of a factor in two tables."""
    if a.dtype.kind not in "fiub" or b.dtype.kind not in "fiub":
        codes = pd.factorize(np.concatenate([a.astype(str), b.astype(str)]))[0].astype(np.int64)
        return codes[: a.size], codes[a.size :]
    known, which = np.unique(np.concatenate([a, b]).astype(float), return_inverse=True)
    apart = ~(np.abs(np.diff(known)) <= _MATCH * np.abs(known[1:]))  # not a number, as an open field, is none of them
    group = np.concatenate([[0], np.cumsum(apart)]).astype(np.int64)[which]
    return group[: a.size], group[a.size :]
