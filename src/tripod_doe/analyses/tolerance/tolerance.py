"""Tolerances: how manufacturing scatter distributes an output, and what halving the scatter of one factor would gain.

Quantiles and the probability to exceed a limit are those of the points, with intervals that hold for any distribution
and, where there is a limit, contain the numerical error. The error of the model, alike at all points, is next to
them. Halving needs no further points: each point counts by how much more often it would occur if that factor scattered
half as far about its centre.

Phases are ordered by their difference from the circular mean, and so is their limit.
"""

import json
from collections.abc import Collection, Iterable, Mapping
from typing import Annotated

import numpy as np
import xarray as xr
from pydantic import Field

from tripod_doe.analyses.bootstrap import FEWEST_DECIDING, bootstrap_weights, deciding, half_width
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.output_table import (
    OutputTable,
    is_course,
    output_attributes,
    read_outputs,
    stacked,
    usual_outputs,
)
from tripod_doe.analyses.settings import SHARES, Probabilities, ResampledSettings
from tripod_doe.analyses.tolerance.chances import Exceeding, exceeding, weighted_chances
from tripod_doe.analyses.tolerance.moved_nominal import shift_to_keep
from tripod_doe.analyses.tolerance.narrower_scatter import cheapest_to_keep, own_scatter, scale_to_keep, scaled_weights
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS, Sample, analysed_points, read_sample
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.study.cube.model_records import MODEL_ERROR_LIMIT
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file_schema import parse_file
from tripod_doe.study.designs.correlation import correlated_factors

_THIRD = "thrust_amplitude_3"  # the quantity whose error of the model is on record


class ToleranceSettings(ResampledSettings):
    """[analysis.NAME] of kind tolerance."""

    outputs: list[str] = Field(["thrust_amplitude"], description="outputs whose distribution is wanted")
    probabilities: Probabilities = Field([0.05, 0.5, 0.95, 0.99])
    limits: dict[str, float] = Field(
        {}, description="largest values allowed: OUTPUT_ORDER = value, as thrust_amplitude_3, or OUTPUT = value"
    )
    keep: float = Field(0.99, gt=0.5, lt=1, description="share of the joints that must keep the limits")
    confirm: int = Field(
        0,
        ge=0,
        le=10_000_000,
        description="number of other points that confirm the first proposed change for a limit; 0: none",
    )
    costs: dict[str, Annotated[float, Field(gt=0)]] = Field(
        {}, description="cost of halving the scatter of a factor; the scatter of a factor without one stays as it is"
    )


def _quantiles(values: FloatArray, probabilities: list[float], confidence: float) -> dict[str, FloatArray]:
    """Quantiles with distribution-free intervals from the order of the values, shape (probability, component).

    ``distribution`` has those of `SHARES`, without intervals.
    """
    from scipy import stats  # slow to import: every study would wait for it

    ordered, count = np.sort(values, axis=0), len(values)
    outside = (1 - confidence) / 2
    low = stats.binom.ppf(outside, count, probabilities).astype(int) - 1
    high = stats.binom.ppf(1 - outside, count, probabilities).astype(int)
    inside_low, inside_high = low >= 0, high < count  # beyond the sample nothing bounds the quantile
    answers = np.quantile(ordered, [*probabilities, *SHARES], axis=0, method="median_unbiased")
    return {
        "quantile": answers[: len(probabilities)],
        "distribution": answers[len(probabilities) :],
        "quantile_low": np.where(inside_low[:, None], ordered[np.maximum(low, 0)], np.nan),
        "quantile_high": np.where(inside_high[:, None], ordered[np.minimum(high, count - 1)], np.nan),
    }


def _exceedance(points: Exceeding, limit: FloatArray, confidence: float) -> dict[str, FloatArray]:
    """Probability to exceed a limit with Wilson's interval, shape (component,); NaN without limit."""
    from scipy import stats

    answers = np.full((3, limit.size), np.nan)
    for at in np.flatnonzero(np.isfinite(limit)):
        own = [each[:, at] for each in (points.surely, points.computed, points.possibly)]
        low, test, high = (stats.binomtest(int(each.sum()), each.size) for each in own)
        ends = [each.proportion_ci(confidence, method="wilson") for each in (low, high)]
        answers[:, at] = ends[0].low, test.statistic, ends[1].high
    return dict(zip(("exceedance_low", "exceedance", "exceedance_high"), answers, strict=True))


