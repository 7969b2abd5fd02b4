"""The result cube of a study, made from finished blocks: labelled, CF-conforming, checked against a schema."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import CubeError
from tripod_doe.model_interface import (
    DETAIL_ATTRIBUTES,
    MIRRORED_BY,
    OUTCOME_ATTRIBUTES,
    TRUST_ATTRIBUTES,
    ZERO_AT,
    BlockResult,
    Outcome,
    Output,
    Parameter,
    cf_flags,
    common_unit,
    refuse_other_dims,
    take_labels,
)
from tripod_doe.phases import PHASE_ATTRIBUTES, is_phase_name
from tripod_doe.study.cube.model_records import TRUST, ModelRecords
from tripod_doe.study.cube.netcdf import POINT_ATTRIBUTES
from tripod_doe.study.cube.provenance import cost_attributes, cube_attributes
from tripod_doe.study.cube.responses import ResponseValues, response_values
from tripod_doe.study.definition.responses import ERROR
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import SAMPLE, Points
from tripod_doe.study.fingerprints import KeyIndex
from tripod_doe.study.journal import PILOT, FinishedBlock

COST_VARIABLES = {
    "cpu_seconds": ("s", "CPU time of the point (its share of the block)"),
    "wall_seconds": ("s", "wall-clock time of the point (its share of the block)"),
    "steps": ("1", "time steps or sweeps"),
    "force_evaluations": ("1", "evaluations of all contact and friction forces"),
    "solves": ("1", "factorisations of a linear system"),
    "simulated_seconds": ("s", "time of the motion that was followed, up to the end or the failure"),
}
"""Units and meanings of the variables of cost.nc; the worker's name is next to them."""

EXCLUDED = "excluded"
"""Variable that flags the grid cells that a constraint excludes; missing if no cell is excluded."""

SWITCH_ROLE = "switch of the ablation"
"""Attribute ``role`` of the coordinates that an ablation switches, by which analyses recognise them."""

RECORD_ROLE = "record of the run"
"""Attribute ``role`` of variables that record the computation of a point, not its results."""

RESPONSE_ROLE = "result of its own"
"""Attribute ``role`` of outputs that reports show next to the main ones (`Output.response`)."""

ROW_OF_PART = "row of the sub-design"
"""Meaning of the coordinates that number the rows of a part of a product."""

PHASES = "phases"
"""Attribute of a result: which of its outputs are angles on a circle."""
RESPONSES = "responses"
"""Attribute of the result of an analysis: which of its outputs are responses."""

OF_FUNCTION = "output of a user function"
"""Meaning of a variable that a user's function returned."""

THIS_STUDY = "this study"
"""Source of a value that the study sets, instead of the paper or an assumption."""

PlacedBlock = tuple[FinishedBlock, IntArray, IntArray]
"""A block, the rows to use, and their places among the points."""

_USER_FUNCTION = "user function"
_LABELS = {"varied": "factor that is varied", SAMPLE: "sample that the point belongs to, the same in all models"}
_UNKNOWN = -1  # flag of a point that has not run, or of a choice that its model does not have


def build_cube(
    study: Study, points: Points, keys: NDArray[np.void], blocks: Iterator[FinishedBlock]
) -> tuple[xr.Dataset, xr.Dataset]:
    """Assemble cube and cost from finished blocks; points without a block are flagged as not_run.

    Args:
        blocks: Finished blocks, the newest last; other points in them are ignored.

    Returns:
        cube, cost: A dimension a factor for a grid, else one dimension ``point``.
    """
    index, models = KeyIndex(keys), ModelRecords(study)

    def placed(block: FinishedBlock) -> PlacedBlock:
        rows, at = index.places(block.keys)
        inside = points.allowed[at]
        return block, rows[inside], at[inside]

    cube, cost = part_of_cube(study, points, map(placed, blocks), models)
    return cube.assign_attrs(cube_attributes(study, points, models)), cost.assign_attrs(
        cost_attributes(study, points, models)
    )


