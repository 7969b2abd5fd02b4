"""The points that sentences and figures use: all, or a subset of a very large cube, which the page states."""

import math

import numpy as np
import xarray as xr

from tripod_doe.array_types import IntArray
from tripod_doe.page_parts.main_results import design_kind, truth_of
from tripod_doe.study.cube.slab_reading import read_positions

MOST_POINTS = 1_000_000
"""Up to this number of points, sentences and figures use all points."""

_LONG = 40  # numbers per point; a variable with more is a course, shown only at single points
_PART_OF, _HOW = "part_of", "how_chosen"  # attributes of a part: number of points of the whole, how the part was chosen


def shown_subset(cube: xr.Dataset) -> xr.Dataset:
    """The points that sentences and figures use, read from the file once.

    Up to `MOST_POINTS` all; else evenly spaced levels along the longest dimensions of a grid, or points of a list drawn
    at random with a fixed seed, in their order. A multifidelity study first gives all points of the model that counts
    as the truth, which sentences and figures on the joint use. Courses over the rotation angle stay in the file until
    one of their points is needed.
    """
    count = math.prod(cube["outcome"].shape)
    short = [name for name, variable in cube.variables.items() if _numbers_of_a_point(cube, variable) <= _LONG]
    if count <= MOST_POINTS:
        for name in short:
            cube.variables[name].load()
        return cube
    rows, how = _rows(cube)
    read = {}
    for name in short:
        variable = cube.variables[name]
        read[name] = xr.Variable(variable.dims, read_positions(variable, rows), variable.attrs)
    part = cube.isel(rows).assign({name: read[name] for name in short if name in cube.data_vars})
    part = part.assign_coords({name: read[name] for name in short if name in cube.coords})
    return part.assign_attrs({_PART_OF: count, _HOW: how})


def subset_sentences(part: xr.Dataset) -> list[str]:
    """A sentence on the size of a part of a cube; empty if the part is the whole."""
    if _PART_OF not in part.attrs:
        return []
    of = f"{math.prod(part['outcome'].shape):,} of the {part.attrs[_PART_OF]:,} points"
    how = part.attrs[_HOW]
    return [f"Sentences and figures on the points use {of} ({how}); counts, costs and analyses use all."]


def _numbers_of_a_point(cube: xr.Dataset, variable: xr.Variable) -> int:
    design = cube["outcome"].dims
    return math.prod(size for dim, size in variable.sizes.items() if dim not in design)


def _rows(cube: xr.Dataset) -> tuple[dict[str, IntArray], str]:
    """Shown positions along the dimensions of the design, and how they are chosen."""
    sizes = {str(dim): size for dim, size in cube["outcome"].sizes.items()}
    if list(sizes) == ["point"]:
        return _rows_of_list(cube, sizes["point"])
    shown = dict(sizes)
    while math.prod(shown.values()) > MOST_POINTS:
        longest = max(shown, key=lambda dim: shown[dim])
        shown[longest] = -(-shown[longest] // 2)
    rows = {
        dim: np.unique(np.linspace(0, size - 1, shown[dim]).round().astype(np.int64))
        for dim, size in sizes.items()
        if shown[dim] < size
    }
    return rows, "evenly spaced levels"


def _rows_of_list(cube: xr.Dataset, count: int) -> tuple[dict[str, IntArray], str]:
    """Random points of a list, after all points of the true model if there are several models."""
    how, first = "drawn at random with a fixed seed", np.zeros(0, np.int64)
    if design_kind(cube) == "multifidelity":
        fidelity, truth = truth_of(cube)
        first = np.flatnonzero(cube[fidelity].values == truth)
        if first.size < MOST_POINTS:
            how = f"all {first.size:,} by {truth}, others {how}"
        else:
            first = first[:0]
    others = np.setdiff1d(np.arange(count), first, assume_unique=True)
    drawn = np.random.default_rng(0).choice(others, MOST_POINTS - first.size, replace=False)
    return {"point": np.sort(np.concatenate([first, drawn]))}, how