def _halved_weights(sample: Sample) -> FloatArray:
    """Weights of the points if one factor scattered half as far, shape (factor, point); NaN where it has no scatter."""
    half = np.array([0.5])
    return np.concatenate([scaled_weights(sample, name, half) for name in sample.tables])


def _gains(
    weights: FloatArray, values: FloatArray, points: Exceeding, limit: FloatArray, settings: ToleranceSettings
) -> dict[str, FloatArray]:
    """Gain of halving the scatter of each factor, shape (factor, component)."""
    draws = bootstrap_weights(len(values), settings.resamples, settings.seed)
    draws = np.concatenate([np.full((1, len(values)), 1 / len(values)), draws])
    centred = values - values.mean(axis=0)
    whole = np.sqrt(np.maximum(draws @ centred**2 - (draws @ centred) ** 2, 0))
    few = deciding(centred**2) < FEWEST_DECIDING
    gain, gain_conf = [], []
    for own in weights:
        drawn = draws * own
        total = drawn.sum(axis=1, keepdims=True)  # zero where a draw of few points has none within half the scatter
        drawn = drawn / np.where(total != 0, total, np.nan)
        halved = np.sqrt(np.maximum(drawn @ centred**2 - (drawn @ centred) ** 2, 0))
        part = 1 - halved / np.where(whole > 0, whole, np.nan)
        gain.append(part[0])
        gain_conf.append(np.where(few, np.nan, half_width(part[1:], settings.confidence)))
    low, chance, high = weighted_chances(weights, points).interval(settings.confidence).ends()
    halved = {"exceedance_if_halved_low": low, "exceedance_if_halved": chance, "exceedance_if_halved_high": high}
    return {"gain_of_halving": np.stack(gain), "gain_of_halving_conf": np.stack(gain_conf)} | {
        key: np.where(np.isfinite(limit) & np.isfinite(chance), answer, np.nan) for key, answer in halved.items()
    }


def _by_model(
    cube: xr.Dataset, sample: Sample, table: OutputTable, limit: FloatArray, settings: ToleranceSettings
) -> dict[str, FloatArray]:
    """The interval of the exceedance with the stated error of the model, NaN where none is stated."""
    ends = np.full((2, limit.size), np.nan)
    third = table.named(_THIRD)
    if MODEL_ERROR_LIMIT in cube and third.any():
        relative = cube[MODEL_ERROR_LIMIT].values[sample.rows]
        if np.isfinite(relative).any():
            error = np.nan_to_num(relative)[:, None] * np.abs(table.values[:, third]) + table.error[third]
            points = exceeding(table.values[:, third], limit[third], error)
            chances = _exceedance(points, limit[third], settings.confidence)
            ends[:, third] = chances["exceedance_low"], chances["exceedance_high"]
    return {"exceedance_model_low": ends[0], "exceedance_model_high": ends[1]}


def _limit_of_model(cube: xr.Dataset, sample: Sample) -> FloatArray:
    """The stated errors of the model at the points, shape (known,)."""
    errors = cube[MODEL_ERROR_LIMIT].values[sample.rows] if MODEL_ERROR_LIMIT in cube else np.empty(0)
    return np.asarray(errors[np.isfinite(errors)])


def _model_attributes(cube: xr.Dataset, sample: Sample) -> dict[str, str | float]:
    """The stated error in the middle of the points, and the finer models with their recorded prices; empty without."""
    limit = _limit_of_model(cube, sample)
    if not limit.size:
        return {}
    file, used = parse_file(cube.attrs["study"], "the study in the cube"), str(cube.attrs.get("models", "")).split(", ")
    simulator = load_simulator(file.study.scene)
    ranks = [rank for rank, name in enumerate(simulator.model_names, 1) if name in used]
    finer = simulator.model_names[max(ranks) :] if ranks else ()
    prices = {name: simulator.recorded_price({"model": name}) for name in finer}
    return {"model_error_usual": float(np.median(limit)), "finer_models": json.dumps(prices)}


def _limits(limits: Mapping[str, float], table: OutputTable) -> FloatArray:
    """The limit of each component of an output, NaN where there is none."""
    answers = np.full(table.values.shape[1], np.nan)
    for key, value in limits.items():
        answers[table.named(key)] = value
    return answers


