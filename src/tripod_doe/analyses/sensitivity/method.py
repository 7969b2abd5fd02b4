"""The frame of every sensitivity analysis: read the points, estimate all outputs at once, judge, label.

A method only estimates. What holds for all of them stands here: which points count, intervals that cover zero, effects
below the numerical error of the model, convergence over nested subsamples, and the labels of the result.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.bootstrap import FEWEST_DECIDING, deciding
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.output_table import OutputTable, answered_in_parts, output_attributes, side_by_side, stacked
from tripod_doe.analyses.settings import PointSettings, SensitivitySettings
from tripod_doe.analyses.usable_points import Sample, analysed_points, read_sample, whole_outputs
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import cf_flags

Answers = dict[str, FloatArray]
"""Estimates by the names of variables, the component last."""

DEPENDENT = (
    "its index divides the variance among independent factors; factors of this study are correlated or constrained"
)
"""Why an analysis is refused whose factors depend on each other."""

_FRACTIONS = (8, 4, 2)  # parts of the points over which the convergence is looked at
_FEWEST = 16  # blocks of the smallest part
_NOTED = {"confidence_level": "confidence", "precision": "precision"}  # settings that a result states
_RESOLUTION = ("constant", "not_resolved", "resolved", "below_numerical_error")  # from -1


@dataclass(frozen=True)
class Method:
    """One way to estimate what the factors do to the outputs."""

    # (points, output, components, settings) -> answers, each of shape (factor, component) unless `dims` says else. The
    # answer named ``size`` is the change of the output that a factor makes, in the output's unit.
    estimate: Callable[[Sample, OutputTable, IntArray, Any], Answers]
    designs: tuple[str, ...]  # kinds of designs that it can read
    ranked: str  # the answer by which factors are ranked
    meanings: Mapping[str, str]  # what each answer is, in words
    # dimensions of an answer before those of the output, where these are not just ``factor``
    dims: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    pure: bool = True  # whether the answers are numbers without unit
    nested: bool = True  # whether a part of the points is a smaller design of the same kind
    threshold: str = ""  # the answer that the ranked one must exceed to be resolved; zero if empty
    independent: bool = True  # whether it rests on factors that are not correlated
    judged: bool = True  # whether intervals, or a threshold, say which factors are resolved
    # whether intervals are those of resampled variances, which know nothing where a few blocks make up the variance
    resampled: bool = True
    fewest: int = 2  # blocks that it needs


def apply(method: Method, cube: xr.Dataset, settings: PointSettings) -> xr.Dataset:
    """Analyse all chosen outputs of a cube by one method.

    Returns:
        The answers (factor, and the dimensions of the output; with several outputs also along ``output``),
        ``resolved``, and over nested subsamples of the points ``RANKED_over_samples``; outputs with further dimensions
        that are not alone as ``OUTPUT_ANSWER``, see `output_table.side_by_side`. NaN where an output does not vary.

    Raises:
        InputError: If the cube is of another design, or too few complete blocks are left.
    """
    cube = analysed_points(cube)
    names, left_out = whole_outputs(cube, settings.outputs)
    sample = read_sample(cube, settings, method.designs, names)
    if method.independent and not sample.independent:
        raise InputError(DEPENDENT)
    if sample.blocks < method.fewest:
        raise InputError(f"this analysis needs at least {method.fewest} points, {sample.blocks} are left")
    joint = side_by_side(cube, names)
    names = joint + [name for name in names if name not in joint]
    result = stacked({name: _analyse(method, sample, cube, name, settings) for name in names}, joint)
    outputs = output_attributes(cube, names) | left_out
    return _described(result, method, sample, outputs, settings)


def analysis_of(
    method: Method, kind: str, meaning: str, settings: type[PointSettings] = SensitivitySettings
) -> Callable[..., xr.Dataset]:
    """The analysis of a kind: ``(cube, settings) -> result`` by `apply`; `meaning` is its docstring."""

    @makes_kind(kind)
    def analysis(cube: xr.Dataset, given: PointSettings | None = None) -> xr.Dataset:
        return apply(method, cube, given or settings())

    analysis.__doc__ = meaning
    return analysis


def _analyse(method: Method, sample: Sample, cube: xr.Dataset, name: str, settings: PointSettings) -> xr.Dataset:
    """One output, read as far as it fits into memory."""
    return answered_in_parts(cube, name, sample.rows, lambda table: _of_table(method, sample, table, settings))


def _of_table(method: Method, sample: Sample, table: OutputTable, settings: Any) -> xr.Dataset:
    """One output, or a part of it: answers for each of its components, their judgement, and their convergence."""
    answers = _estimate(method, sample, table, settings)
    size = answers.pop("size", None)
    result = _labelled(method, table, answers)
    if method.judged:
        result["resolved"] = table.labelled(_resolution(method, answers, table, size), _dims(method, method.ranked))
    if not method.nested or table.is_waveform:
        return result
    counts, parts = [], []
    for part in _nested(sample, method.fewest):
        counts.append(part.blocks)
        rows = np.searchsorted(sample.rows, part.rows)
        parts.append(_estimate(method, part, table.rows(rows), settings))
    counts.append(sample.blocks)
    parts.append(answers)
    for key in (each for each in (method.ranked, f"{method.ranked}_conf") if each in answers):
        course = np.stack([part[key] for part in parts])
        name = key.replace(method.ranked, f"{method.ranked}_over_samples")
        result[name] = table.labelled(course, ("samples", *_dims(method, method.ranked)))
    if f"{method.ranked}_conf" in answers:
        result["samples_needed"] = table.labelled(_needed(method, answers, sample, settings), ())
    return result.assign_coords(samples=np.array(counts, np.int32))


def _estimate(method: Method, sample: Sample, table: OutputTable, settings: PointSettings) -> Answers:
    """All components of an output, part by part; NaN for those that do not vary."""
    answers: Answers = {}
    for components in table.chunks():
        own = method.estimate(sample, table, components, settings)
        few = _deciding_blocks(sample, table, components) < FEWEST_DECIDING if method.resampled else False
        for key, answer in own.items():
            answer = np.where(few, np.nan, answer) if key.endswith("_conf") else answer
            blank = answers.setdefault(key, np.full((*answer.shape[:-1], table.values.shape[1]), np.nan))
            blank[..., components] = answer
    if not answers:  # shapes, of an output that varies nowhere
        first = np.linspace(0, 1, table.values.shape[0])[:, None] * np.ones(table.values.shape[1])
        varying = replace(table, values=first, wraps=False)
        shown = method.estimate(sample, varying, np.array([0]), settings)
        answers = {key: np.full((*answer.shape[:-1], table.values.shape[1]), np.nan) for key, answer in shown.items()}
    return answers


def _deciding_blocks(sample: Sample, table: OutputTable, components: IntArray) -> FloatArray:
    """How many blocks make up the variance, half of all at most, shape (component,)."""
    parts = table.parts(components)
    squares = ((parts - parts.mean(axis=1, keepdims=True)) ** 2).sum(axis=0)
    return np.minimum(deciding(squares.reshape(sample.blocks, sample.block, -1).mean(axis=1)), sample.blocks / 2)


def _resolution(method: Method, answers: Answers, table: OutputTable, size: FloatArray | None) -> FloatArray:
    """Flags of a factor: its interval covers the threshold (0), is above (1), or its effect below the error (2)."""
    index = answers[method.ranked]
    half = answers.get(f"{method.ranked}_conf", np.zeros_like(index))
    least = answers[method.threshold] if method.threshold else 0.0
    unknown = np.inf if method.resampled else 0.0
    flags = np.where(np.abs(index) - np.where(np.isfinite(half), half, unknown) > least, 1.0, 0.0)
    if size is not None:
        flags[np.abs(size) < table.error] = 2.0
    flags[~np.isfinite(index)] = -1.0
    return flags


def _nested(sample: Sample, fewest: int) -> Iterator[Sample]:
    """The first eighth, quarter and half of the blocks, as far as these are enough to say anything."""
    for fraction in _FRACTIONS:
        count = sample.blocks // fraction
        if count >= max(_FEWEST, fewest):
            yield sample.take(np.arange(count * sample.block))


def _needed(method: Method, answers: Answers, sample: Sample, settings: SensitivitySettings) -> FloatArray:
    """Samples after which no interval is wider than the precision, which shrinks with their square root.

    NaN where an index has no interval, since how it shrinks is not known.
    """
    index, half = np.abs(answers[method.ranked]), answers[f"{method.ranked}_conf"]
    known = ~without_interval(index, half).any(axis=0) & np.isfinite(index).any(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        widest = np.where(np.isfinite(half), half, -np.inf).max(axis=0) / np.where(
            np.isfinite(index), index, -np.inf
        ).max(axis=0)
        needed = np.ceil(sample.blocks * (widest / settings.precision) ** 2)
    if sample.design.kind == "saltelli":
        needed = np.where(needed > 1, 2.0 ** np.ceil(np.log2(np.maximum(needed, 1))), needed)
    return np.where(known, needed, np.nan)


def without_interval(index: FloatArray, half: FloatArray) -> NDArray[np.bool_]:
    """Which factors have an index above rounding and no interval; shape (factor, ...)."""
    rounding = 1e-9 * np.abs(index).max(axis=0, initial=0.0, where=np.isfinite(index))
    return np.isfinite(index) & (np.abs(index) > rounding) & ~np.isfinite(half)


def _dims(method: Method, key: str) -> tuple[str, ...]:
    return method.dims.get(key.removesuffix("_conf"), ("factor",))


def _labelled(method: Method, table: OutputTable, answers: Answers) -> xr.Dataset:
    return xr.Dataset({key: table.labelled(answer, _dims(method, key)) for key, answer in answers.items()})


def _described(
    result: xr.Dataset, method: Method, sample: Sample, outputs: dict[str, str], settings: PointSettings
) -> xr.Dataset:
    """Labels, meanings, flags, and what was used."""
    labels = {"factor": sample.factors} | ({"factor_2": sample.factors} if "factor_2" in result.dims else {})
    result = result.assign_coords({dim: values for dim, values in labels.items() if dim in result.dims})
    for name in list(result.data_vars):
        if str(name).endswith("resolved"):
            flags = result[name].fillna(-1).astype(np.int8)
            known = "whether the effect of a factor is known to differ from zero"
            result[name] = flags.assign_attrs(cf_flags(known, _RESOLUTION, -1))
        else:
            result[name].attrs = _attributes(str(name), method)
    return result.assign_attrs(
        **outputs,
        groups_used=sample.blocks,
        groups_dropped=math.ceil(sample.dropped / sample.block),
        block_size=sample.block,
        **{name: getattr(settings, key) for name, key in _NOTED.items() if hasattr(settings, key)},
        **sample.attributes,
    )


def _attributes(name: str, method: Method) -> dict[str, str]:
    if name.endswith("samples_needed"):
        return {"long_name": "samples after which no interval is wider than the precision", "units": "1"}
    key = next((each for each in sorted(method.meanings, key=len, reverse=True) if each in name), name)
    tail = ", half width of its interval" if name.endswith("_conf") else ""
    over = " over nested subsamples" if "_over_samples" in name else ""
    return {"long_name": f"{method.meanings.get(key, key)}{over}{tail}"} | ({"units": "1"} if method.pure else {})