def part_of_cube(
    study: Study, points: Points, results: Iterable[PlacedBlock], models: ModelRecords
) -> tuple[xr.Dataset, xr.Dataset]:
    """Cube and cost of some points, without attributes.

    Args:
        results: Finished blocks, the newest last, each with the rows to use and their places among the points.
        models: The summary to which the models of the points are added.
    """
    table = _Table(points.count)
    for block, rows, at in results:
        table.fill(block, rows, at)
    table.detail[~points.allowed] = "excluded by a constraint"
    used = _used_columns(study, table, points)
    own = list(response_values(study, points, table.outputs, table.coordinates, table.outcome == Outcome.FINISHED))
    kept = {name: values for name, values in table.outputs.items() if not study.keep or name in study.keep}
    along = {dim for dims in [*(dims for dims, _ in kept.values()), *(each.dims for each in own)] for dim in dims}
    labels = {dim: values for dim, values in table.coordinates.items() if dim in along}
    cube = xr.Dataset(
        {
            name: _variable(name, study.simulator.outputs.get(name), dims, data, points, table.units[name])
            for name, (dims, data) in kept.items()
        }
        | _response_variables(own, points)
        | _outcome_variables(table, points)
        | _choice_variables(table, points)
        | {
            name: _shaped(points, (), values, _record_attributes(name, meaning))
            for name, (values, meaning) in models.of(
                points,
                used,
                table.outcome == Outcome.FINISHED,
                {name: data for name, (_, data) in table.outputs.items() if data.ndim <= 2},
            ).items()
        }
        | _used_variables(study, used, points)
        | _retry_variables(study, table, points),
        coords=_coordinates(study, points, labels),
    )
    cost = xr.Dataset(
        {
            name: _shaped(points, (), data, {"units": COST_VARIABLES[name][0], "long_name": COST_VARIABLES[name][1]})
            for name, data in table.costs.items()
        }
        | {"worker": _shaped(points, (), table.worker, {"long_name": "process that computed the point"})},
        coords=_coordinates(study, points, {}),
    )
    _check_schema(study, cube)
    return cube, cost


def _record_attributes(name: str, meaning: str) -> dict[str, Any]:
    own = TRUST_ATTRIBUTES if name == TRUST else {"units": "1"}
    return {**own, "long_name": meaning, "role": RECORD_ROLE}