def _check_limits(limits: Mapping[str, float], tables: list[OutputTable]) -> None:
    """Refuse a limit of nothing."""
    _refuse_unknown("limits", limits, "output or order of one", [key for table in tables for key in table.keys])


def _refuse_unknown(key: str, given: Iterable[str], what: str, known: Collection[str]) -> None:
    for name in given:
        if name not in known:
            raise InputError(f"{key}: {name!r} is no {what}{near_match(name, known)}")


def check_tolerance(settings: ToleranceSettings, study: Study) -> None:
    """Refuse limits and costs of nothing before any point runs; outputs of a function are known afterwards.

    Raises:
        InputError: With the nearest name that there is.
    """
    if not settings.limits and (unread := sorted(settings.model_fields_set & {"keep", "confirm", "costs"})):
        raise InputError(f"{', '.join(unread)}: used with limits only; leave out, or give limits")
    _refuse_unknown("costs", settings.costs, "factor", study.factors)
    outputs, responses = study.simulator.outputs, [response.name for response in study.responses]
    names = settings.outputs
    if "outputs" not in settings.model_fields_set:
        names = [*(names if {*names} <= {*study.keep} else study.keep), *responses]
    known = [*names, *(name for name in settings.limits if name.rpartition("_")[0] in responses)]  # maybe along order
    for name in names:
        if name in outputs and outputs[name].dims == ("order",):
            known += [f"{name}_{order}" for order in study.simulator.labels([name], study.base)["order"]]
    if outputs:
        _refuse_unknown("limits", settings.limits, "output or order of one", known)


def _of_output(cube: xr.Dataset, sample: Sample, table: OutputTable, settings: ToleranceSettings) -> xr.Dataset:
    values, limit, confidence = table.values, _limits(settings.limits, table), settings.confidence
    bound = table.relative(limit)
    points = exceeding(values, bound, np.broadcast_to(np.nan_to_num(table.error), values.shape))
    quantiles = _quantiles(values, settings.probabilities, confidence)
    quantiles = {key: table.placed(answer) for key, answer in quantiles.items()}
    single = _exceedance(points, bound, confidence) | _by_model(cube, sample, table, bound, settings)
    deviation = np.where(table.varies, values.std(axis=0, ddof=1), 0.0)
    single |= {"mean": table.placed(values.mean(axis=0)), "std": deviation, "limit": limit}
    gains = _gains(_halved_weights(sample), values, points, bound, settings)
    remedies = {key: np.where(table.varies, answer, np.nan) for key, answer in gains.items()}
    wanted = np.isfinite(bound) & (points.computed.mean(axis=0) > 1 - settings.keep)
    scales = scale_to_keep(sample, points, wanted, settings.keep, confidence)
    single["samples_to_resolve"] = scales.pop("samples_to_resolve")
    remedies |= shift_to_keep(sample, points, wanted, settings.keep, confidence)
    if settings.costs:
        remedies["cheapest_scale"], cheapest = cheapest_to_keep(
            sample, points, wanted, settings.keep, confidence, settings.costs
        )
        single |= cheapest
    return xr.Dataset(
        {"distribution": table.labelled(quantiles.pop("distribution"), ("share",))}
        | {key: table.labelled(answer, ("probability",)) for key, answer in quantiles.items()}
        | {key: table.labelled(answer, ()) for key, answer in single.items()}
        | {key: table.labelled(answer, ("factor",)) for key, answer in remedies.items()}
        | {key: table.labelled(answer, ("factor", "factor_2")) for key, answer in scales.items()}
    )


