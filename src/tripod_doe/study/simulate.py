"""One point, without a study: parameters in, a labelled Dataset out."""

from __future__ import annotations

from typing import Any

import xarray as xr

from tripod_doe.simulator import DETAIL_ATTRIBUTES, OUTCOME_ATTRIBUTES, Outcome, Value, check_parameters
from tripod_doe.study.scenes import load_simulator
from tripod_doe.study.task import Task, run_task

__all__ = ["simulate"]


def simulate(scene: str = "joint", **parameters: Any) -> xr.Dataset:
    """Simulate one point.

    Parameters
    ----------
    scene
        Name of the scene.
    **parameters
        Parameters by name, in the units of their names; all others keep their defaults.

    Returns
    -------
    xarray.Dataset
        Every output of the model but those on request, ``outcome`` and ``outcome_detail``; the attributes
        ``parameters`` (all values that were used) and ``cost`` (CPU and wall seconds without compilation, steps, force
        evaluations). Outputs are missing where the point did not finish.

    Raises
    ------
    InputError
        If a parameter is unknown, out of range, or not used by the method.

    Examples
    --------
    >>> import tripod_doe as td
    >>> result = td.simulate(joint_angle_deg=10)
    >>> round(float(result["thrust_amplitude"].sel(order=3)), 1)
    14.1
    """
    simulator = load_simulator(scene)
    values: dict[str, Value] = {
        n: v for n, v in check_parameters(simulator.parameters, parameters).items() if v is not None
    }
    keep = tuple(name for name, output in simulator.outputs.items() if not output.on_request)
    simulator.check(values, {}, keep)
    result, cpu, wall = run_task(Task(scene, None, "", simulator.source_hash, values, {}, 1, keep))
    variables: dict[str, Any] = {}
    for name, output in result.outputs.items():
        meta = simulator.outputs[name]
        variables[name] = (output.dims, output.data[0], {"units": meta.unit, "long_name": meta.meaning})
    variables["outcome"] = ((), result.outcome[0], OUTCOME_ATTRIBUTES)
    variables["outcome_detail"] = ((), result.detail[0], DETAIL_ATTRIBUTES)
    cost = {
        "cpu_seconds": cpu,
        "wall_seconds": wall,
        "steps": int(result.steps[0]),
        "force_evaluations": int(result.force_evaluations[0]),
    }
    attrs = {
        "parameters": simulator.effective(values),
        "cost": cost,
        "finished": int(result.outcome[0]) == Outcome.FINISHED,
    }
    coordinates = {
        name: (name, labels, simulator.dimension_attributes(name)) for name, labels in result.coordinates.items()
    }
    return xr.Dataset(variables, coords=coordinates, attrs=attrs)
