"""A cube as plain arrays with named dimensions: enough for a query, and read without importing xarray and pandas.

Why not `Dataset.sel` and `DataFrame.to_csv`: a query of 256 points costs 0.2 to 0.3 CPU-s in place of 1.1 to 1.3, of
which the import of xarray takes 0.7.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import CubeError
from tripod_doe.study.cube.file_checks import analysis_files, refuse_unfit
from tripod_doe.study.cube.netcdf import TEXT_TABLE, are_point_numbers, dataset_of, reading
from tripod_doe.study.cube.netcdf_lock import NETCDF_LOCK
from tripod_doe.study.result_directory.open_cube import cube_files, cube_so_far, stored_or_so_far

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

_STRETCH = 1 << 14  # positions that are read together if requested positions are far apart
_NONE = np.zeros(0, np.int64)
_READ = ("flag_values", "flag_meanings", "long_name")  # attributes with the meaning of values


@dataclass(frozen=True)
class Variable:
    """A variable of a cube, read when its values are first asked for."""

    dims: tuple[str, ...]  # its dimensions
    read: Callable[[tuple[slice, ...]], NDArray[Any]]  # gives its values in a box of cells, of one axis per dimension
    # meanings of its values if it is a flag, by value; empty for numbers and texts
    words: Mapping[int, str] = field(default_factory=dict)
    is_counted: bool = False  # whether its values are the positions along its dimension: numbers of points

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

    def variable(name: str, array: xr.DataArray) -> Variable:
        def read(place: tuple[slice, ...]) -> NDArray[Any]:
            return np.asarray(array.variable[place].values)

        is_counted = _is_counted(name, array.dims, array.attrs, array.variable)
        return Variable(tuple(map(str, array.dims)), read, _words(array.attrs), is_counted)

    return CubeArrays(
        {str(dim): int(size) for dim, size in cube.sizes.items()},
        {str(name): variable(str(name), array) for name, array in cube.coords.items()},
        {str(name): variable(str(name), array) for name, array in cube.data_vars.items()},
        _notes(cube.attrs),
        _left_out(cube.attrs),
    )


@contextmanager
def opened_arrays(path: str | Path) -> Iterator[CubeArrays]:
    """Open a result directory (cube and costs) or a netCDF file; its variables are read while it is open.

    Raises:
        CubeError: If there is no cube, or it is damaged.
    """
    with ExitStack() as opened:

        def so_far() -> CubeArrays:
            return cube_arrays(opened.enter_context(cube_so_far(Path(path))))

        yield stored_or_so_far(Path(path), lambda: _stored_arrays(Path(path), opened), so_far)


def _stored_arrays(path: Path, opened: ExitStack) -> CubeArrays:
    """The variables of stored files, which are open until the stack is closed."""
    sizes: dict[str, int] = {}
    coordinates: dict[str, Variable] = {}
    variables: dict[str, Variable] = {}
    notes: tuple[str, ...] = ()
    left_out: dict[str, str] = {}
    with NETCDF_LOCK:
        for file in cube_files(path):
            refuse_unfit(file)
            with reading(file):
                stored = dataset_of(file)
                opened.callback(_close, stored)
                labels = _coordinate_names(stored)
                _add_sizes(sizes, {name: dimension.size for name, dimension in stored.dimensions.items()})
                tables = {_text_table(array) for array in stored.variables.values()}
                for name in [name for name in stored.variables if name not in tables]:
                    group = coordinates if name in labels else variables
                    group[name] = _stored_variable(stored, name, file)
                notes = notes or _notes(stored.__dict__)
                left_out |= _left_out(stored.__dict__)
    return CubeArrays(sizes, coordinates, variables, notes, left_out)


def _close(stored: netCDF4.Dataset) -> None:
    with NETCDF_LOCK:
        stored.close()


def analyses_with(directory: Path, variable: str) -> list[Path]:
    """The files of analyses in a result directory that hold a variable, or the reason why it is missing."""
    files = []
    for file in analysis_files(directory).values():
        with suppress(CubeError), opened_arrays(file) as cube:
            if variable in cube.variables or variable in cube.left_out:
                files.append(file)
    return files


def _add_sizes(sizes: dict[str, int], own: Mapping[str, int]) -> None:
    """Add the lengths of dimensions of a further file."""
    for name, size in own.items():
        if sizes.setdefault(name, size) != size:
            raise ValueError(f"{name} has {size} labels, and {sizes[name]} in the cube")


def _notes(attributes: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(str(attributes.get("model_notes", "")).splitlines())


def _left_out(attributes: Mapping[str, Any]) -> dict[str, str]:
    """The attribute left_out: a line ``NAME: reason`` for each missing variable."""
    lines = [line.partition(": ") for line in str(attributes.get("left_out", "")).splitlines()]
    return {name: reason for name, _, reason in lines}


def _coordinate_names(stored: netCDF4.Dataset) -> set[str]:
    """Names of the coordinates by the CF conventions: variables of dimensions, and names that an attribute lists."""
    listing: list[Any] = [stored, *stored.variables.values()]
    named = " ".join(str(owner.getncattr("coordinates")) for owner in listing if "coordinates" in owner.ncattrs())
    return {*stored.dimensions, *named.split()}


def _text_table(array: netCDF4.Variable[Any]) -> str:
    """Name of the table of texts to which the values of a variable refer; empty where they refer to none."""
    return str(array.getncattr(TEXT_TABLE)) if TEXT_TABLE in array.ncattrs() else ""


def _stored_variable(stored: netCDF4.Dataset, name: str, file: Path) -> Variable:
    array = stored.variables[name]
    table = _text_table(array)

    def read(place: tuple[slice, ...]) -> NDArray[Any]:
        with NETCDF_LOCK, reading(file):
            array.set_auto_mask(False)  # what is missing in a cube is NaN, or a flag of its own
            values = np.asarray(array[place or ...])
            if table:
                return np.asarray(stored.variables[table][...].astype(object)[values])
            is_switch = "dtype" in array.ncattrs() and array.getncattr("dtype") == "bool"  # as xarray: netCDF has none
        return values.astype(bool) if is_switch else values

    def numbers(place: tuple[slice, ...]) -> NDArray[Any]:
        return np.arange(*place[0].indices(array.shape[0]), dtype=array.dtype)

    attributes = {name: array.getncattr(name) for name in array.ncattrs() if name in _READ}
    if _is_counted(name, array.dimensions, attributes, array):
        return Variable(("point",), numbers, is_counted=True)
    return Variable(tuple(array.dimensions), read, _words(attributes))


def _is_counted(name: str, dims: tuple[Any, ...], attributes: Mapping[Any, Any], stored: Any) -> bool:
    return name == "point" and dims == ("point",) and are_point_numbers(attributes, stored)


def _words(attributes: Mapping[str, Any]) -> dict[int, str]:
    """Meanings of a flag by its value, from its CF attributes; a flag of bits (flag_masks) is left as a number."""
    if not {"flag_values", "flag_meanings"} <= attributes.keys():
        return {}
    values = np.atleast_1d(attributes["flag_values"]).tolist()
    return dict(zip(map(int, values), str(attributes["flag_meanings"]).split(), strict=False))
