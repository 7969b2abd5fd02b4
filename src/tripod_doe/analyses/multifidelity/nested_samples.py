"""The models of a multifidelity cube with their nested samples and prices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.failing_region.failing_region import FailingRegion, failing_region
from tripod_doe.analyses.output_table import OutputTable
from tripod_doe.analyses.settings import PointSettings
from tripod_doe.analyses.usable_points import refuse_holes, usable_points
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Candidate
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study_file_schema import DesignTable, StudyFile, parse_file
from tripod_doe.study.designs import FAMILIES, SAMPLE, factor_groups, random_factors

_OVERHEAD = 2e-4  # CPU seconds that a point of any model costs besides: its fingerprint, its place in journal and cube
_DIGITS = 3  # of a price in the study file


def price_of_point(
    cube: xr.Dataset, candidates: Sequence[Candidate], design: DesignTable, model: str, rows: IntArray
) -> float:
    """CPU seconds of a point: as the study says, else counted work at its recorded price, else measured.

    Args:
        candidates: What is known of the price of counted work.

    Returns:
        NaN where the study says nothing and the cube has no costs.
    """
    if model in design.prices:
        return design.prices[model]
    if "cpu_seconds" not in cube:
        return np.nan
    alike = [each for each in candidates if each.values.get(design.fidelity) == model]
    plain = [each for each in alike if not each.substitute]
    if plain:
        seconds = float(cube["force_evaluations"].values[rows].mean()) * plain[0].evaluation_seconds
    else:
        seconds = float(cube["cpu_seconds"].values[rows].mean())
    return float(f"{seconds + _OVERHEAD:.{_DIGITS}g}")


def known_candidates(file: StudyFile) -> Sequence[Candidate]:
    """Candidates with recorded prices of the scene; none for a user's function, whose file may be gone."""
    return () if file.study.function else load_simulator(file.study.scene, None).candidates


def model_names(cube: xr.Dataset, file: StudyFile) -> NDArray[np.str_]:
    """The model of each point as its study writes it, shape (point,): a cube stores a level 3 as 3.0."""
    fidelity = file.design.fidelity
    listed = file.factors[fidelity].values if fidelity in file.factors else None
    written = {value: str(value) for value in listed or ()}
    return np.array([written.get(value, str(value)) for value in cube[fidelity].values.tolist()])


FEWEST = 16
"""Samples of the truth below which intervals miss their stated confidence."""


@dataclass(frozen=True)
class Rung:
    """One model with its samples."""

    model: str  # its name
    rows: IntArray  # its points in the cube, shape (sample, point of the sample), in the order of the samples
    price: float  # CPU seconds of a sample; NaN where neither the study says it nor the cube has costs

    @property
    def count(self) -> int:
        """Number of its samples."""
        return len(self.rows)


@dataclass(frozen=True)
class Ladder:
    """The truth and the models that have more samples, each with all samples of those before it."""

    design: DesignTable  # the design of the study
    factors: tuple[str, ...]  # labels of the indices: the factors that are sampled, or their groups
    rungs: tuple[Rung, ...]  # the truth first, then by number of samples
    aside: tuple[Rung, ...]  # models that got no samples beyond those of the truth
    lost: int  # samples that are dropped in all models, since a point of theirs failed in one
    region: FailingRegion | None  # where most of the failed points lie, if they lie together
    outside: int | None  # points left out since one range outside of that region is answered for, if it is

    @property
    def truth(self) -> Rung:
        """The model that counts as the truth."""
        return self.rungs[0]

    @property
    def block(self) -> int:
        """Points of a sample."""
        return int(self.truth.rows.shape[1])

    @property
    def price(self) -> float:
        """CPU seconds of all samples, including the samples of models left aside."""
        return sum(rung.count * rung.price for rung in (*self.rungs, *self.aside))

    def values(self, table: OutputTable, component: int) -> list[FloatArray]:
        """One component of an output, read at all points, in each rung, shape (sample, point of the sample) each."""
        return [table.values[rung.rows, component] for rung in self.rungs]


def read_ladder(cube: xr.Dataset, settings: PointSettings, outputs: Sequence[str]) -> Ladder:
    """The models of a cube with their samples; one with a failed point is left out in all models.

    Raises:
        InputError: If the design is another one, or too few samples of the truth are left.
    """
    file = parse_file(cube.attrs["study"], "the study in the cube")
    design = file.design
    if design.kind != "multifidelity":
        raise InputError(f"this analysis needs a multifidelity design, the cube's is {design.kind}")
    groups = factor_groups(random_factors(design, file.factors))
    block = FAMILIES[design.kind].block(design, len(groups))
    models = model_names(cube, file).reshape(-1, block)[:, 0]
    numbers = cube[SAMPLE].values.reshape(-1, block)[:, 0]
    failed = np.asarray(~usable_points(cube, outputs)).reshape(-1, block)
    names = list(dict.fromkeys(models.tolist()))  # the truth first, as the design lists them
    of_truth = models == names[0]
    anywhere = np.zeros((int(numbers.max()) + 1, block), bool)  # by sample and point, whichever model failed
    np.logical_or.at(anywhere, numbers, failed)
    columns = {name: cube[name].values.reshape(-1, block) for name in random_factors(design, file.factors)}
    region = failing_region(
        {name: column[of_truth].ravel() for name, column in columns.items()}, anywhere[numbers[of_truth]].ravel()
    )
    lost = np.asarray(anywhere.any(axis=1))
    asked = int(of_truth.sum())
    refuse_holes(settings, region, int((~lost[numbers[of_truth]]).sum()), asked, block)
    kept = ~lost[numbers]
    outside = None
    if settings.holes == "rest" and region is not None:
        beyond = ~region.outside(columns).all(axis=1)
        kept, outside = kept & ~beyond, block * int((kept & beyond).sum())
    candidates, rungs = known_candidates(file), []
    for name in names:
        rows = _rows_of(name, models, numbers, kept, block)
        rungs.append(Rung(name, rows, block * price_of_point(cube, candidates, design, name, rows.ravel())))
    if rungs[0].count < FEWEST:
        raise InputError(f"only {rungs[0].count} samples of {names[0]} are left; at least {FEWEST} are needed")
    more = [rung for rung in rungs[1:] if rung.count > rungs[0].count]
    return Ladder(
        design,
        tuple(groups),
        (rungs[0], *sorted(more, key=lambda rung: rung.count)),
        tuple(rung for rung in rungs[1:] if rung not in more),
        int(lost.sum()),
        region,
        outside,
    )


def _rows_of(name: str, models: NDArray[np.str_], numbers: IntArray, kept: NDArray[np.bool_], block: int) -> IntArray:
    """Points of the samples of one model that are kept, shape (sample, point of the sample)."""
    own = np.flatnonzero((models == name) & kept)
    own = own[np.argsort(numbers[own], kind="stable")]
    return own[:, None] * block + np.arange(block)
