"""Global sensitivity: Sobol' indices and Morris' elementary effects of every kept output, by SALib.

With NaN among its inputs SALib returns zeros and no error, so only finite outputs are passed to it: where a point
failed, its whole Saltelli block or trajectory is dropped, and the result states how many were.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from tripod_doe.analysis.kinds import makes_kind
from tripod_doe.errors import InputError, near_match
from tripod_doe.simulator import Outcome
from tripod_doe.study.cube import COST_VARIABLES
from tripod_doe.study.designs import salib_problem, unit_sample
from tripod_doe.study.file import DesignTable, FactorTable, parse_file

__all__ = ["MorrisSettings", "SobolSettings", "morris_effects", "sobol_indices"]

FloatArray = NDArray[np.float64]

_CONSTANT = 1e-9  # spread below which an output does not vary, over its largest magnitude


class SobolSettings(BaseModel):
    """[analysis.NAME] of kind sobol."""

    model_config = ConfigDict(extra="forbid")
    outputs: list[str] = Field([], description="outputs to analyse; if omitted, all kept ones except waveforms")
    confidence: float = Field(0.95, gt=0, lt=1, description="level of the confidence intervals")
    resamples: int = Field(100, ge=10, description="bootstrap resamples of the confidence intervals")
    seed: int = Field(0, ge=0, description="seed of the resampling")


class MorrisSettings(SobolSettings):
    """[analysis.NAME] of kind morris."""


@makes_kind("sobol")
def sobol_indices(cube: xr.Dataset, settings: SobolSettings | None = None) -> xr.Dataset:
    """First-order, total and second-order Sobol' indices with confidence intervals.

    S1_i = V[E(Y | x_i)] / V[Y], ST_i = E[V(Y | x_~i)] / V[Y]; estimators of Saltelli (2010), intervals by bootstrap.

    Parameters
    ----------
    cube
        Cube of a saltelli design; N (2 D + 2) points, or N (D + 2) without second order.
    settings
        Which outputs, and the level of the intervals.

    Returns
    -------
    xarray.Dataset
        S1, S1_conf, ST, ST_conf (factor, and the dimensions of the output) and S2, S2_conf (factor, factor_2, ...);
        with several outputs also along ``output``. NaN where an output does not vary.

    Raises
    ------
    InputError
        If the cube is of another design, or too few complete blocks are left.
    """
    from SALib.analyze import sobol as salib_sobol  # with scipy.stats, a second of every start

    settings = settings or SobolSettings()
    design, names = _design_of(cube, "saltelli")
    second = design.second_order
    rows = 2 * len(names) + 2 if second else len(names) + 2

    def analyse(output: FloatArray) -> dict[str, FloatArray]:
        answer = salib_sobol.analyze(
            salib_problem(names), output, calc_second_order=second, num_resamples=settings.resamples,
            conf_level=settings.confidence, seed=settings.seed + 1,  # SALib takes 0 for no seed at all
        )  # fmt: skip
        keys = ("S1", "S1_conf", "ST", "ST_conf") + (("S2", "S2_conf") if second else ())
        return {key: np.asarray(answer[key], float) for key in keys}

    return _analyse_outputs(cube, settings, names, rows, analyse, "Sobol' index")


@makes_kind("morris")
def morris_effects(cube: xr.Dataset, settings: MorrisSettings | None = None) -> xr.Dataset:
    """Morris' elementary effects: mean mu, mean of magnitudes mu_star with its interval, standard deviation sigma.

    Effects are per whole range of a factor, in the unit of the output; estimators of Campolongo (2007).

    Parameters
    ----------
    cube
        Cube of a morris design.
    settings
        Which outputs, and the level of the intervals.

    Returns
    -------
    xarray.Dataset
        mu, mu_star, mu_star_conf, sigma (factor, and the dimensions of the output; with several outputs also along
        ``output``).

    Raises
    ------
    InputError
        If the cube is of another design, or too few complete trajectories are left.
    """
    from SALib.analyze import morris as salib_morris

    settings = settings or MorrisSettings()
    design, names = _design_of(cube, "morris")
    unit = unit_sample(design, names)
    levels = design.levels or 4
    whole = _complete(cube, len(names) + 1, _chosen(cube, settings))

    def analyse(output: FloatArray) -> dict[str, FloatArray]:
        answer = salib_morris.analyze(
            salib_problem(names), unit[whole], output, num_levels=levels, num_resamples=settings.resamples,
            conf_level=settings.confidence, seed=settings.seed,
        )  # fmt: skip
        return {key: np.asarray(answer[key], float) for key in ("mu", "mu_star", "mu_star_conf", "sigma")}

    return _analyse_outputs(cube, settings, names, len(names) + 1, analyse, "Morris measure")


def _design_of(cube: xr.Dataset, kind: str) -> tuple[DesignTable, dict[str, FactorTable]]:
    """Design and factor names of the study that the cube carries."""
    file = parse_file(cube.attrs["study"], "the study in the cube")
    if file.design.kind != kind:
        raise InputError(f"this analysis needs a {kind} design, the cube's is {file.design.kind}")
    return file.design, file.factors


def _complete(cube: xr.Dataset, rows: int, outputs: Iterable[str]) -> NDArray[np.bool_]:
    """Points of those groups of `rows` that all finished and gave numbers, shape (point,).

    A finished point may lack one: a function returned NaN, a model cannot give the output. SALib would not say so.
    """
    usable = cube["outcome"].values == Outcome.FINISHED
    for name in outputs:
        given = np.isfinite(cube[name].values.reshape(usable.size, -1)).all(axis=1)
        if given.any():  # an output that no point gives takes nothing away from the others
            usable = usable & given
    return np.repeat(usable.reshape(-1, rows).all(axis=1), rows)


def _chosen(cube: xr.Dataset, settings: SobolSettings) -> list[str]:
    outputs = [
        str(name)
        for name, variable in cube.data_vars.items()
        if variable.dtype.kind == "f" and name not in COST_VARIABLES
    ]
    for name in settings.outputs:
        if name not in outputs:
            raise InputError(f"outputs: {name!r} is not in the cube{near_match(name, outputs)}")
    chosen = settings.outputs or [name for name in outputs if "rotation_deg" not in cube[name].dims] or outputs
    if not chosen:
        raise InputError("no point finished: there is no output to analyse")
    return chosen


def _analyse_outputs(
    cube: xr.Dataset,
    settings: SobolSettings,
    names: Mapping[str, FactorTable],
    rows: int,
    analyse: Callable[[FloatArray], dict[str, FloatArray]],
    meaning: str,
) -> xr.Dataset:
    """Analyse every component of every chosen output, and put the answers under their labels."""
    chosen = _chosen(cube, settings)
    whole = _complete(cube, rows, chosen)
    groups, dropped = int(whole.sum()) // rows, int((~whole).sum()) // rows
    if groups < 2:
        raise InputError(f"only {groups} of {groups + dropped} groups of {rows} points finished: nothing to analyse")
    parts = [_analyse_output(cube[name].isel(point=whole), analyse) for name in chosen]
    result = parts[0]
    if len(parts) > 1:
        outputs = xr.DataArray(np.array(chosen, dtype=object), dims="output", name="output")
        result = xr.concat(parts, outputs, join="outer", coords="minimal", compat="equals")
    labels: dict[str, Any] = {"factor": list(names)} | ({"factor_2": list(names)} if "S2" in result else {})
    result = result.assign_coords(labels)
    for label in result.coords:
        result[label].attrs.setdefault("long_name", str(label).replace("_", " "))
    for key in result.data_vars:
        unit = {"units": "1"} if str(key).startswith("S") else {}
        result[key].attrs = {"long_name": f"{meaning} {key}"} | unit
    return result.assign_attrs(
        outputs=", ".join(chosen), groups_used=groups, groups_dropped=dropped, points_used=groups * rows,
        points_dropped=dropped * rows, confidence_level=settings.confidence,
    )  # fmt: skip


def _analyse_output(variable: xr.DataArray, analyse: Callable[[FloatArray], dict[str, FloatArray]]) -> xr.Dataset:
    """Analyse every component of one output; NaN where a component does not vary."""
    values = variable.values.astype(float)
    if "wraps_at" in variable.attrs:
        values = _around_mean(values)
    dims = tuple(str(dim) for dim in variable.dims[1:])
    template = analyse(np.arange(values.shape[0], dtype=float))  # shapes, for outputs that vary nowhere
    answers = {key: np.full((*answer.shape, *values.shape[1:]), np.nan) for key, answer in template.items()}
    for index, column in _varying(values):
        for key, answer in analyse(column).items():
            answers[key][(slice(None),) * answer.ndim + index] = answer
    variables = {key: (_index_dims(key) + dims, answer) for key, answer in answers.items()}
    return xr.Dataset(variables, coords={dim: variable[dim] for dim in dims if dim in variable.coords})


def _index_dims(key: str) -> tuple[str, ...]:
    return ("factor", "factor_2") if key.startswith("S2") else ("factor",)


def _varying(values: FloatArray) -> Iterator[tuple[tuple[int, ...], FloatArray]]:
    """The components of an output over the points that vary beyond rounding."""
    scale = np.abs(values).max()
    for index in np.ndindex(*values.shape[1:]):
        column = np.ascontiguousarray(values[(slice(None), *index)])
        if np.ptp(column) > _CONSTANT * scale:
            yield index, column


def _around_mean(degrees: FloatArray) -> FloatArray:
    """Angles relative to their circular mean, so that the wrap at +-180 deg is no variance."""
    mean = np.exp(1j * np.radians(degrees)).mean(axis=0)
    relative: FloatArray = np.degrees(np.angle(np.exp(1j * np.radians(degrees)) / np.where(mean == 0, 1, mean)))
    return relative
