"""The main results of a cube as labelled responses over the design."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import ZERO_AT, Outcome
from tripod_doe.page_parts.chosen_models import asked_orders, mixed_formulas
from tripod_doe.page_parts.words import ORDINALS, factor_text, factor_unit, spoken, with_brackets
from tripod_doe.phases import in_a_row, is_phase
from tripod_doe.study.cube.dataset import COST_VARIABLES, EXCLUDED, OF_FUNCTION, RECORD_ROLE, RESPONSE_ROLE, SWITCH_ROLE
from tripod_doe.study.definition.toml_text import parse_toml

_REPRESENTATIVE = "representative_points"  # attribute of a part of a cube: describes its points

_CHECKS = ("energy_residual", "largest_penetration_um")  # of the numerics: shown among the settings
ERRORS = ("thrust_amplitude_error", "thrust_amplitude_step_error", "thrust_amplitude_scatter")
"""Outputs with the numerical error of the orders."""

_VISIBLE = 5e-3  # orders below this part of the largest order get no sentence
_MOST_OWN = 6  # numbers of a function
_CLASSES = 10  # classes of a sampled factor
_MOST_LEVELS = 40  # a factor with more values than this is a sampled one
_LEAST_RATIO = 8.0  # of the largest to the smallest level, below which a logarithmic scale looks like a linear one
_REPETITION = "replicate"  # the factor that numbers repeated runs of one point


@dataclass(frozen=True)
class Response:
    """One number per point."""

    key: str  # its name in tables: the variable, with the order if it has one
    label: str  # in words, for instance ``third order``
    unit: str  # its unit for people, empty without dimension
    values: xr.DataArray  # over the dimensions of the design; NaN where the point did not finish
    error: float = 0.0  # difference of two means that numerical errors can cause; 0 if no error is known
    zero_at: tuple[str, ...] = ()  # factors without which it is zero

    @property
    def axis(self) -> str:
        """Label of an axis."""
        words = f"{self.label} of the thrust force" if self.key.startswith("thrust_amplitude") else self.label
        return with_brackets(words, self.unit)


@dataclass(frozen=True)
class Effect:
    """Dependence of a response on one factor: statistics over all other factors, each array of shape (level,)."""

    level: FloatArray  # values of the factor, or the means of ten equally filled classes of a sampled one
    # mean, lower, upper: mean and quartiles of the response
    mean: FloatArray
    lower: FloatArray
    upper: FloatArray
    count: IntArray  # finished points
    sampled: bool  # whether levels are classes


def point_text(cube: xr.Dataset, point: xr.Dataset) -> str:
    """The factors of one point in words: ``joint angle 10 deg, torque 50 N m``."""
    return ", ".join(factor_text(cube, name, point[name].item()) for name in factor_names(cube))


def design_kind(cube: xr.Dataset) -> str:
    """Kind of the design as named in the study file; empty if the cube holds no study."""
    study = study_tables(cube)
    return str(study.get("design", {}).get("kind", "grid")) if study else ""


def study_tables(cube: xr.Dataset) -> dict[str, dict[str, Any]]:
    """The tables of the study file in a cube; empty if it holds none, or something else in the place of the file."""
    try:
        study = parse_toml(str(cube.attrs.get("study", "")), "the study of this cube")
    except InputError:
        return {}
    return {name: table for name, table in study.items() if isinstance(table, dict)}


def finished(cube: xr.Dataset) -> xr.DataArray:
    """Whether the points finished, over the dimensions of the design."""
    return cube["outcome"] == Outcome.FINISHED


def waiting(cube: xr.Dataset) -> xr.DataArray:
    """Whether a point is still to be computed: the study runs, or was interrupted."""
    return (cube["outcome"] == Outcome.NOT_RUN) & asked(cube)


def asked(cube: xr.Dataset) -> xr.DataArray:
    """Whether the point must run: True for all points except those that a constraint excludes."""
    return cube[EXCLUDED] == 0 if EXCLUDED in cube else xr.ones_like(cube["outcome"], dtype=bool)


def computed_once(cube: xr.Dataset) -> xr.Dataset:
    """The points without those that repeat another one: these are computed once, and have its results and its costs."""
    if cube["outcome"].dims != ("point",):
        return cube  # a grid has no point twice
    columns = point_columns(cube, np.ones(cube.sizes["point"], bool))
    if not columns:
        return cube
    again = pd.DataFrame(columns).duplicated().to_numpy()
    return cube.isel(point=np.flatnonzero(~again)) if again.any() else cube


def representative_points(cube: xr.Dataset) -> xr.Dataset:
    """The points over which a mean describes the joint; all points of most cubes.

    For an ablation these are the points with all switches on, without the switches; for a multifidelity study the
    points of the model that counts as the truth, since a mean over several models belongs to none of them. The
    analyses state the contribution of each mechanism, and the result of all models together.
    """
    if switches := [name for name in factor_names(cube) if cube[name].attrs.get("role") == SWITCH_ROLE]:
        on = np.all([cube[name].values == 1 for name in switches], axis=0)
        return (
            cube.isel(point=np.flatnonzero(on))
            .drop_vars(switches)
            .assign_attrs({_REPRESENTATIVE: "with all mechanisms on"})
        )
    if design_kind(cube) != "multifidelity":
        return cube
    fidelity, truth = truth_of(cube)
    own = np.flatnonzero(cube[fidelity].values == truth)
    count = int(finished(cube).values[own].sum())
    points_text = f"of the {count:,} {'finished ' * (count < own.size)}points by {truth}, which counts as the truth"
    return cube.isel(point=own).drop_vars(fidelity).assign_attrs({_REPRESENTATIVE: points_text})


def points_in_words(points: xr.Dataset) -> str:
    """The points that represent the joint, as the end of a sentence; empty if all points do."""
    return str(points.attrs.get(_REPRESENTATIVE, ""))


def truth_of(cube: xr.Dataset) -> tuple[str, object]:
    """The factor that names the models of a multifidelity study, and the model that counts as the truth."""
    study = study_tables(cube)
    fidelity = str(study["design"].get("fidelity", "model"))
    values = study.get("factors", {}).get(fidelity, {}).get("values")
    return fidelity, values[-1] if values else cube[fidelity].values[0]  # its samples come first


def factor_names(cube: xr.Dataset) -> list[str]:
    """Names of the factors, in the order of the study file."""
    design = cube["outcome"].dims
    if design == ("point",):
        labels = ("point", "varied")
        return [
            str(name)
            for name in cube.coords
            if cube[name].dims == design and name not in labels and "source" in cube[name].attrs
        ]
    return [str(dim) for dim in design]


def point_columns(cube: xr.Dataset, rows: NDArray[np.bool_]) -> dict[str, NDArray[np.generic]]:
    """Values of all factors at chosen points, shape (point,); words, and numbers with open fields, as text."""
    columns, design = {}, cube["outcome"].sizes
    for name in factor_names(cube):
        (own,) = cube[name].dims
        beside = [size if dimension == own else 1 for dimension, size in design.items()]
        # without xr.broadcast, which costs 20 times as much
        values = np.broadcast_to(cube[name].values.reshape(beside), tuple(design.values()))[rows]
        words = values.dtype.kind not in "fiu" or bool(np.isnan(values.astype(float)).any())
        columns[name] = values.astype(str) if words else values
    return columns


def varies(column: NDArray[np.generic]) -> bool:
    """Whether the values of a factor (`point_columns`) differ; sorting them would take ten times as long."""
    return column.size > 1 and bool((column != column[0]).any())


def numeric_factors(cube: xr.Dataset) -> list[str]:
    """Factors that are quantities and take more than one value, except the number of a repetition."""
    numbers = [name for name in factor_names(cube) if cube[name].dtype.kind in "fiu" and name != _REPETITION]
    return [name for name in numbers if np.ptp(cube[name].values) > 0]


def spaced_by_ratios(values: NDArray[np.generic]) -> bool:
    """Whether numbers lie more evenly on a logarithmic scale than on a linear one, over a ratio of at least 8."""
    levels = np.unique(values.astype(float))
    if levels.size < 3 or not levels[0] > 0 or levels[-1] / levels[0] < _LEAST_RATIO:
        return False
    even = np.linspace(0, 1, levels.size)
    scales = (np.log(levels), levels)
    by_ratios, by_steps = (np.abs((each - each[0]) / np.ptp(each) - even).sum() for each in scales)
    return bool(by_ratios < by_steps)


def logarithmic_factors(cube: xr.Dataset) -> set[str]:
    """Factors on a logarithmic scale: those that the study gives one, and those whose listed values lie by ratios."""
    tables = study_tables(cube).get("factors", {})
    found = set()
    for name in numeric_factors(cube):
        table, values = tables.get(name), cube[name].values
        if isinstance(table, dict) and "low" in table:
            usual = f"{table.get('scale')}-uniform"  # as `FactorTable.sampled_as`
            log = table.get("distribution", usual) == "log-uniform"
        else:
            log = not (isinstance(table, dict) and "mean" in table) and spaced_by_ratios(values)
        if log and values.min() > 0:
            found.add(name)
    return found


def responses(cube: xr.Dataset) -> list[Response]:
    """The responses that sentences and figures show: orders of the thrust and own responses, or numbers of a function.

    Leaves out orders that are small against the largest order, and checks of the numerics; if a pilot chose the models,
    also orders without a requested accuracy, and formulas that may use them: they come from different models at
    different points. Phases are left out where they lie in no half of the circle.
    """
    chosen: list[Response] = []
    if "thrust_amplitude" in cube:
        amplitude = cube["thrust_amplitude"]
        largest = float(amplitude.max()) if amplitude.notnull().any() else 0.0
        wanted = asked_orders(cube)
        for order in (3, 2, 1) if wanted is None else wanted:
            values = amplitude.sel(order=order, drop=True)
            if order == 3 or wanted is not None or float(values.max()) > _VISIBLE * largest:
                error = _error_of_order(cube, order)
                zero_at = tuple(str(amplitude.attrs.get(ZERO_AT, "")).split())
                chosen.append(Response(f"thrust_amplitude_order_{order}", ORDINALS[order], "N", values, error, zero_at))
    own = ((name, _values(cube[name])) for name in _own_names(cube))
    return chosen + [
        Response(name, _own_label(cube, name), factor_unit(cube, name), values)
        for name, values in own
        if values is not None
    ]


def _own_names(cube: xr.Dataset) -> list[str]:
    """Variables with one number per point: the responses of the joint, or numbers of a function."""
    names = [str(name) for name in cube.data_vars]
    if "thrust_amplitude" in cube:
        mixed = mixed_formulas(cube)
        return [name for name in names if cube[name].attrs.get("role") == RESPONSE_ROLE and name not in mixed]
    return [name for name in names if _is_own(cube, name) and name not in _CHECKS][:_MOST_OWN]


def _values(variable: xr.DataArray) -> xr.DataArray | None:
    """The values of a response: no infinite ones, and phases that do not jump at 180 deg; None if they must."""
    known = variable.where(np.isfinite(variable))
    row = in_a_row(known.values) if is_phase(variable) else known.values
    return None if row is None else known.copy(data=row)


def phases_all_round(cube: xr.Dataset) -> list[str]:
    """Responses that `responses` leaves out: phases in no half of the circle, which have no order."""
    return [name for name in _own_names(cube) if _values(cube[name]) is None]


def _error_of_order(cube: xr.Dataset, order: int) -> float:
    """Twice the mean numerical error that the runs report: each of two means may have it."""
    known = [cube[name].sel(order=order) for name in ERRORS if name in cube]
    errors = [float(values.mean()) for values in known if bool(values.notnull().any())]
    return 2 * max(errors, default=0.0)


def _is_own(cube: xr.Dataset, name: str) -> bool:
    variable = cube[name]
    recorded = name in COST_VARIABLES or variable.attrs.get("role") == RECORD_ROLE
    return not recorded and variable.dtype.kind == "f" and variable.dims == cube["outcome"].dims


def _own_label(cube: xr.Dataset, name: str) -> str:
    """A variable in words; an output of a user's function, or a response, keeps its name."""
    attrs = cube[name].attrs
    is_named = attrs.get("role") == RESPONSE_ROLE or attrs.get("long_name") == OF_FUNCTION
    return name if is_named else spoken(name)