class _Table:
    """Results of all points, filled block by block."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.outputs: dict[str, tuple[tuple[str, ...], NDArray[Any]]] = {}
        self.units: dict[str, str] = {}
        self.coordinates: dict[str, NDArray[Any]] = {}
        self.outcome = np.full(count, Outcome.NOT_RUN, np.int8)
        self.detail = np.full(count, "", dtype=object)
        self.worker = np.full(count, "", dtype=object)
        self.costs = {name: np.full(count, np.nan) for name in COST_VARIABLES}
        self.attempt = np.full(count, _UNKNOWN, np.int8)
        self.first_outcome = self.outcome.copy()
        self.first_detail = self.detail.copy()
        self.used: dict[str, NDArray[Any]] = {}
        self.settled: dict[str, FloatArray] = {}

    def fill(self, block: FinishedBlock, rows: IntArray, at: IntArray) -> None:
        """Copy rows of a block to their places."""
        result: BlockResult = block.result
        for name, values in result.outputs.items():
            if name not in self.outputs:
                self.outputs[name] = (values.dims, np.full((self.count, *values.data.shape[1:]), np.nan))
            dims, target = self.outputs[name]
            refuse_other_dims(name, dims, values.dims)
            if target.shape[1:] != values.data.shape[1:]:
                raise CubeError(f"{name}: points have different shapes {target.shape[1:]} and {values.data.shape[1:]}")
            target[at] = values.data[rows]
            self.units[name] = common_unit(name, self.units.get(name, ""), values.unit)
        if at.size:
            take_labels(self.coordinates, result.coordinates)
        self.outcome[at] = result.outcome[rows]
        self.detail[at] = np.array(result.detail, dtype=object)[rows]
        self.worker[at] = block.worker
        self.costs["cpu_seconds"][at] = block.cpu_seconds / block.keys.size
        self.costs["wall_seconds"][at] = block.wall_seconds / block.keys.size
        for name in ("steps", "force_evaluations", "solves", "simulated_seconds"):
            self.costs[name][at] = getattr(result, name)[rows]
        for name, column in result.settled.items():
            self.settled.setdefault(name, np.full(self.count, np.nan))[at] = column[rows]
        if retries := result.retries:
            self.attempt[at] = retries.attempt[rows]
            self.first_outcome[at] = retries.first_outcome[rows]
            self.first_detail[at] = np.array(retries.first_detail, dtype=object)[rows]
            for name, column in retries.used.items():
                words = column.dtype.kind == "U"
                unknown = np.full(self.count, "", dtype=object) if words else np.full(self.count, np.nan)
                self.used.setdefault(name, unknown)[at] = column[rows]


def _shaped(points: Points, dims: tuple[str, ...], data: NDArray[Any], attrs: Mapping[str, Any]) -> xr.Variable:
    return xr.Variable((*points.dims, *dims), data.reshape(*points.shape, *data.shape[1:]), dict(attrs))


def _variable(
    name: str, output: Output | None, dims: tuple[str, ...], data: NDArray[Any], points: Points, unit: str
) -> xr.Variable:
    attrs = {"units": unit or ("degree" if is_phase_name(name) else "1"), "long_name": OF_FUNCTION}
    if output:
        attrs = {"units": output.unit, "long_name": output.meaning}
        if output.symbol:
            attrs["symbol"] = output.symbol
        if output.convention:
            attrs["comment"] = output.convention
        if output.response:
            attrs["role"] = RESPONSE_ROLE
        for key, names in ((ZERO_AT, output.zero_at), (MIRRORED_BY, output.mirrored_by)):
            if names:
                attrs[key] = " ".join(names)
    if is_phase_name(name):
        attrs |= PHASE_ATTRIBUTES
    return _shaped(points, dims, data, attrs)


def _response_variables(own: Iterable[ResponseValues], points: Points) -> dict[str, xr.Variable]:
    """Responses with their numerical errors; reports show those of one number a point."""
    variables = {}
    for each in own:
        role = {} if each.dims else {"role": RESPONSE_ROLE}
        variables[each.response.name] = _shaped(points, each.dims, each.values, each.attributes | role)
        if each.error is not None:
            attributes = each.error_attributes | {"role": RECORD_ROLE}
            variables[f"{each.response.name}{ERROR}"] = _shaped(points, each.dims, each.error, attributes)
    return variables


def _outcome_variables(table: _Table, points: Points) -> dict[str, xr.Variable]:
    variables = {
        "outcome": _shaped(points, (), table.outcome, OUTCOME_ATTRIBUTES),
        "outcome_detail": _shaped(points, (), table.detail, DETAIL_ATTRIBUTES),
    }
    if points.has_excluded:
        meaning = "whether a constraint of the design excludes the point"
        variables[EXCLUDED] = _shaped(points, (), (~points.allowed).astype(np.int8), _yes_or_no(meaning))
    return variables


def _yes_or_no(meaning: str) -> dict[str, Any]:
    """Attributes of a flag that says how a point was computed."""
    return {
        "long_name": meaning,
        "role": RECORD_ROLE,
        "flag_values": np.array([0, 1], np.int8),
        "flag_meanings": "no yes",
    }


def _retry_variables(study: Study, table: _Table, points: Points) -> dict[str, xr.Variable]:
    """The last attempt at each point, and the outcome of the first."""
    if not study.retry.changes:
        return {}
    labels = ["not_run", "first", *(f"{i}_{_flag_word(c.label)}" for i, c in enumerate(study.retry.changes, 1))]
    flags = cf_flags("last change that a retry made", labels, _UNKNOWN) | {"role": RECORD_ROLE}
    return {
        "attempt": _shaped(points, (), table.attempt, flags),
        "first_outcome": _shaped(
            points, (), table.first_outcome, OUTCOME_ATTRIBUTES | {"long_name": "how the first attempt ended"}
        ),
        "first_outcome_detail": _shaped(
            points, (), table.first_detail, {"long_name": "why the first attempt failed, or a note on it"}
        ),
    }


def _used_columns(study: Study, table: _Table, points: Points) -> dict[str, NDArray[Any]]:
    """Values per point of the parameters that a pilot chose, that retries may change, or that runs choose."""
    used = dict(points.chosen)
    for name, column in table.used.items():
        used[name] = np.where(table.attempt == _UNKNOWN, points.chosen.get(name, column), column)
    for name, settled in table.settled.items():
        if np.isfinite(settled).any():
            used[name] = np.where(np.isfinite(settled), settled, used.get(name, settled))
    return used


def _used_variables(study: Study, used: Mapping[str, NDArray[Any]], points: Points) -> dict[str, xr.Variable]:
    parameters = study.simulator.parameters
    return {f"{name}_used": _used_variable(parameters[name], column, points) for name, column in used.items()}


def _choice_variables(table: _Table, points: Points) -> dict[str, xr.Variable]:
    """Estimated errors of the model that a pilot chose for each point, and whether the point is from the pilot."""
    variables = {
        f"{name}_error_estimate": _shaped(
            points,
            (),
            column,
            {
                "long_name": f"estimated relative error of {name}, of the model and numerical",
                "units": "1",
                "role": RECORD_ROLE,
            },
        )
        for name, column in points.error_estimate.items()
    }
    if points.accuracy_met is not None:
        variables["accuracy_met"] = _shaped(
            points,
            (),
            points.accuracy_met,
            cf_flags("whether the estimated error is within the accuracy asked for", ["unknown", "no", "yes"], -1)
            | {"role": RECORD_ROLE},
        )
        meaning = "whether the pilot ran the point, so that the study did not"
        from_pilot = (table.worker == PILOT).astype(np.int8)
        variables["from_pilot"] = _shaped(points, (), from_pilot, _yes_or_no(meaning))
    return variables


def _flag_word(label: str) -> str:
    """A label as CF allows it among flag_meanings."""
    return re.sub(r"[^A-Za-z0-9.+@-]+", "_", label)


def _used_variable(parameter: Parameter, column: NDArray[Any], points: Points) -> xr.Variable:
    """The value of a parameter that each point used: a flag for each word of a choice, else the number."""
    attrs: dict[str, Any] = {"long_name": f"used: {parameter.meaning}", "role": RECORD_ROLE}
    if parameter.kind != "choice" and column.dtype.kind in "OU":  # a text for a user function
        return _shaped(points, (), column.astype(object), attrs)
    if parameter.kind != "choice":
        return _shaped(points, (), _cf_type(column), attrs | {"units": parameter.unit})
    codes = {word: code for code, word in enumerate(parameter.choices)}
    flags = np.array([codes.get(str(word), _UNKNOWN) for word in column], np.int8)
    return _shaped(points, (), flags, attrs | cf_flags(attrs["long_name"], ["none", *codes], _UNKNOWN))


def _factor_attributes(parameter: Parameter) -> dict[str, Any]:
    """Metadata of a factor's coordinate: unit, meaning, symbol, source."""
    source = parameter.source if parameter.source == _USER_FUNCTION else THIS_STUDY
    attrs: dict[str, Any] = {"long_name": parameter.meaning, "source": source}
    if parameter.kind != "choice":
        attrs["units"] = parameter.unit
    if parameter.symbol:
        attrs["symbol"] = parameter.symbol
    return attrs


