"""The joint as a simulator: points in, outputs and outcomes out, by the model each point asks for."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint import models
from tripod_doe.joint.candidates import JOINT_CANDIDATES
from tripod_doe.joint.feasibility import infeasible
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

    def foreseen(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[int, Outcome, str]]:
        """Points that are not run: parts that do not fit or slide, a method or numerics that a model does not have."""
        found: list[tuple[int, Outcome, str]] = []
        for (name, method, _, _), chosen in self._kinds(points):
            model = models.MODELS[name]
            if method not in model.methods:
                text = f"method {method} is not one of {model.name}"
                found += [(int(position), Outcome.NOT_APPLICABLE, text) for position in chosen]
                continue
            columns = {key: np.asarray(column)[chosen] for key, column in points.items()}
            refused = _refused(model, method, columns, _values(model, method, columns))
            found += [(int(chosen[row]), *why) for row, why in refused.items()]
        return found

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate a block of points, those of one model, method and number of samples together."""
        block = BlockResult.blank(len(points["model"]), Outcome.NOT_APPLICABLE)
        usable = np.ones(block.count, bool)
        for row, outcome, reason in self.foreseen(points):
            block.end(row, outcome, reason)
            usable[row] = False
        for (name, method, samples, _), alike in self._kinds(points):
            model, chosen = models.MODELS[name], alike[usable[alike]]
            if chosen.size:
                columns = {key: np.asarray(column)[chosen] for key, column in points.items()}
                wanted = [output for output in keep if output in model.outputs]
                block.fill(chosen, model.simulate(_values(model, method, columns), method, samples, wanted))
        first = {name: points[name][0] for name in ("samples_per_revolution", "cycles")}
        block.coordinates.update(self.labels(block.outputs, first))
        return block

    def _kinds(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[tuple[str, str, int, int], NDArray[np.int64]]]:
        """Positions of the points with the same model, method, samples per revolution and cycles."""
        numbers = (np.asarray(points[name], float) for name in ("samples_per_revolution", "cycles"))
        kinds = [(*solver, int(n), int(c)) for solver, n, c in zip(self.solvers(points), *numbers, strict=True)]
        rows: dict[tuple[str, str, int, int], list[int]] = {}
        for row, kind in enumerate(kinds):
            rows.setdefault(kind, []).append(row)
        return [(kind, np.array(rows[kind])) for kind in sorted(rows)]


def _values(model: models.Model, method: str, columns: Mapping[str, NDArray[Any]]) -> JointValues[NDArray[np.float64]]:
    """Values of points in internal units, with the method's own numerics where they are not given."""
    numbers = {}
    for name, parameter in JOINT_PARAMETERS.items():
        if parameter.kind != "choice":
            column = np.asarray(columns[name], float)
            own = model.methods[method].get(name)
            numbers[name] = column if own is None else np.where(np.isnan(column), own, column)
    return internal_values(numbers)


def _refused(
    model: models.Model, method: str, columns: Mapping[str, NDArray[Any]], values: JointValues[NDArray[np.float64]]
) -> dict[int, tuple[Outcome, str]]:
    """Points of one model and method that are not run, with outcome and reason."""
    refused: dict[int, tuple[Outcome, str]] = {}
    for name in NUMERICS:
        if name not in model.methods[method]:
            text = f"{name} is not used by {model.name} with {method}"
            given = np.flatnonzero([is_set(value) for value in columns[name]])
            refused |= {int(row): (Outcome.NOT_APPLICABLE, text) for row in given}
    return infeasible(values) | refused


simulator = JointSimulator()
"""The scene that study files reach as ``joint``."""
