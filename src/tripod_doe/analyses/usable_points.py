"""The points of a cube that a sensitivity analysis can use: whole blocks only, and what was dropped for what reason."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.failing_region.failing_region import FailingRegion, failing_region
from tripod_doe.analyses.output_table import chosen_outputs
from tripod_doe.analyses.settings import PointSettings
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.joint.outputs import JOINT_OUTPUTS, VIBRATES
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.dataset import EXCLUDED, OF_FUNCTION
from tripod_doe.study.cube.lazy_dataset import flat_points
from tripod_doe.study.cube.slab_reading import all_finite
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable, parse_file
from tripod_doe.study.designs import FAMILIES, factor_groups, unit_sample

SAMPLED_DESIGNS = ("latin-hypercube", "sobol", "halton", "rbd-fast")
"""Designs whose points each stand alone and follow the distributions of the factors."""


@dataclass(frozen=True)
class Sample:
    """Usable points of a design, in whole blocks."""

    # design, tables: the design of the study and its factors, as the study file describes them
    design: DesignTable
    tables: dict[str, FactorTable]
    columns: dict[str, NDArray[np.generic]]  # values of the factors at the usable points, shape (point,) each
    rows: IntArray  # the usable points among those of the cube, shape (point,)
    block: int  # points of a block; 1 where every point stands alone
    dropped: int  # points of blocks that are lost
    region: FailingRegion | None = None  # where most of the points that failed lie, if they lie together
    outside: int | None = None  # points left out since one range outside of that region is answered for, if it is
    # the sample of which this is a part, and the places of its points there; None where it is no part
    whole: tuple[Sample, IntArray] | None = None

    @property
    def blocks(self) -> int:
        """Number of whole blocks."""
        return self.rows.size // self.block

    @property
    def factors(self) -> list[str]:
        """Labels of the indices: the factors, or the groups in which they vary."""
        return list(factor_groups(self.tables))

    @property
    def independent(self) -> bool:
        """Whether the factors are independent: neither correlated nor restricted by constraints."""
        return not (self.design.correlation or self.design.constraints)

    @cached_property
    def unit(self) -> FloatArray:
        """The usable points on the unit cube, before the distributions, shape (point, factor)."""
        if self.whole:  # a design is made once
            return self.whole[0].unit[self.whole[1]]
        return unit_sample(self.design, self.tables)[self.rows]

    @cached_property
    def ranks(self) -> FloatArray:
        """Ranks of the factors' values over their number, between 0 and 1, shape (point, factor)."""
        from scipy.stats import rankdata

        columns = (np.unique(column, return_inverse=True)[1] for column in self.columns.values())
        return np.stack([(rankdata(column) - 0.5) / column.size for column in columns], axis=1)

    @property
    def attributes(self) -> dict[str, str | int]:
        """Attributes of a result: the points that it is based on, and those that it lacks."""
        region = self.region.attributes(self.outside) if self.region else {}
        return {"points_used": self.rows.size, "points_dropped": self.dropped, **region}

    def take(self, points: IntArray) -> Sample:
        """Some of its points, in whole blocks."""
        columns = {name: column[points] for name, column in self.columns.items()}
        return replace(self, columns=columns, rows=self.rows[points], whole=(self, points))


def read_sample(cube: xr.Dataset, settings: PointSettings, kinds: Collection[str], outputs: Sequence[str]) -> Sample:
    """The usable points of a cube: those of blocks in which all points finished and gave all outputs.

    Args:
        cube: A cube with one dimension ``point``.

    Raises:
        InputError: If the design is another one, or too little of it is left.
    """
    if "study" not in cube.attrs:
        raise InputError("this cube has no study; an analysis needs the cube of a run")
    file = parse_file(cube.attrs["study"], "the study in the cube")
    design = file.design
    if design.kind not in kinds:
        raise InputError(f"this analysis needs a {' or '.join(kinds)} design, the cube's is {design.kind}")
    tables = {name: file.factors[name] for name in design.factors or file.factors}
    if design.kind == "table":
        tables |= _other_columns(cube, tables)
    block = FAMILIES[design.kind].block(design, len(factor_groups(tables)))
    usable, inside = usable_points(cube, outputs), _inside(cube)
    columns = {name: cube[name].values for name in tables if name in cube.coords}
    region = failing_region({name: column[inside] for name, column in columns.items()}, ~usable[inside])
    whole = usable.reshape(-1, block).all(axis=1)
    asked, left, outside = int(inside.sum()) // block, int(whole.sum()), None
    refuse_holes(settings, region, left, asked, block)
    if settings.holes == "rest" and region is not None:
        whole &= region.outside(columns).reshape(-1, block).all(axis=1)
        outside = block * (left - int(whole.sum()))
    rows = np.flatnonzero(np.repeat(whole, block))
    return Sample(
        design,
        tables,
        {name: column[rows] for name, column in columns.items()},
        rows,
        block,
        block * (asked - left),
        region,
        outside,
    )


