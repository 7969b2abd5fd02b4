"""Effects of factors and their interactions by regression on coded levels, with the table of an analysis of variance.

A number is coded from -1 at its low to 1 at its high, on a logarithmic scale where it has one; a word by what sets it
apart from the first, about its mean, so that the effect of any other factor is its mean over the words. Terms are
single factors, products of two (``a:b``), and squares (``a^2``) where a factor has more than two levels, each as far as
the design separates it from those before.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from tripod_doe.analyses.encoding import is_numeric, scaled
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.main_effects.repeated_sample import numbered, varied_together
from tripod_doe.analyses.output_table import (
    OutputTable,
    answered_in_parts,
    is_course,
    meaning_of,
    output_attributes,
    side_by_side,
    stacked,
)
from tripod_doe.analyses.settings import IntervalSettings
from tripod_doe.analyses.usable_points import Sample, analysed_points, read_sample, whole_outputs
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.study.definition.study_file_schema import FactorTable

_ALIAS = 1e-8  # part of a column's length that the terms before must leave for it to be a term of its own
_ROUNDING = 1e-12  # part of the variance of an output below which nothing is left
_LEVERAGE = 1e-6  # least part of a point's residual that the fit leaves to it
_SAMPLED = ("latin-hypercube", "sobol", "halton", "rbd-fast")
_LISTED = ("grid", "table", "zip")
EFFECT_DESIGNS = (
    "full-factorial",
    "fractional-factorial",
    "plackett-burman",
    "central-composite",
    "box-behnken",
    *_LISTED,
    *_SAMPLED,
)
"""Designs whose points a regression can use."""


class EffectsSettings(IntervalSettings):
    """[analysis.NAME] of kind effects."""

    interactions: bool = Field(True, description="whether products of two factors are terms")
    squares: bool = Field(True, description="whether squares of factors with more than two levels are terms")


@dataclass(frozen=True)
class Terms:
    """Terms of a regression, and the terms that are aliased with them."""

    names: list[str]  # of the terms
    columns: FloatArray  # their values, shape (point, term)
    reach: FloatArray  # change of a term's value from low to high: 2 for factors and products, 1 for squares and words
    aliases: dict[str, list[str]]  # by a term that is left out, the terms whose effects hold its own
    # of a listed design whose points repeat settings of some factors: the number of this setting at each point, shape
    # (point,), and which terms have one of these factors, shape (term,)
    repeats: Sequence[tuple[IntArray, NDArray[np.bool_]]] = ()


def _coded(name: str, column: NDArray[np.generic], table: FactorTable) -> list[tuple[str, FloatArray, float]]:
    """Columns of one factor: name, values, and their change from low to high."""
    if not is_numeric(column):
        words = list(dict.fromkeys(map(str, table.values or np.unique(column.astype(str)))))
        if len(words) == 2:
            return [(name, np.where(column.astype(str) == words[1], 1.0, -1.0), 2.0)]
        share = 1 / len(words)
        return [(f"{name}={word}", (column.astype(str) == word) - share, 1.0) for word in words[1:]]
    numbers = column.astype(float)
    given = [float(value) for value in table.values or () if not isinstance(value, str)]
    low = table.low if table.low is not None else min(given, default=numbers.min())
    high = table.high if table.high is not None else max(given, default=numbers.max())
    if table.sampled_as == "log-uniform":
        numbers, low, high = np.log(numbers), np.log(low), np.log(high)
    return [(name, scaled(numbers, low, high), 2.0)] if high > low else []


def _terms(sample: Sample, settings: EffectsSettings) -> Terms:
    """The terms that the points separate, single factors first."""
    singles = [
        [part for part in _coded(name, sample.columns[name], sample.tables[name]) if np.ptp(part[1]) > 0]
        for name in sample.tables
    ]
    candidates = [part for parts in singles for part in parts]
    if settings.interactions:
        candidates += [
            (f"{one[0]}:{other[0]}", one[1] * other[1], 2.0 if one[2] == other[2] == 2 else 1.0)
            for first, second in combinations(singles, 2)
            for one in first
            for other in second
        ]
    if settings.squares:
        numbers = [part for parts in singles for part in parts if np.unique(np.abs(part[1]).round(9)).size > 1]
        candidates += [(f"{name}^2", values**2, 1.0) for name, values, reach in numbers if reach == 2]
    return _separable_terms(candidates, sample.rows.size)


def _separable_terms(candidates: list[tuple[str, FloatArray, float]], count: int) -> Terms:
    names, reach, columns = ["mean"], [1.0], [np.ones(count)]
    basis = [columns[0] / np.sqrt(count)]
    aliases: dict[str, list[str]] = {}
    for name, values, change in candidates:
        left = values.copy()
        for _ in range(2):  # Gram-Schmidt twice is enough
            for known in basis:
                left -= (known @ left) * known
        if np.linalg.norm(left) > _ALIAS * np.linalg.norm(values) and len(names) < count:
            names.append(name)
            reach.append(change)
            columns.append(values)
            basis.append(left / np.linalg.norm(left))
        else:
            parts = np.linalg.lstsq(np.stack(columns, axis=1), values)[0]
            aliases[name] = [names[at] for at in np.flatnonzero(np.abs(parts) > _ALIAS) if at > 0]
    return Terms(names[1:], np.stack(columns[1:], axis=1), np.array(reach[1:]), aliases)


def _with_repeats(terms: Terms, columns: Mapping[str, NDArray[np.generic]]) -> Terms:
    """The terms with the settings that points of a list repeat: the points scatter less than independent ones.

    Settings of single factors, and of factors that vary together, as in the rows of a table.
    """
    codes = {name: np.unique(column, return_inverse=True)[1] for name, column in columns.items()}
    sets = {frozenset(group) for name in codes for group in ([name], varied_together(codes, name))}
    members = [{part.partition("=")[0].removesuffix("^2") for part in name.split(":")} for name in terms.names]
    repeats = []
    for own in sets:
        at = numbered(codes[name] for name in own)
        concerned = np.array([bool(each & own) for each in members])
        if concerned.any() and int(at.max()) + 1 < at.size:
            repeats.append((at, concerned))
    return replace(terms, repeats=repeats)


def _setting_deviations(weights: FloatArray, q: FloatArray, rest: FloatArray, at: IntArray) -> tuple[FloatArray, float]:
    """Standard deviations of coefficients where only settings are independent (Liang and Zeger 1986), and what is left.

    Args:
        weights: Of the points in each coefficient, shape (term, point).
        q: Orthonormal columns of all terms, shape (point, column).
        rest: What the terms leave, shape (point, component).
        at: See `Terms.repeats`.

    Returns:
        ndarray, shape (term, component); number of settings less the number of columns between them.
    """
    from scipy.sparse import csr_array  # imported where it is used: every study would wait for it

    points = np.bincount(at)
    sums = csr_array((np.ones(at.size), (at, np.arange(at.size))), shape=(points.size, at.size))
    spare = points.size - float((((sums @ q) ** 2) / points[:, None]).sum())
    squares = [((sums @ (own[:, None] * rest)) ** 2).sum(axis=0) for own in weights]
    return np.sqrt(np.stack(squares) * points.size / max(spare, 1.0)), spare


def _pseudo_error(effects: FloatArray) -> FloatArray:
    """Lenth's (1989) pseudo standard error of the effects of a design without spare points, shape (component,)."""
    size = np.abs(effects)
    rough = 1.5 * np.median(size, axis=0)
    small = np.where(size < 2.5 * rough, size, np.nan)
    with np.errstate(invalid="ignore"):
        middle = np.nanmedian(np.where(np.isfinite(small).any(axis=0), small, 0.0), axis=0)
    return 1.5 * middle