_WAYS = {
    "if_halved": "if the scatter of the factor is halved",
    "at_scale": "at scale_to_keep",
    "at_shift": "at shift_to_keep",
    "at_cheapest": "at cheapest_scale",
}
_ENDS = {"": "", "_low": "lower end of the interval of the ", "_high": "upper end of the interval of the "}
_MEANINGS = {
    "quantile": "value that the output stays below with the probability",
    "distribution": "value that the output stays below at the share of the points",
    "quantile_low": "lower end of the interval of the quantile",
    "quantile_high": "upper end of the interval of the quantile",
    "exceedance": "probability to exceed the limit",
    "exceedance_low": "lower end of the interval of the exceedance",
    "exceedance_high": "upper end of the interval of the exceedance",
    "gain_of_halving": "reduction of the standard deviation if the scatter of the factor is halved, as a fraction",
    "gain_of_halving_conf": "half width of the interval of the gain",
    "scale_to_keep": "largest scale of the scatter of two factors, or of one, that is resolved to keep the limit",
    "scale_excluded": "whether every scale of the scatter of two factors, or of one, is resolved to break the limit",
    "shift_to_keep": "smallest shift of the nominal value, in its unit, that is resolved to keep the limit",
    "cheapest_scale": "scale of the scatter of the factor in the cheapest set of one or two resolved to keep the limit",
    "cheapest_cost": "cost of that set, from the costs of halving each scatter",
    "samples_to_resolve": "points with which a smaller scatter of one factor or two would be resolved to suffice",
    **{
        f"exceedance_{way}{end}": f"{part}probability to exceed the limit {where}"
        for way, where in _WAYS.items()
        for end, part in _ENDS.items()
    },
    "exceedance_model_low": "lower end of the exceedance with the error of the model at nine in ten similar points",
    "exceedance_model_high": "upper end of the exceedance with the error of the model at nine in ten similar points",
    "mean": "mean",
    "std": "standard deviation",
    "limit": "largest value allowed",
}


@makes_kind("tolerance")
def tolerance(cube: xr.Dataset, settings: ToleranceSettings | None = None) -> xr.Dataset:
    """Distribution of outputs under the scatter of the factors, and what halving each scatter gains.

    Args:
        cube: Cube of a sampled design whose factors have the distributions of the manufacture. Where factors are
            correlated, halving one leaves the others as they are, given its value.

    Returns:
        quantile, quantile_low, quantile_high (probability, ...), distribution (share, ...), exceedance with its
        interval, gain_of_halving with its half width and exceedance_if_halved (factor, ...), scale_to_keep (factor,
        factor_2, ...), shift_to_keep (factor, ...), with costs cheapest_scale (factor, ...) and cheapest_cost, each
        with the exceedance that it leaves; samples_to_resolve, mean, std, limit; with the dimensions of the output, and
        with several outputs also along ``output``. The gain of a factor with listed values is NaN.

    Raises:
        InputError: If the cube is of another design, a limit is of no output, or too few points are left.
    """
    settings = settings or ToleranceSettings()
    cube = analysed_points(cube)
    names = usual_outputs(cube, settings.outputs, "outputs" in settings.model_fields_set)
    sample = read_sample(cube, settings, SAMPLED_DESIGNS, names)
    names = [name for name in names if not is_course(cube, name)]
    tables = list(read_outputs(cube, names, sample.rows))
    _check_limits(settings.limits, tables)
    _refuse_unknown("costs", settings.costs, "factor", sample.tables)
    parts = [_of_output(cube, sample, table, settings) for table in tables]
    result = stacked(dict(zip(names, parts, strict=True)), names)
    result = result.assign_coords(probability=settings.probabilities, share=SHARES, factor=list(sample.tables))
    result = result.assign_coords(factor_2=list(sample.tables))
    pure = ("exceedance", "gain", "scale", "cheapest", "samples")
    for name in result.data_vars:
        unit = {"units": "1"} if str(name).startswith(pure) else {}
        result[name].attrs = {"long_name": _MEANINGS[str(name)]} | unit
    return result.assign_attrs(
        **output_attributes(cube, names),
        confidence_level=settings.confidence,
        keep=settings.keep,
        confirm=settings.confirm,
        factor_tables=json.dumps({name: table.model_dump(exclude_none=True) for name, table in sample.tables.items()}),
        **_model_attributes(cube, sample),
        kind_of_points=sample.design.kind,
        seed_of_points=sample.design.seed,
        levels=", ".join(name for name in sample.tables if own_scatter(sample, name) is None),
        correlated=", ".join(correlated_factors(sample.design.correlation, list(sample.tables))),
        scramble_of_points=int(sample.design.scramble),
        samples_of_points=sample.design.samples or sample.rows.size,
        factor_units=json.dumps({name: str(cube[name].attrs.get("units", "1")) for name in sample.tables}),
        **sample.attributes,
    )
