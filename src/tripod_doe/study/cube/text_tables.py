"""Texts of points in large cubes: stored as numbers of rows in a table of all different texts, read as texts."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from tripod_doe.study.cube.attributes import TEXT_TABLE


class _Texts(BackendArray):
    """Texts that are looked up when they are used."""

    def __init__(self, numbers: xr.Variable, table: NDArray[Any]) -> None:
        self._numbers, self._table = numbers, table
        self.shape, self.dtype = numbers.shape, np.dtype(object)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._at)

    def _at(self, key: tuple[Any, ...]) -> Any:
        return self._table[self._numbers[key].values]


def with_texts(stored: xr.Dataset) -> xr.Dataset:
    """A cube as it was stored, with texts in place of their numbers; they are read when they are used."""
    numbers = {name: variable for name, variable in stored.variables.items() if TEXT_TABLE in variable.attrs}
    tables = {name: str(variable.attrs[TEXT_TABLE]) for name, variable in numbers.items()}
    texts = {}
    for name, variable in numbers.items():
        table = stored.variables[tables[name]].values.astype(object)
        attrs = {key: value for key, value in variable.attrs.items() if key != TEXT_TABLE}
        if variable.chunks:
            data = variable.data.map_blocks(table.__getitem__, dtype=object)
        else:
            data = indexing.LazilyIndexedArray(_Texts(variable, table))
        texts[name] = xr.Variable(variable.dims, data, attrs)
    coordinates = {name: variable for name, variable in texts.items() if name in stored.coords}
    return stored.assign(texts).drop_vars(set(tables.values())).set_coords(list(coordinates))
