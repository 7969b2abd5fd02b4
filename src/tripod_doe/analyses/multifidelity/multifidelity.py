"""The multifidelity analysis: all outputs of a cube, with intervals and with the gain over the truth alone."""

from statistics import NormalDist

import numpy as np
import xarray as xr
from pydantic import Field

from tripod_doe.analyses.bootstrap import deciding
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.multifidelity.estimates import Estimate, estimate
from tripod_doe.analyses.multifidelity.nested_samples import Ladder, model_names, read_ladder
from tripod_doe.analyses.multifidelity.quantiles import quantiles
from tripod_doe.analyses.output_table import (
    OutputTable,
    chosen_outputs,
    meaning_of,
    output_attributes,
    read_outputs,
    side_by_side,
    stacked,
)
from tripod_doe.analyses.settings import SHARES, IntervalSettings, Probabilities
from tripod_doe.analyses.usable_points import analysed_points
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.slab_reading import any_finite
from tripod_doe.study.definition.study_file_schema import parse_file

Answers = dict[str, FloatArray]

_CONSTANT = 1e-9  # spread below which an output does not vary, over its largest magnitude


_FEWEST_DECIDING = 5  # samples that make up a variance: where fewer do, intervals of 95 % held in 42 to 84 %


class MultifidelitySettings(IntervalSettings):
    """[analysis.NAME] of kind multifidelity."""

    probabilities: Probabilities = Field([0.05, 0.5, 0.95])


def _half(estimated: Estimate, confidence: float) -> float:
    """Half width of the interval, by Student's distribution."""
    from scipy.special import stdtrit  # slow to import: every study would wait for it

    freedom = min(estimated.freedom, 1e9)
    return float(stdtrit(freedom, 0.5 + confidence / 2) * np.sqrt(estimated.variance))


def half_of_total(estimated: Estimate, confidence: float) -> float:
    """Half width of the interval of a total index: the upper side of an interval of its logarithm, up to one.

    Squares of few samples are skewed: at 16 and 48 samples of the truth symmetric intervals held in 90 to 97 %, these
    in 91 to 99 % (benchmarks/RESULTS.md).
    """
    half = _half(estimated, confidence)
    part = min(half / estimated.value, 1.0) if estimated.value > 0 else 1.0
    return half * float(np.expm1(part)) / part if half > 0 else half


def _gain(estimated: Estimate, alone: float) -> float:
    """Variance of the truth alone at the price of the whole study over the variance of the estimate."""
    return estimated.alone / alone / estimated.variance if estimated.variance > 0 else np.nan


def _of_component(values: list[FloatArray], alone: float, settings: MultifidelitySettings) -> Answers:
    """Answers for one component; `alone` is the number of samples that the truth alone would have at this price."""
    estimates = estimate(values)
    variance = estimates.variance.value
    answers: Answers = {
        "mean": np.array(estimates.mean.value),
        "mean_conf": np.array(_half(estimates.mean, settings.confidence)),
        "variance": np.array(variance),
        # of the logarithm, whose estimate is nearly normal: the upper, wider side
        "variance_conf": np.array(
            variance * np.expm1(_half(estimates.variance, settings.confidence) / variance) if variance > 0 else np.nan
        ),
        "gain": np.array(_gain(estimates.mean, alone)),
        "variance_gain": np.array(_gain(estimates.variance, alone)),
    }
    for name, indices, half in (("S1", estimates.first, _half), ("ST", estimates.total, half_of_total)):
        if indices:
            answers[name] = np.array([each.value for each in indices])
            answers[f"{name}_conf"] = np.array([half(each, settings.confidence) for each in indices])
            answers[f"{name}_gain"] = np.array([_gain(each, alone) for each in indices])
    points = [each[:, [0, -1]] if estimates.first else each for each in values]  # the independent points of a block
    if deciding(((points[0] - points[0].mean()) ** 2).mean(axis=1)) < _FEWEST_DECIDING:
        answers |= {key: np.full_like(answer, np.nan) for key, answer in answers.items() if key.endswith("_conf")}
    asked = len(settings.probabilities)
    bounds = quantiles(points, [*settings.probabilities, *SHARES], NormalDist().inv_cdf(0.5 + settings.confidence / 2))
    return answers | dict(zip(_QUANTILES, bounds[:, :asked], strict=True)) | {"distribution": bounds[0, asked:]}


