"""One point, without a study: parameters in, a labelled Dataset out."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.simulator import (
    DETAIL_ATTRIBUTES,
    OUTCOME_ATTRIBUTES,
    Outcome,
    Simulator,
    Value,
    Values,
    check_parameters,
    is_set,
    model_notes,
)
from tripod_doe.study.definition.scenes import load_simulator
from tripod_doe.study.execution.task import Task, run_task

if TYPE_CHECKING:  # the command line answers without xarray
    import xarray as xr


@dataclass(frozen=True)
class SimulatedPoint:
    """One point with its answer."""

    simulator: Simulator  # its simulator
    parameters: Mapping[str, Value]  # all values that were used
    # every output of the model but those on request; missing where the point did not finish
    outputs: Mapping[str, Values]
    coordinates: Mapping[str, NDArray[Any]]  # labels along the dimensions of the outputs
    # outcome, detail: how the point ended, and the reason for failure or a note
    outcome: Outcome
    detail: str
    cost: Mapping[str, float]  # CPU and wall seconds without compilation, steps, force evaluations
    # how far the point can be trusted, the model with the error that is known for such points, and the ranges of the
    # model that the point leaves; none where it did not finish
    model_notes: tuple[str, ...] = ()

    def usual(self) -> SimulatedPoint:
        """The point without outputs on request."""
        known = self.simulator.outputs
        return self.only([name for name in self.outputs if not known[name].on_request])

    def only(self, names: Collection[str]) -> SimulatedPoint:
        """The point with these outputs, as far as it has them."""
        outputs = {name: self.outputs[name] for name in names if name in self.outputs}
        along = {dim for values in outputs.values() for dim in values.dims}
        coordinates = {name: labels for name, labels in self.coordinates.items() if name in along}
        return replace(self, outputs=outputs, coordinates=coordinates)

    def record(self, chosen: Collection[str] = ()) -> dict[str, Any]:
        """The point for programs, as JSON takes it, with the chosen outputs or the usual ones.

        An output is None where the point did not get that far.
        """
        usual = chosen or [name for name, output in self.simulator.outputs.items() if not output.on_request]
        outputs = {name: _plain(values.data.tolist()) for name, values in self.outputs.items()}
        return {
            "scene": self.simulator.name,
            "parameters": self.parameters,
            **(dict.fromkeys(usual) | outputs),
            "coordinates": {name: _plain(labels.tolist()) for name, labels in self.coordinates.items()},
            "outcome": self.outcome.label,
            "outcome_detail": self.detail,
            "model_notes": self.model_notes,
            "cost": self.cost,
        }


def _plain(value: Any) -> Any:
    """Numbers and lists for JSON, NaN as None."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def usual_price(scene: str = "joint", **parameters: Any) -> float | None:
    """CPU seconds of a usual point with these values, as recorded; None where none is. Wrong values are refused."""
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
        {
            "cpu_seconds": cpu,
            "wall_seconds": wall,
            "steps": int(result.steps[0]),
            "force_evaluations": int(result.force_evaluations[0]),
        },
        tuple(model_notes(simulator, simulator.columns(values, {}, 1), outputs)) if outcome is Outcome.FINISHED else (),
    )


def simulate(scene: str = "joint", **parameters: Any) -> xr.Dataset:
    """Simulate one point.

    Args:
        scene: Name of the scene.
        **parameters: Parameters by name, in the units of their names; all others keep their defaults.

    Returns:
        Every output of the model but those on request, ``outcome`` and ``outcome_detail``; the attributes
        ``parameters`` (all values that were used), ``model_notes`` (how far to trust it, and why) and ``cost`` (CPU and
        wall seconds without compilation, steps, force evaluations). Outputs are missing where the point did not finish.

    Raises:
        InputError: If a parameter is unknown, out of range, or not used by the method.

    Examples:
        >>> import tripod_doe as td
        >>> result = td.simulate(joint_angle_deg=10)
        >>> round(float(result["thrust_amplitude"].sel(order=3)), 1)
        14.4
    """
    import xarray as xr

    point = simulate_point(scene, **parameters)
    variables: dict[str, Any] = {}
    for name, values in point.outputs.items():
        meta = point.simulator.outputs[name]
        variables[name] = (values.dims, values.data, {"units": meta.unit, "long_name": meta.meaning})
    variables["outcome"] = ((), np.int8(point.outcome), OUTCOME_ATTRIBUTES)
    variables["outcome_detail"] = ((), point.detail, DETAIL_ATTRIBUTES)
    return xr.Dataset(
        variables,
        coords={
            name: (name, labels, point.simulator.dimension_attributes(name))
            for name, labels in point.coordinates.items()
        },
        attrs={
            "parameters": dict(point.parameters),
            "cost": dict(point.cost),
            "finished": point.outcome is Outcome.FINISHED,
            "model_notes": point.model_notes,
        },
    )
