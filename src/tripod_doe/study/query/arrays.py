"""A cube as plain arrays with named dimensions, each read when its values are first asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import CubeError
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.result_directory.open_cube import opened_cube

_STRETCH = 1 << 14  # positions that are read together if requested positions are far apart
_NONE = np.zeros(0, np.int64)


@dataclass(frozen=True)
class Variable:
    """A variable of a cube, read when its values are first asked for."""

    dims: tuple[str, ...]  # its dimensions
    read: Callable[[tuple[slice, ...]], NDArray[Any]]  # gives its values in a box of cells, of one axis per dimension
    # meanings of its values if it is a flag, by value; empty for numbers and texts
    words: Mapping[int, str] = field(default_factory=dict)

    @cached_property
    def values(self) -> NDArray[Any]:
        """Its values, one axis per dimension."""
        return self.read(tuple(slice(None) for _ in self.dims))

    def texts(self) -> set[str]:
        """All texts among its values; none of numbers."""
        return {str(value) for value in self.values.flat} if self.values.dtype.kind in "OU" else set()

    def at(self, rows: Mapping[str, IntArray]) -> NDArray[Any]:
        """Its values at ascending positions along its dimensions; only stretches that hold them are read."""
        if "values" in vars(self):
            return _taken(self.values, self.dims, rows, dict.fromkeys(rows, 0))
        for axis, dim in enumerate(self.dims):
            own = rows.get(dim, _NONE)
            if own.size and own[-1] - own[0] > 4 * own.size + _STRETCH:
                stretches = np.split(own, np.flatnonzero(np.diff(own // _STRETCH)) + 1)
                return np.concatenate([self.at({**rows, dim: stretch}) for stretch in stretches], axis)
        first = {dim: int(own[0]) if own.size else 0 for dim, own in rows.items()}
        last = {dim: int(own[-1]) + 1 if own.size else 0 for dim, own in rows.items()}
        place = tuple(slice(first[dim], last[dim]) if dim in rows else slice(None) for dim in self.dims)
        return _taken(self.read(place), self.dims, rows, first)


def _taken(
    values: NDArray[Any], dims: tuple[str, ...], rows: Mapping[str, IntArray], first: Mapping[str, int]
) -> NDArray[Any]:
    for axis, dim in enumerate(dims):
        if dim in rows:
            values = np.take(values, rows[dim] - first[dim], axis)
    return values


@dataclass(frozen=True)
class CubeArrays:
    """A cube with only two attributes: notes on its models and on missing variables."""

    sizes: Mapping[str, int]  # length of each dimension
    # labels along the dimensions, and other coordinates such as the factors of a list of points
    coordinates: Mapping[str, Variable]
    variables: Mapping[str, Variable]  # everything else
    # sentences on the models behind it and the errors known for them; none in a cube of one model
    model_notes: tuple[str, ...] = ()
    # why variables of an analysis are not in it, by their names
    left_out: Mapping[str, str] = field(default_factory=dict)


def cube_arrays(cube: xr.Dataset) -> CubeArrays:
    """The arrays of an open cube."""

    def variable(array: xr.DataArray) -> Variable:
        def read(place: tuple[slice, ...]) -> NDArray[Any]:
            return np.asarray(array.variable[place].values)

        return Variable(tuple(map(str, array.dims)), read, _words(array.attrs))

    return CubeArrays(
        {str(dim): int(size) for dim, size in cube.sizes.items()},
        {str(name): variable(array) for name, array in cube.coords.items()},
        {str(name): variable(array) for name, array in cube.data_vars.items()},
        _notes(cube.attrs),
        _left_out(cube.attrs),
    )


@contextmanager
def opened_arrays(path: str | Path) -> Iterator[CubeArrays]:
    """Open a result directory (cube and costs) or a netCDF file; its variables are read while it is open.

    Raises:
        CubeError: If there is no cube, or it is damaged.
    """
    with opened_cube(path) as cube:
        yield cube_arrays(cube)


def analyses_with(directory: Path, variable: str) -> list[Path]:
    """The files of analyses in a result directory that hold a variable, or the reason why it is missing."""
    files = []
    for file in analysis_files(directory).values():
        with suppress(CubeError), opened_arrays(file) as cube:
            if variable in cube.variables or variable in cube.left_out:
                files.append(file)
    return files


def _notes(attributes: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(str(attributes.get("model_notes", "")).splitlines())


def _left_out(attributes: Mapping[str, Any]) -> dict[str, str]:
    """The attribute left_out: a line ``NAME: reason`` for each missing variable."""
    lines = [line.partition(": ") for line in str(attributes.get("left_out", "")).splitlines()]
    return {name: reason for name, _, reason in lines}


def _words(attributes: Mapping[str, Any]) -> dict[int, str]:
    """Meanings of a flag by its value, from its CF attributes; a flag of bits (flag_masks) is left as a number."""
    if not {"flag_values", "flag_meanings"} <= attributes.keys():
        return {}
    values = np.atleast_1d(attributes["flag_values"]).tolist()
    return dict(zip(map(int, values), str(attributes["flag_meanings"]).split(), strict=False))