def _correlations(values: list[FloatArray]) -> FloatArray:
    """Correlation of each model with the truth over the samples that both have, shape (model,); NaN for a constant."""
    correlations = []
    for each in values:
        count = min(len(values[0]), len(each))
        one, other = (part[:count].ravel() - part[:count].mean() for part in (values[0], each))
        with np.errstate(invalid="ignore"):
            correlations.append((one @ other) / np.sqrt((one @ one) * (other @ other)))
    return np.array(correlations)


_PLAIN = ("mean", "mean_conf", "variance", "variance_conf", "gain", "variance_gain")
_QUANTILES = ("quantile", "quantile_low", "quantile_high")
_INDICES = tuple(f"{index}{tail}" for index in ("S1", "ST") for tail in ("", "_conf", "_gain"))
_PLACES = ("mean", *_QUANTILES, "distribution")  # which move with the centre of phases


def _dims(ladder: Ladder) -> dict[str, tuple[str, ...]]:
    """The answers with their dimensions before those of the output."""
    indices = dict.fromkeys(_INDICES if ladder.design.indices else (), ("factor",))
    dims: dict[str, tuple[str, ...]] = dict.fromkeys(_PLAIN, ())
    dims |= dict.fromkeys(_QUANTILES, ("probability",)) | {"distribution": ("share",)}
    return dims | indices | {"correlation": ("model",)}


def _of_output(ladder: Ladder, table: OutputTable, settings: MultifidelitySettings) -> xr.Dataset:
    """All components of an output; of one that does not vary, the mean."""
    alone = ladder.price / ladder.truth.price
    sizes = {
        "probability": len(settings.probabilities),
        "share": len(SHARES),
        "factor": len(ladder.factors),
        "model": len(ladder.rungs) + len(ladder.aside),
    }
    dims, width = _dims(ladder), table.values.shape[1]
    largest = np.nanmax(np.abs(table.values), initial=0.0)  # of all components: an order may be rounding alone
    arrays = {key: np.full((*(sizes[dim] for dim in own), width), np.nan) for key, own in dims.items()}
    for component in range(width):
        values = ladder.values(table, component)
        arrays["mean"][component] = values[0].mean()
        if np.ptp(values[0]) > _CONSTANT * largest:
            every = values + [table.values[rung.rows, component] for rung in ladder.aside]
            answers = _of_component(values, alone, settings) | {"correlation": _correlations(every)}
            for key, answer in answers.items():
                arrays[key][..., component] = answer
    for key in _PLACES:
        arrays[key] = table.placed(arrays[key])
    return xr.Dataset({key: table.labelled(answer, dims[key]) for key, answer in arrays.items()})


def outputs_of_all(cube: xr.Dataset, asked: list[str]) -> list[str]:
    """Outputs to analyse: the requested ones, else all that every model gives, without courses over the rotation angle.

    Raises:
        InputError: If a model does not give a requested output.
    """
    models = model_names(cube, parse_file(cube.attrs["study"], "the study in the cube"))
    finished = cube["outcome"].values == Outcome.FINISHED
    names = []
    for name in chosen_outputs(cube, asked):
        if "rotation_deg" in cube[name].dims:
            if asked:
                raise InputError(f"outputs: {name} varies over the rotation angle; this analysis leaves it out")
            continue
        given = any_finite(cube[name].variable)
        without = [each for each in dict.fromkeys(models.tolist()) if not given[(models == each) & finished].any()]
        if without and asked:
            raise InputError(f"outputs: {' and '.join(without)} gives no {name}")
        if not without:
            names.append(name)
    if not names:
        raise InputError("no output is given by all models")
    return names