def _local_deviations(inverse: FloatArray, q: FloatArray, rest: FloatArray) -> FloatArray:
    """Standard deviations of coefficients by HC3 (MacKinnon and White 1985), shape (term, component).

    What the terms leave of a curved response scatters more at the ends of a range than in the middle.
    """
    local = rest / np.maximum(1 - (q**2).sum(axis=1), _LEVERAGE)[:, None]
    return np.asarray(np.sqrt((inverse @ q.T) ** 2 @ local**2))


def _ratio(effects: FloatArray, error: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(error > 0, effects / error, np.where(effects == 0, 0, np.inf))


def _fit(terms: Terms, values: FloatArray, confidence: float, sampled: bool) -> dict[str, FloatArray]:
    """Effects, intervals and the analysis of variance of all columns at once."""
    from scipy import stats  # slow to import: every study would wait for it

    count, width = terms.columns.shape
    matrix = np.concatenate([np.ones((count, 1)), terms.columns], axis=1)
    q, r = np.linalg.qr(matrix)
    projected = q.T @ values
    coefficients = np.linalg.solve(r, projected)
    spread = ((values - values.mean(axis=0)) ** 2).sum(axis=0)
    rest = values - matrix @ coefficients
    rest = np.where((rest**2).sum(axis=0) < _ROUNDING * spread, 0.0, rest)
    residual = (rest**2).sum(axis=0)
    spare, inverse = count - width - 1, np.linalg.inv(r)[1:]
    own = (inverse**2).sum(axis=1)[:, None]
    rounding = (residual == 0) & (coefficients[1:] ** 2 / own < _ROUNDING * spread)
    slopes = np.where(rounding, 0.0, coefficients[1:])
    effects = slopes * terms.reach[:, None]
    if spare > 0:
        plain = error = np.sqrt(own) * np.sqrt(residual / spare) * terms.reach[:, None]
        freedom: float = spare
        if sampled:
            error = np.maximum(plain, _local_deviations(inverse, q, rest) * terms.reach[:, None])
    else:
        plain = error = np.broadcast_to(_pseudo_error(effects), effects.shape)
        freedom = width / 3
    half = stats.t.ppf(0.5 + confidence / 2, freedom) * error
    chance = 2 * stats.t.sf(np.abs(_ratio(effects, error)), freedom)
    for at, concerned in terms.repeats if spare > 0 else ():
        error, left = _setting_deviations((inverse @ q.T)[concerned], q, rest, at)
        if left < 1 - _ALIAS:  # these settings have no scatter of their own
            continue
        error = error * terms.reach[concerned, None]
        half[concerned] = np.maximum(half[concerned], stats.t.ppf(0.5 + confidence / 2, left) * error)
        by_settings = 2 * stats.t.sf(np.abs(_ratio(effects[concerned], error)), left)
        chance[concerned] = np.maximum(chance[concerned], by_settings)
    return {
        "effect": effects,
        "effect_conf": half,
        "p_value": chance,
        "coefficient": slopes,
        "sum_of_squares": slopes**2 / own,  # of each term, given all others
        "f_value": _ratio(effects, plain) ** 2,
        "mean": coefficients[0],
        "residual_sum_of_squares": residual,
        "r_squared": 1 - residual / np.where(spread > 0, spread, np.nan),
    }


_MEANINGS = {
    "effect": "change of the output from low to high, of a square from the middle to the ends",
    "effect_conf": "half width of the interval of the effect",
    "p_value": "probability of such an effect by the scatter alone",
    "coefficient": "regression coefficient over coded levels",
    "sum_of_squares": "sum of squares that the term alone explains",
    "f_value": "mean square of the term over the mean square of the residual",
    "mean": "regression at coded levels zero",
    "residual_sum_of_squares": "sum of squares that no term explains",
    "r_squared": "share of the sum of squares that the terms explain",
}
_PURE = ("p_value", "f_value", "r_squared")


@makes_kind("effects")
def factorial_effects(cube: xr.Dataset, settings: EffectsSettings | None = None) -> xr.Dataset:
    """Effects of factors, interactions and squares with intervals, and the analysis of variance.

    Intervals and probabilities are those of Student's t with the scatter that the terms leave: of a deterministic model
    that is its lack of fit, and for a random sample the local one where it is larger. Where points of a list repeat
    settings of some factors, the scatter between settings counts where it is larger. A design without spare points
    takes Lenth's pseudo standard error. Of a factor without low and high these are the ends of its points.

    Returns:
        effect, effect_conf, p_value, coefficient, sum_of_squares, f_value (term, and the dimensions of the output; with
        several outputs also along ``output``, those with further dimensions as ``OUTPUT_effect``, see
        `output_table.side_by_side`); mean, residual_sum_of_squares, r_squared. The attribute ``aliases`` names by JSON
        the terms that are left out, each with those that hold its effect.

    Raises:
        InputError: If the cube is of another design, or too few points are left.
    """
    settings = settings or EffectsSettings()
    cube = analysed_points(cube)
    names, left_out = whole_outputs(cube, settings.outputs)
    sample = read_sample(cube, settings, EFFECT_DESIGNS, names)
    sampled = sample.design.kind in _SAMPLED
    if sample.design.kind in _LISTED:  # a point that is listed twice is one: its outputs are the same
        every = numbered(np.unique(column, return_inverse=True)[1] for column in sample.columns.values())
        sample = sample.take(np.sort(np.unique(every, return_index=True)[1]))
    terms = _terms(sample, settings)
    if sample.design.kind in _LISTED:
        terms = _with_repeats(terms, sample.columns)
    names = [name for name in names if not is_course(cube, name) or len(names) == 1]
    joint = side_by_side(cube, names)
    names = joint + [name for name in names if name not in joint]
    parts = {
        name: answered_in_parts(
            cube, name, sample.rows, lambda table: _of_output(terms, table, settings.confidence, sampled)
        )
        for name in names
    }
    result = stacked(parts, joint)
    result = result.assign_coords(term=np.array(terms.names, dtype=object))
    for name in result.data_vars:
        result[name].attrs = {"long_name": meaning_of(str(name), _MEANINGS)}
        result[name].attrs |= {"units": "1"} if str(name).endswith(_PURE) else {}
    return result.assign_attrs(
        **output_attributes(cube, names),
        aliases=json.dumps(terms.aliases),
        degrees_of_freedom=sample.rows.size - len(terms.names) - 1,
        confidence_level=settings.confidence,
        **sample.attributes,
        **left_out,
    )


def _of_output(terms: Terms, table: OutputTable, confidence: float, sampled: bool) -> xr.Dataset:
    """The fit of one output; NaN for components that do not vary."""
    answers: dict[str, FloatArray] = {}
    varies = table.varies
    for components in [*table.chunks()] or [np.array([0])]:  # where none varies, one shows the shapes
        for key, answer in _fit(terms, table.values[:, components], confidence, sampled).items():
            blank = answers.setdefault(key, np.full((*answer.shape[:-1], table.values.shape[1]), np.nan))
            blank[..., components] = np.where(varies[components], answer, np.nan)
    answers["mean"] = table.placed(answers["mean"])
    return xr.Dataset(
        {key: table.labelled(answer, ("term",) if answer.ndim == 2 else ()) for key, answer in answers.items()}
    )
