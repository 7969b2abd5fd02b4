"""The joint as a simulator: points in, outputs and outcomes out, by the model each point asks for."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint import models
from tripod_doe.joint.candidates import JOINT_CANDIDATES
from tripod_doe.joint.feasibility import misfits
from tripod_doe.joint.outputs import JOINT_OUTPUTS
from tripod_doe.joint.parameters import JOINT_PARAMETERS, internal_values, point_values
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.sources import source_hashes
from tripod_doe.simulator import NUMERICS, BlockResult, Methods, Outcome, Simulator, Value, is_set

__all__ = ["JointSimulator", "simulator"]


class JointSimulator(Simulator):
    """The full tripod joint, simulated by the model that each point names."""

    name = "joint"
    parameters = JOINT_PARAMETERS
    outputs = JOINT_OUTPUTS
    source_hash = source_hashes().results
    candidates = JOINT_CANDIDATES

    def methods(self, values: Mapping[str, Value]) -> Methods:
        """Methods of the model that these values name."""
        return models.MODELS[str(values["model"])].methods

    def check(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], keep: Collection[str]
    ) -> list[str]:
        """Check as any simulator, and warn of factors that no model in play represents."""
        warnings = super().check(base, factors, keep)
        names = factors.get("model") or [base.get("model") or JOINT_PARAMETERS["model"].default]
        in_play = [models.MODELS[str(name)] for name in names]
        return warnings + [
            f"{name} is not represented by {' or '.join(m.name for m in in_play)}: its values all give the same answer"
            for name in factors
            if all(name in model.ignores for model in in_play)
        ]

    def compile(self, model: str, method: str) -> None:
        """Compile the kernels of a model and a method, or load their machine code, by a short run."""
        if method in models.MODELS[model].methods:
            full = self.effective({"model": model, "method": method, "samples_per_revolution": 30})
            models.MODELS[model].prepare(point_values(full), method)

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate a block of points, those of one model, method and number of samples together."""
        block = BlockResult.blank(len(points["model"]), Outcome.NOT_APPLICABLE)
        kinds = [
            (*solver, int(samples), int(cycles))
            for solver, samples, cycles in zip(
                self.solvers(points), points["samples_per_revolution"], points["cycles"], strict=True
            )
        ]
        for kind in sorted(set(kinds)):
            name, method, samples, _ = kind
            model = models.MODELS[name]
            chosen = np.flatnonzero([other == kind for other in kinds])
            columns = {key: np.asarray(column)[chosen] for key, column in points.items()}
            if method not in model.methods:
                block.end(chosen, Outcome.NOT_APPLICABLE, f"method {method} is not one of {model.name}")
                continue
            values = _values(model, method, columns)
            usable = _reject(model, method, columns, values, chosen, block)
            if usable.size:
                wanted = [output for output in keep if output in model.outputs]
                result = model.simulate(values.take(usable), method, samples, wanted)
                block.fill(chosen[usable], result)
        first = {name: points[name][0] for name in ("samples_per_revolution", "cycles")}
        block.coordinates.update(self.labels(block.outputs, first))
        return block


def _values(model: models.Model, method: str, columns: Mapping[str, NDArray[Any]]) -> JointValues[NDArray[np.float64]]:
    """Values of points in internal units, with the method's own numerics where they are not given."""
    numbers = {}
    for name, parameter in JOINT_PARAMETERS.items():
        if parameter.kind != "choice":
            column = np.asarray(columns[name], float)
            own = model.methods[method].get(name)
            numbers[name] = column if own is None else np.where(np.isnan(column), own, column)
    return internal_values(numbers)


def _reject(
    model: models.Model,
    method: str,
    columns: Mapping[str, NDArray[Any]],
    values: JointValues[NDArray[np.float64]],
    chosen: NDArray[np.int64],
    block: BlockResult,
) -> NDArray[np.int64]:
    """Mark the points that the model cannot run, and return the positions within `chosen` of all others."""
    usable = np.ones(chosen.size, bool)
    for name in NUMERICS:
        if name not in model.methods[method]:
            given = np.array([is_set(value) for value in columns[name]])
            block.end(chosen[given], Outcome.NOT_APPLICABLE, f"{name} is not used by {model.name} with {method}")
            usable &= ~given
    for misfit, reason in misfits(values):
        if usable[misfit]:
            block.end(int(chosen[misfit]), Outcome.JAMMED, reason)
            usable[misfit] = False
    return np.flatnonzero(usable)


simulator = JointSimulator()
"""The scene that study files reach as ``joint``."""
