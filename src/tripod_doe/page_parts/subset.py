"""The points that sentences and figures are made of: all, or of a very large cube a subset that the page states."""

import math

import numpy as np
import xarray as xr

from tripod_doe.array_types import IntArray
from tripod_doe.page_parts.main_results import design_kind, truth_of
from tripod_doe.study.cube.slab_reading import read_positions

MOST_POINTS = 1_000_000
"""Points up to which sentences and figures are made of all of them."""

_LONG = 40  # numbers of a point above which a variable is a course, of which only single points are shown
_PART_OF, _HOW = "part_of", "how_chosen"  # attributes of a part: number of points of the whole, how they are chosen


def shown_subset(cube: xr.Dataset) -> xr.Dataset:
    """The points that sentences and figures are made of, read from the file once.

    Up to `MOST_POINTS` all; else of a grid evenly spaced levels along its longest dimensions, of a list points that are
    drawn at random with a fixed seed, in their order. A multifidelity study first gives all points by the model that
    counts as the truth, of which sentences and figures on the joint are made. Courses over the rotation angle stay in
    the file until a point of them is asked for.
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
    """A sentence that says what a part is of the whole; none where it is the whole."""
    if _PART_OF not in part.attrs:
        return []
    of = f"{math.prod(part['outcome'].shape):,} of the {part.attrs[_PART_OF]:,} points"
    how = part.attrs[_HOW]
    return [f"Sentences and figures on the points are made of {of} ({how}); counts, costs and analyses, of all."]


def _numbers_of_a_point(cube: xr.Dataset, variable: xr.Variable) -> int:
    design = cube["outcome"].dims
    return math.prod(size for dim, size in variable.sizes.items() if dim not in design)


def _rows(cube: xr.Dataset) -> tuple[dict[str, IntArray], str]:
    """Positions along the dimensions of the design that are shown, and how they are chosen."""
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
    """Points of a list at random, after all by the truth where there are several models."""
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
