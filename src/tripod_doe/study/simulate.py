"""Points without a study: parameters in, a labelled Dataset out."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.model_interface import (
    DETAIL_ATTRIBUTES,
    OUTCOME_ATTRIBUTES,
    BlockResult,
    Outcome,
    Simulator,
    Value,
    Values,
    check_parameters,
    is_set,
    model_notes,
)
from tripod_doe.number_text import plain_json
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.execution.task import Task, run_task
from tripod_doe.study.memory import refuse_too_many_points

if TYPE_CHECKING:  # the command line answers without xarray
    import xarray as xr


_LEAST_BYTES = 100  # of a point, its results left out


@dataclass(frozen=True)
class SimulatedPoint:
    """One point with its answer."""

    simulator: Simulator  # its simulator
    parameters: Mapping[str, Value]  # all values that were used
    # every output of the model except those on request; missing if the point did not finish
    outputs: Mapping[str, Values]
    coordinates: Mapping[str, NDArray[Any]]  # labels along the dimensions of the outputs
    # outcome, detail: how the point ended, and the reason for failure or a note
    outcome: Outcome
    detail: str
    given: tuple[str, ...]  # names of the parameters that were given
    cost: Mapping[str, float]  # CPU and wall seconds without compilation, steps, force evaluations
    # trust in the point, the known error of its model at similar points, and valid ranges of the model that the point
    # leaves; none if it did not finish
    model_notes: tuple[str, ...] = ()

    def usual(self) -> SimulatedPoint:
        """The point without outputs on request."""
        known = self.simulator.outputs
        return self.only([name for name in self.outputs if not known[name].on_request])

    def only(self, names: Collection[str]) -> SimulatedPoint:
        """The point with those of these outputs that it has."""
        outputs = {name: self.outputs[name] for name in names if name in self.outputs}
        along = {dim for values in outputs.values() for dim in values.dims}
        coordinates = {name: labels for name, labels in self.coordinates.items() if name in along}
        return replace(self, outputs=outputs, coordinates=coordinates)

    def record(self, chosen: Collection[str] = ()) -> dict[str, Any]:
        """The point for programs, as JSON takes it, with the chosen outputs or the usual ones.

        An output is None if the point stopped before it.
        """
        usual = chosen or [name for name, output in self.simulator.outputs.items() if not output.on_request]
        outputs = {name: plain_json(values.data.tolist()) for name, values in self.outputs.items()}
        return {
            "scene": self.simulator.name,
            "parameters": self.parameters,
            **(dict.fromkeys(usual) | outputs),
            "coordinates": {name: plain_json(labels.tolist()) for name, labels in self.coordinates.items()},
            "outcome": self.outcome.label,
            "outcome_detail": self.detail,
            "model_notes": self.model_notes,
            "cost": self.cost,
        }


def usual_price(scene: str = "joint", **parameters: Any) -> float | None:
    """Recorded CPU seconds of a usual point with these values; None without a record. Wrong values are refused."""
    simulator = load_simulator(scene)
    return simulator.recorded_price(_checked(simulator, parameters, ()))


def _checked(simulator: Simulator, parameters: Mapping[str, Any], keep: Collection[str]) -> dict[str, Value]:
    """The values that are given, as the simulator takes them."""
    values: dict[str, Value] = {
        n: v for n, v in check_parameters(simulator.parameters, parameters).items() if v is not None
    }
    simulator.check(values, {}, keep)
    return values


def simulate_point(scene: str = "joint", also: Collection[str] = (), /, **parameters: Any) -> SimulatedPoint:
    """Simulate one point, as plain arrays, with outputs on request that are named in `also`; see `simulate`."""
    simulator = load_simulator(scene)
    keep = tuple(name for name, output in simulator.outputs.items() if not output.on_request or name in also)
    values = _checked(simulator, parameters, keep)
    result, cpu, wall = run_task(Task(scene, None, None, simulator.source_hash, values, {}, 1, keep))
    outcome = Outcome(int(result.outcome[0]))
    outputs = {name: values.data for name, values in result.outputs.items()}
    return SimulatedPoint(
        simulator,
        simulator.effective(values)
        | {name: float(column[0]) for name, column in result.settled.items() if is_set(column[0])},
        {name: Values(output.dims, output.data[0]) for name, output in result.outputs.items()},
        result.coordinates,
        outcome,
        result.detail[0],
        tuple(values),
        {
            "cpu_seconds": cpu,
            "wall_seconds": wall,
            "steps": int(result.steps[0]),
            "force_evaluations": int(result.force_evaluations[0]),
        },
        tuple(model_notes(simulator, simulator.columns(values, {}, 1), outputs)) if outcome is Outcome.FINISHED else (),
    )


def simulate(scene: str = "joint", **parameters: Any) -> xr.Dataset:
    """Simulate one point, or a point for every combination of the values in arrays, in this process.

    Args:
        scene: Name of the scene.
        **parameters: Parameters by name, in the units of their names; all others keep their defaults. A list or array
            adds a dimension of its own name; arrays of xarray keep their dimensions, so that those that share one vary
            together.

    Returns:
        Every output but those on request, NaN where a point or its model has none, ``outcome`` and ``outcome_detail``;
        the attributes ``parameters`` (values that all points share), ``finished`` (whether all are), ``model_notes``
        (how far to trust them, and why) and ``cost`` (CPU and wall seconds without compilation, steps, force
        evaluations). Points that fail are part of the answer.

    Raises:
        InputError: If a parameter is unknown, out of range, or not used by the method.

    Examples:
        >>> import tripod_doe as td
        >>> result = td.simulate(joint_angle_deg=[5, 10])
        >>> result["thrust_amplitude"].sel(order=3).round(1).values.tolist()
        [7.7, 14.4]
    """
    return simulated_by(run_task, scene, parameters)


def simulated_by(
    compute: Callable[[Task], tuple[BlockResult, float, float]], scene: str, parameters: Mapping[str, Any]
) -> xr.Dataset:
    """Points as `simulate` gives them, computed by a function as `run_task` is one."""
    import xarray as xr

    simulator = load_simulator(scene)
    given = {name: _array(name, value) for name, value in parameters.items()}
    varied = {name: value for name, value in given.items() if isinstance(value, xr.DataArray)}
    base = check_parameters(simulator.parameters, {n: v for n, v in given.items() if n not in varied})
    values = {name: value for name, value in base.items() if value is not None}
    over = _crossed(simulator, varied)
    count = math.prod(over.sizes.values())
    refuse_too_many_points(count, _LEAST_BYTES * (1 + len(varied)))
    columns = _columns(simulator, over, list(varied))
    keep = tuple(name for name, output in simulator.outputs.items() if not output.on_request)
    simulator.check(values, {name: list(dict.fromkeys(column.tolist())) for name, column in columns.items()}, keep)
    first = simulator.effective(values | {name: column[0] for name, column in columns.items()})
    shapes = {name: simulator.outputs[name].shape(first) for name in keep}
    refuse_too_many_points(count, sum(8 * math.prod(shape) for shape in shapes.values()))
    result, cpu, wall = compute(Task(scene, None, None, simulator.source_hash, values, columns, count, keep))
    return _labelled(simulator, over, result, shapes, first).assign_attrs(
        parameters=_shared(simulator, values, columns, result),
        cost={
            "cpu_seconds": cpu,
            "wall_seconds": wall,
            "steps": int(result.steps.sum()),
            "force_evaluations": int(result.force_evaluations.sum()),
        },
        finished=bool((result.outcome == Outcome.FINISHED).all()),
        model_notes=_notes(simulator, simulator.columns(values, columns, count), result),
    )


def _array(name: str, value: Any) -> Any:
    """A value as a plain one, or as an array with named dimensions.

    Raises:
        InputError: If an array has several dimensions without names, no values, masked ones, or more points than fit
            into memory.
    """
    import xarray as xr

    if np.ma.is_masked(value):
        raise InputError(f"{name}: masked values; leave them out")
    if np.ndim(value) == 0:
        return value.item() if hasattr(value, "dtype") else value
    refuse_too_many_points(np.size(value), _LEAST_BYTES)
    if not isinstance(value, xr.DataArray):
        if np.ndim(value) > 1:
            raise InputError(f"{name}: an array with {np.ndim(value)} dimensions; give an xarray.DataArray, with names")
        labels = np.asarray(value)
        value = xr.DataArray(labels, dims=name, coords={name: labels})
    if not value.size:
        raise InputError(f"{name}: an array without values")
    return value


def _crossed(simulator: Simulator, varied: Mapping[str, xr.DataArray]) -> xr.Dataset:
    """All combinations of the values in arrays: their dimensions, with the arrays as coordinates.

    Raises:
        InputError: If labels along a dimension differ, or it is one of an output.
    """
    import xarray as xr

    for name, array in varied.items():
        for dim in array.dims:
            if any(dim in output.dims for output in simulator.outputs.values()):
                raise InputError(f"{name}: its dimension {dim} is one of the outputs; rename it")
    try:
        aligned = xr.align(*varied.values(), join="exact")
    except ValueError as error:
        raise InputError(f"{', '.join(varied)}: arrays along the same dimension have different labels") from error
    labels = {name: array.coords[name].variable for array in aligned for name in array.coords}
    own = {name: array.variable for name, array in zip(varied, aligned, strict=True)}
    dims = dict.fromkeys(dim for array in aligned for dim in array.dims)
    return xr.Dataset(coords=labels | own, attrs={"dims": tuple(dims)})


def _dims(over: xr.Dataset) -> tuple[Hashable, ...]:
    """Dimensions of the points in the order in which they were given, which a Dataset does not keep."""
    return over.attrs["dims"]


def _columns(simulator: Simulator, over: xr.Dataset, names: Collection[str]) -> dict[str, NDArray[Any]]:
    """Values of the varied parameters at all points.

    Raises:
        InputError: For an unknown parameter, or a value that it refuses.
    """
    columns = {}
    for name in names:
        own = over[name].values.ravel().tolist()
        checked = {value: check_parameters(simulator.parameters, {name: value})[name] for value in dict.fromkeys(own)}
        full = over[name].broadcast_like(over).transpose(*_dims(over)).values.ravel().tolist()
        columns[name] = simulator.parameters[name].column([checked[value] for value in full])
    return columns


def _labelled(
    simulator: Simulator,
    over: xr.Dataset,
    result: BlockResult,
    shapes: Mapping[str, tuple[int, ...]],
    first: Mapping[str, Value],
) -> xr.Dataset:
    """Results along the dimensions of the points, NaN where there are none."""
    dims, lengths = _dims(over), result.outcome.reshape([over.sizes[dim] for dim in _dims(over)]).shape
    variables: dict[str, Any] = {}
    for name, shape in shapes.items():
        output = simulator.outputs[name]
        data = result.outputs[name].data if name in result.outputs else np.full((result.count, *shape), np.nan)
        attributes = {"units": output.unit, "long_name": output.meaning}
        variables[name] = ((*dims, *output.dims), data.reshape((*lengths, *data.shape[1:])), attributes)
    details = np.array(result.detail, dtype=object)
    variables["outcome"] = (dims, result.outcome.reshape(lengths), OUTCOME_ATTRIBUTES)
    variables["outcome_detail"] = (dims, details.reshape(lengths), DETAIL_ATTRIBUTES)
    labels = simulator.labels(shapes, first)
    coordinates = {name: (name, values, simulator.dimension_attributes(name)) for name, values in labels.items()}
    results = over.drop_attrs(deep=False).assign_coords(coordinates).assign(variables)
    for varied in over.coords:
        if parameter := simulator.parameters.get(str(varied)):
            results[varied].attrs |= {"units": parameter.unit, "long_name": parameter.meaning}
    return results


def _shared(
    simulator: Simulator, values: Mapping[str, Value], columns: Mapping[str, NDArray[Any]], result: BlockResult
) -> dict[str, Value]:
    """Values that all points share."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True) if columns else [()]
    shared: dict[str, Value] = {}
    for at, row in enumerate(rows):
        own = simulator.effective({**values, **dict(zip(columns, row, strict=True))})
        own |= {name: float(column[at]) for name, column in result.settled.items() if is_set(column[at])}
        shared = {name: value for name, value in (shared.items() if at else own.items()) if own.get(name) == value}
    return {name: value for name, value in shared.items() if name not in columns}


def _notes(simulator: Simulator, points: Mapping[str, NDArray[Any]], result: BlockResult) -> tuple[str, ...]:
    """Notes on the points that finished."""
    rows = np.flatnonzero(result.outcome == Outcome.FINISHED)
    if not rows.size:
        return ()
    outputs = {name: values.data[rows] for name, values in result.outputs.items()}
    return tuple(model_notes(simulator, {name: column[rows] for name, column in points.items()}, outputs))
