"""A surrogate of each output over the factors, chosen by cross-validation, with its error from points it has not seen.

Candidates are a polynomial of the third degree, a Gaussian process and boosted trees, all by scikit-learn. The result
tells how far a picture or a what-if may rest on one; it is no result of a model, and no claim is judged by it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field
from threadpoolctl import threadpool_limits

from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.outputs import (
    OutputTable,
    chosen_outputs,
    is_course,
    output_attributes,
    read_outputs,
    stacked,
)
from tripod_doe.analyses.sample import Sample, read_sample
from tripod_doe.analyses.sensitivity.distributions import SAMPLED_DESIGNS
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.analyses.surrogate.what_if import what_if
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.flat_points import flat_points

SURROGATE_DESIGNS = (*SAMPLED_DESIGNS, "grid", "full-factorial", "central-composite", "box-behnken", "table")
"""Designs whose points a surrogate can learn from."""

_DEGREE = 3
_FEWEST = 10  # points that a cross-validation needs
_PROCESS_POINTS = 1000  # a Gaussian process costs the third power of its points


class SurrogateSettings(SensitivitySettings):
    """[analysis.NAME] of kind surrogate."""

    outputs: list[str] = Field(["thrust_amplitude"], description="outputs to learn")
    folds: int = Field(5, ge=2, description="parts of the points, each predicted by a surrogate of the others")


def _polynomial(width: int, seed: int) -> Any:
    from sklearn.linear_model import RidgeCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler

    terms = PolynomialFeatures(_DEGREE, include_bias=False)
    return make_pipeline(terms, StandardScaler(), RidgeCV(np.logspace(-8, 2, 11)))


def _process(width: int, seed: int) -> Any:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    kernel = ConstantKernel(1.0, (1e-3, 1e4)) * RBF(np.ones(width), (1e-2, 1e3)) + WhiteKernel(1e-6, (1e-12, 1.0))
    return GaussianProcessRegressor(kernel, normalize_y=True, random_state=seed)


def _boosting(width: int, seed: int) -> Any:
    from sklearn.ensemble import HistGradientBoostingRegressor

    return HistGradientBoostingRegressor(random_state=seed)


CANDIDATES: dict[str, Callable[[int, int], Any]] = {
    "polynomial": _polynomial,
    "gaussian-process": _process,
    "boosted-trees": _boosting,
}
"""Surrogates by name: (number of inputs, seed) -> regressor of scikit-learn."""


def _inputs(sample: Sample) -> FloatArray:
    """Factors from -1 to 1, a column for each word but the first, shape (point, input)."""
    columns = []
    for column in sample.columns.values():
        if column.dtype.kind in "fiu":
            numbers = column.astype(float)
            span = np.ptp(numbers)
            columns.append((2 * numbers - numbers.max() - numbers.min()) / (span if span > 0 else 1.0))
        else:
            columns += [(column == word).astype(float) for word in np.unique(column.astype(str))[1:]]
    return np.stack(columns, axis=1)


def _predictions(inputs: FloatArray, values: FloatArray, settings: SurrogateSettings) -> dict[str, FloatArray]:
    """What each candidate predicts at points that it has not seen, shape (point,)."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.model_selection import KFold, cross_val_predict

    folds = KFold(min(settings.folds, len(values)), shuffle=True, random_state=settings.seed)
    found = {}
    with warnings.catch_warnings(), threadpool_limits(1):  # small problems: threads would wait for each other
        warnings.simplefilter("ignore", ConvergenceWarning)  # a bound of a length scale: its error tells
        for name, make in CANDIDATES.items():
            if name == "gaussian-process" and len(values) > _PROCESS_POINTS:
                continue
            regressor = make(inputs.shape[1], settings.seed)
            found[name] = np.asarray(cross_val_predict(regressor, inputs, values, cv=folds), float)
    return found


def _of_output(sample: Sample, table: OutputTable, settings: SurrogateSettings) -> xr.Dataset:
    """Errors of the best candidate of each component; NaN for those that do not vary."""
    inputs, count = _inputs(sample), table.values.shape[1]
    error, largest, part = (np.full(count, np.nan) for _ in range(3))
    chosen = np.full(count, -1.0)
    for at in np.flatnonzero(table.varies):
        values = table.values[:, at]
        misses = {name: guess - values for name, guess in _predictions(inputs, values, settings).items()}
        best = min(misses, key=lambda name: float((misses[name] ** 2).mean()))
        error[at] = np.sqrt((misses[best] ** 2).mean())
        largest[at] = np.abs(misses[best]).max()
        part[at] = 1 - (misses[best] ** 2).mean() / values.var()
        chosen[at] = list(CANDIDATES).index(best)
    answers = {"error_rms": error, "error_largest": largest, "predicted_part": part, "chosen": chosen}
    return xr.Dataset({key: table.labelled(answer, ()) for key, answer in answers.items()})


_MEANINGS = {
    "error_rms": "root mean square error at points that the surrogate has not seen",
    "error_largest": "largest error at points that the surrogate has not seen",
    "predicted_part": "part of the variance that it predicts at points that it has not seen",
}


@makes_kind("surrogate")
def surrogate(cube: xr.Dataset, settings: SurrogateSettings | None = None) -> xr.Dataset:
    """How well a surrogate of each output predicts points that it has not seen.

    Parameters
    ----------
    cube
        Cube of a sampled, factorial or listed design.
    settings
        Which outputs, and the number of folds.

    Returns
    -------
    xarray.Dataset
        error_rms, error_largest, predicted_part and the flag chosen, with the dimensions of the output, and with
        several outputs also along ``output``. Phases are learnt relative to their circular mean.

    Raises
    ------
    InputError
        If the cube is of another design, or too few points are left.
    """
    settings = settings or SurrogateSettings()
    cube = flat_points(cube)
    default = "outputs" not in settings.model_fields_set and "thrust_amplitude" not in cube
    names = chosen_outputs(cube, [] if default else settings.outputs)
    sample = read_sample(cube, settings, SURROGATE_DESIGNS, names)
    if sample.rows.size < _FEWEST:
        raise InputError(f"a surrogate needs at least {_FEWEST} points, {sample.rows.size} finished")
    names = [name for name in names if not is_course(cube, name)]
    tables = list(read_outputs(cube, names, sample.rows))
    parts = [_of_output(sample, table, settings) for table in tables]
    result = stacked(dict(zip(names, parts, strict=True)), names)
    if any(table.varies.any() for table in tables):
        result = result.merge(what_if(sample, tables, cube, settings.seed), combine_attrs="no_conflicts")
    for name, meaning in _MEANINGS.items():
        result[name].attrs = {"long_name": meaning} | ({"units": "1"} if name == "predicted_part" else {})
    result["chosen"] = (
        result["chosen"]
        .fillna(-1)
        .astype(np.int8)
        .assign_attrs(
            long_name="surrogate with the smallest error",
            flag_values=np.arange(-1, len(CANDIDATES), dtype=np.int8),
            flag_meanings=" ".join(["constant", *CANDIDATES]),
        )
    )
    for label in result.coords:
        result[label].attrs.setdefault("long_name", str(label).replace("_", " "))
    return result.assign_attrs(
        **output_attributes(cube, names), points_used=sample.rows.size, points_dropped=sample.dropped
    )