def _other_columns(cube: xr.Dataset, known: Collection[str]) -> dict[str, FactorTable]:
    """The columns of a table that vary, and that the study file need not list.

    Raises:
        InputError: If one has open fields.
    """
    columns = {
        str(name): column.values
        for name, column in cube.coords.items()
        if name not in known and column.dims == ("point",) and "source" in column.attrs
    }
    varied = [name for name, values in columns.items() if np.unique(values).size > 1]
    for name in varied:
        if columns[name].dtype.kind == "f" and np.isnan(columns[name]).any():
            raise InputError(
                f"column {name!r} of the table has empty fields: fill them, or analyse the other factors only"
            )
    return {name: FactorTable() for name in varied}


def _inside(cube: xr.Dataset) -> NDArray[np.bool_]:
    """Points that no constraint excludes."""
    if EXCLUDED not in cube:
        return np.ones(cube.sizes["point"], bool)
    return np.asarray(cube[EXCLUDED].values == 0)


def usable_points(cube: xr.Dataset, outputs: Sequence[str]) -> NDArray[np.bool_]:
    """Points that finished and gave numbers, shape (point,).

    A finished point may lack one: a function returned NaN, a model cannot give the output.
    """
    usable = np.asarray(cube["outcome"].values == Outcome.FINISHED)
    for name in outputs:
        given = all_finite(cube[name].variable)
        if given.any():  # an output that no point gives takes nothing away from the others
            usable = usable & given
    return usable


def analysed_points(cube: xr.Dataset) -> xr.Dataset:
    """The points of a cube along ``point``, as an analysis of its outputs takes them; see `Output.if_missing`."""
    cube = flat_points(cube)
    if VIBRATES not in cube or cube[VIBRATES].attrs.get("long_name") == OF_FUNCTION:
        return cube
    calm = cube[VIBRATES].copy(data=JOINT_OUTPUTS[VIBRATES].given(cube[VIBRATES].values))
    return cube.assign({VIBRATES: calm.where(cube["outcome"] == Outcome.FINISHED)})


def whole_outputs(cube: xr.Dataset, asked: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """The requested outputs, else all results but those that some of the finished points lack.

    A model may give an output at some points only, as a balance does the third order with a vibration, and of several
    models one may not give it at all: the others are not lost for the rest of the outputs.

    Returns:
        The outputs, all of them if none of the others is whole; and the attribute ``left_out`` of the result, a line
        ``NAME: reason`` for each that is left out.

    Raises:
        InputError: See `chosen_outputs`.
    """
    names = chosen_outputs(cube, asked)
    if asked:
        return names, {}
    finished = cube["outcome"].values == Outcome.FINISHED
    lacking = {name: int((finished & ~all_finite(cube[name].variable)).sum()) for name in names}
    count = int(finished.sum())
    sparse = [name for name, lost in lacking.items() if 0 < lost < count]
    if not sparse or all(lacking.values()):  # none is whole
        return names, {}
    lines = [
        f"{name}: {lacking[name]:,} of {count:,} points do not have it; name it alone to analyse the rest"
        for name in sparse
    ]
    return [name for name in names if name not in sparse], {"left_out": "\n".join(lines)}


def refuse_holes(settings: PointSettings, region: FailingRegion | None, left: int, asked: int, block: int) -> None:
    """Refuse where too few blocks are left, or where holes are to be refused."""
    what = "points" if block == 1 else f"blocks of {block} points"
    where = f"; most failed {region.text}" if region else ""
    if left < 2:
        raise InputError(f"only {left} of {asked} {what} finished: nothing to analyse{where}")
    gone = asked - left
    if gone and settings.holes == "refuse":
        raise InputError(f'{gone:,} of {asked:,} {what} are missing, and holes = "refuse"{where}')
    if gone > math.floor(settings.most_dropped * asked) and not (settings.holes == "rest" and region):
        remedy = '; set holes = "rest" for an answer outside of it' if region else ""
        raise InputError(
            f"{gone:,} of {asked:,} {what} are missing, more than most_dropped = "
            f"{settings.most_dropped:g}{where}{remedy}"
        )