_MEANINGS = {
    "mean": "mean",
    "variance": "variance",
    "quantile": "value that the output stays below with the probability",
    "distribution": "value that the output stays below with the share as probability",
    "quantile_low": "lower end of the interval of the quantile",
    "quantile_high": "upper end of the interval of the quantile",
    "S1": "first-order Sobol' index",
    "ST": "total Sobol' index",
    "gain": "variance of the mean from the truth alone at the same price, over its variance here",
    "variance_gain": "variance of the variance from the truth alone at the same price, over its variance here",
    "S1_gain": "variance of S1 from the truth alone at the same price, over its variance here",
    "ST_gain": "variance of ST from the truth alone at the same price, over its variance here",
    "correlation": "correlation of the model with the truth",
    "samples": "samples of the model",
    "price": "CPU seconds of a sample",
}


@makes_kind("multifidelity")
def multifidelity(cube: xr.Dataset, settings: MultifidelitySettings | None = None) -> xr.Dataset:
    """Mean, variance, quantiles and Sobol' indices of the truth, from a few of its samples and many of cheaper models.

    Multifidelity Monte Carlo with control variates (Peherstorfer, Willcox and Gunzburger 2016), for the indices as Qian
    and others (2018); see `estimates` and `quantiles`.

    Returns:
        mean, variance, with their half widths and gains, quantile, quantile_low, quantile_high (probability, ...),
        distribution (share, ...), S1 and ST with theirs (factor, ...), correlation (model, ...), samples and price
        (model); with the dimensions of the output, and with several outputs also along ``output``. Gains are NaN where
        the prices are not known.

    Raises:
        InputError: If the cube is of another design, a model lacks an output, or too few samples are left.
    """
    settings = settings or MultifidelitySettings()
    cube = analysed_points(cube)
    names = outputs_of_all(cube, settings.outputs)
    ladder = read_ladder(cube, settings, names)
    tables = read_outputs(cube, names, np.arange(cube.sizes["point"]))
    joint = side_by_side(cube, names)
    result = stacked({table.name: _of_output(ladder, table, settings) for table in tables}, joint)
    models = [*ladder.rungs, *ladder.aside]
    result = result.assign(
        samples=("model", np.array([rung.count for rung in models], np.int32)),
        price=("model", np.array([rung.price for rung in models])),
    )
    labels: dict[str, list[object]] = {
        "probability": [*settings.probabilities],
        "share": [*SHARES],
        "factor": [*ladder.factors],
    }
    labels["model"] = [rung.model for rung in models]
    result = result.assign_coords({dim: values for dim, values in labels.items() if dim in result.dims})
    names = joint + [name for name in names if name not in joint]
    return _described(result, ladder, output_attributes(cube, names), cube.sizes["point"], settings)


def _described(
    result: xr.Dataset, ladder: Ladder, outputs: dict[str, str], points: int, settings: MultifidelitySettings
) -> xr.Dataset:
    """Meanings, units, and what was used."""
    without_unit = ("S1", "ST", "gain", "correlation", "samples")
    for name in map(str, result.data_vars):
        tail = ", half width of its interval" if name.endswith("_conf") else ""
        unit = {"units": "1"} if name.removesuffix("_conf").endswith(without_unit) else {}
        result[name].attrs = {"long_name": meaning_of(name.removesuffix("_conf"), _MEANINGS) + tail} | unit
    result["price"].attrs["units"] = "s"
    used = sum(rung.rows.size for rung in (*ladder.rungs, *ladder.aside))
    region = ladder.region.attributes(ladder.outside) if ladder.region else {}
    return result.assign_attrs(
        **outputs,
        truth=ladder.truth.model,
        samples_dropped=ladder.lost,
        block_size=ladder.block,
        points_used=used,
        points_dropped=points - used - (ladder.outside or 0),
        confidence_level=settings.confidence,
        **region,
    )