def zero_between(cube: xr.Dataset, response: Response, factor: str, levels: FloatArray) -> float | None:
    """The response at the zero of a factor, which was not computed, between levels of opposite signs.

    Args:
        cube: The cube, whose outputs name the factors that make them zero.

    Returns:
        0 if the response is zero there; NaN if another output is zero there, so that no line may cross it; None if no
        output is zero there, or the zero is one of the levels, or not between them.
    """
    if levels.size < 2 or 0 in levels or not levels[0] < 0 < levels[-1]:
        return None
    if factor in response.zero_at:
        return 0.0
    known = (str(variable.attrs.get(ZERO_AT, "")).split() for variable in cube.data_vars.values())
    return np.nan if any(factor in names for names in known) else None


def along(response: Response, cube: xr.Dataset, factor: str) -> tuple[FloatArray, FloatArray]:
    """Every point's factor value and response, shape (point,) each.

    Only finished points; in a one-at-a-time design only the base point and the points that vary this factor.
    """
    values, levels = xr.broadcast(response.values, cube[factor])
    good = np.isfinite(values.values)
    if "varied" in cube.coords:
        good &= np.isin(cube["varied"].values, ("base", factor))
    return levels.values[good].astype(float), values.values[good].astype(float)


def main_effect(response: Response, cube: xr.Dataset, factor: str, logarithmic: bool = False) -> Effect:
    """Mean and quartiles of the response at each value of a factor, over all others.

    Args:
        logarithmic: Whether the factor has a logarithmic scale: levels of classes are then geometric means.
    """
    levels, values = along(response, cube, factor)
    distinct = np.unique(levels)
    sampled = distinct.size > _MOST_LEVELS
    if sampled:
        edges = np.quantile(levels, np.linspace(0, 1, _CLASSES + 1))
        group = np.clip(np.searchsorted(edges, levels, side="right") - 1, 0, _CLASSES - 1)
    else:
        group = np.searchsorted(distinct, levels)
    members = [np.flatnonzero(group == which) for which in np.unique(group)]
    lower, upper = (np.array([np.quantile(values[rows], part) for rows in members]) for part in (0.25, 0.75))
    places = np.log(levels) if logarithmic else levels
    means = np.array([places[rows].mean() for rows in members])
    return Effect(
        level=(np.exp(means) if logarithmic else means) if sampled else distinct,
        mean=np.array([values[rows].mean() for rows in members]),
        lower=lower,
        upper=upper,
        count=np.array([rows.size for rows in members], np.int64),
        sampled=sampled,
    )
