"""A surrogate of each output over the factors, with its error at points that it was not fitted to.

It says how far a picture or a what-if may rest on it; it is no result of a model, and no claim is judged by it.
"""

import numpy as np
import xarray as xr
from pydantic import Field

from tripod_doe.analyses.encoding import as_numbers
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.output_table import (
    OutputTable,
    is_course,
    output_attributes,
    read_outputs,
    stacked,
    usual_outputs,
)
from tripod_doe.analyses.settings import PointSettings
from tripod_doe.analyses.surrogate.gaussian_process import KINDS, learn
from tripod_doe.analyses.surrogate.what_if import what_if
from tripod_doe.analyses.surrogate.zeros_and_symmetries import KnownStructure, known_structure
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS, Sample, analysed_points, read_sample
from tripod_doe.errors import InputError
from tripod_doe.model_interface import MIRRORED_BY, ZERO_AT

SURROGATE_DESIGNS = (*SAMPLED_DESIGNS, "grid", "full-factorial", "central-composite", "box-behnken", "table")
"""Designs whose points a surrogate can learn from."""

_FEWEST = 10  # points that a cross-validation needs


class SurrogateSettings(PointSettings):
    """[analysis.NAME] of kind surrogate."""

    outputs: list[str] = Field(["thrust_amplitude"], description="outputs to learn")
    folds: int = Field(5, ge=2, le=100, description="parts of the points, each predicted by a surrogate of the others")
    seed: int = Field(0, ge=0, description="seed of these parts")


def _of_output(known: KnownStructure, sample: Sample, table: OutputTable, settings: SurrogateSettings) -> xr.Dataset:
    """Errors of the surrogate of each component; NaN for those that do not vary."""
    answers = {key: np.full(table.values.shape[1], np.nan) for key in _MEANINGS}
    chosen, at = np.full(table.values.shape[1], -1.0), np.flatnonzero(table.varies)
    if at.size:
        values = table.values[:, at]
        vanishes, mirrored = ZERO_AT in table.variable.attrs, MIRRORED_BY in table.variable.attrs
        marks = [vanishes] * at.size, [int(mirrored)] * at.size  # amplitudes stay as they are in a mirror
        known = known.fitted(sample.columns, values, marks, settings.seed)
        places, parts = known.places(sample.columns), known.of(sample.columns, *marks)
        learned = learn(places, values, settings.seed, settings.folds, parts)
        chosen[at] = learned.kinds
        answers["error_rms"][at] = np.sqrt((learned.errors**2).mean(axis=0))
        answers["error_largest"][at] = np.abs(learned.errors).max(axis=0)
        answers["predicted_part"][at] = 1 - (learned.errors**2).mean(axis=0) / values.var(axis=0)
    return xr.Dataset({key: table.labelled(answer, ()) for key, answer in (answers | {"chosen": chosen}).items()})


_MEANINGS = {
    "error_rms": "root mean square error at points that the surrogate has not seen",
    "error_largest": "largest error at points that the surrogate has not seen",
    "predicted_part": "part of the variance that it predicts at points that it has not seen",
}


@makes_kind("surrogate")
def surrogate(cube: xr.Dataset, settings: SurrogateSettings | None = None) -> xr.Dataset:
    """How well a surrogate of each output predicts points that it has not seen.

    Args:
        cube: Cube of a sampled, factorial or listed design.

    Returns:
        error_rms, error_largest, predicted_part and the flag chosen, with the dimensions of the output, and with
        several outputs also along ``output``. Phases are learned relative to their circular mean.

    Raises:
        InputError: If the cube is of another design, or too few points are left.
    """
    settings = settings or SurrogateSettings()
    cube = analysed_points(cube)
    names = usual_outputs(cube, settings.outputs, "outputs" in settings.model_fields_set)
    sample = read_sample(cube, settings, SURROGATE_DESIGNS, names)
    settings_of_factors = np.stack([as_numbers(column) for column in sample.columns.values()])
    if (different := np.unique(settings_of_factors, axis=1).shape[1]) < _FEWEST:
        raise InputError(f"a surrogate needs at least {_FEWEST} different points, {different} finished")
    names = [name for name in names if not is_course(cube, name)]
    tables = list(read_outputs(cube, names, sample.rows))
    known = known_structure(sample.columns, cube)
    parts = [_of_output(known, sample, table, settings) for table in tables]
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
            flag_values=np.arange(-1, len(KINDS), dtype=np.int8),
            flag_meanings=" ".join(["constant", *KINDS]),
        )
    )
    return result.assign_attrs(**output_attributes(cube, names), **sample.attributes)