def cf_points(points: Points) -> Points:
    """The same points with types that CF allows, the same ones in all parts of the cube."""
    columns = {name: _cf_type(column) for name, column in points.columns.items()}
    return replace(points, columns=columns, labels={name: _cf_type(column) for name, column in points.labels.items()})


def design_coordinates(study: Study, points: Points) -> dict[str, xr.Variable]:
    """Coordinates of the points, without labels of outputs."""
    return _coordinates(study, points, {})


def _coordinates(study: Study, points: Points, labels: Mapping[str, NDArray[Any]]) -> dict[str, xr.Variable]:
    coordinates: dict[str, xr.Variable] = {}
    for name, column in (points.levels or points.columns).items():
        attrs = _factor_attributes(study.simulator.parameters[name])
        if column.dtype == object:  # texts have no unit
            attrs.pop("units", None)
        if name in study.switches:
            attrs["role"] = SWITCH_ROLE
        coordinates[name] = xr.Variable((name if points.is_grid else "point",), _cf_type(column), attrs)
    if not points.is_grid:
        coordinates["point"] = xr.Variable(("point",), np.arange(points.count, dtype=np.int32), POINT_ATTRIBUTES)
    for name, column in points.labels.items():
        meaning = _LABELS.get(name, ROW_OF_PART)
        coordinates[name] = xr.Variable(("point",), _cf_type(column), {"long_name": meaning})
    for name, values in labels.items():
        coordinates[name] = xr.Variable((name,), _cf_type(values), study.simulator.dimension_attributes(name))
    return coordinates


def _cf_type(labels: NDArray[Any]) -> NDArray[Any]:
    """CF 1.8 has neither 64-bit integers nor booleans."""
    if labels.dtype == np.int64:
        return labels.astype(np.int32 if np.abs(labels).max(initial=0) < 2**31 else np.float64)
    return labels.astype(np.int8) if labels.dtype == np.bool_ else labels


def _check_schema(study: Study, cube: xr.Dataset) -> None:
    """Check the cube against the outputs that the simulator declares, before anything is written."""
    finished = cube["outcome"] == Outcome.FINISHED
    for name, output in study.simulator.outputs.items():
        if name not in cube:
            continue
        own = cube[name].dims[len(cube["outcome"].dims) :]
        if own != output.dims:
            raise CubeError(f"{name}: dimensions {own} where {output.dims} are declared")
        missing = [dim for dim in output.dims if dim not in cube.coords]
        if missing:
            raise CubeError(f"{name}: no labels along {', '.join(missing)}")
        given = finished & cube[name].notnull().any(output.dims) if output.optional else finished
        if not bool((np.isfinite(cube[name]) | ~given).all()):
            raise CubeError(f"{name}: a finished point is not finite")
