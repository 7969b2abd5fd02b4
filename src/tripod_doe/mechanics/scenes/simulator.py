"""What small scenes share as simulators: the protocol of studies over one run a point."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import astuple
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.mechanics.assembly import State
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.linearisation import RATE_OUTPUTS, fastest_rates
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Run
from tripod_doe.mechanics.sources import source_hashes
from tripod_doe.quantities import Output, Parameter, Rung, Value
from tripod_doe.results import BlockResult, Outcome, Values

__all__ = ["PROGRESS", "RUN_OUTPUTS", "SceneSimulator", "numerics_parameters"]

PROGRESS = np.linspace(0.0, 1.0, 101)
"""Parts of the duration at which paths are sampled."""

RUN_OUTPUTS = (
    Output("largest_penetration_um", "um", "delta", "largest penetration of all contacts"),
    Output("energy_residual", "1", "", "energy residual over the energy turned over"),
)
"""What every run tells about itself."""

_RATE_STATES = 10
"""States on the way at which a run is linearised."""

_NUMERICS = "numerics"


def numerics_parameters(method: str, evaluation_budget: int) -> tuple[Parameter, ...]:
    """Parameters of the time integration, with the scene's default method and budget."""
    return (
        Parameter("method", method, "1", "", "time integration method", "numerics", kind="choice",
                  choices=tuple(METHODS), group=_NUMERICS),
        Parameter("relative_tolerance", None, "1", "", "relative tolerance of a method with step control; by the "
                  "method unless given", "numerics", low=1e-13, high=0.1, group=_NUMERICS),
        Parameter("step_s", None, "s", "h", "time step of a method without step control; by the method unless given",
                  "numerics", low=1e-10, high=1.0, group=_NUMERICS),
        Parameter("evaluation_budget", evaluation_budget, "1", "", "largest number of force evaluations of a run",
                  "numerics", low=1, high=1e12, kind="integer", group=_NUMERICS),
        Parameter("replicate", 0, "1", "", "number of the repetition; changes nothing but the timing", "numerics",
                  low=0, high=1e6, kind="integer", group=_NUMERICS),
    )  # fmt: skip


def _unset(value: object) -> bool:
    return value is None or (isinstance(value, float) and np.isnan(value))


class SceneSimulator(ABC):
    """A scene of mechanics as a simulator of studies.

    Attributes
    ----------
    name
        Name of the scene in study files.
    parameters, outputs
        Everything that can be set and kept, by name.
    labels
        Coordinates of the outputs' dimensions.
    steps, tolerances
        Default step of each method without, and default tolerance of each with step control.
    source_hash
        Hash of all kernel sources: results with different hashes must not be mixed.
    ladder
        Empty: a small scene has one model.
    """

    name: str
    parameters: ClassVar[dict[str, Parameter]]
    outputs: ClassVar[dict[str, Output]]
    labels: ClassVar[Mapping[str, NDArray[Any]]] = {"progress": PROGRESS}
    steps: ClassVar[dict[str, float]]
    tolerances: ClassVar[dict[str, float]]
    source_hash = source_hashes().results
    ladder: tuple[Rung, ...] = ()
    _prepared: ClassVar[set[tuple[str, str]]] = set()

    @abstractmethod
    def run(self, values: Mapping[str, float], method: str, step: float | None, settings: Settings) -> Run:
        """Simulate one point, all values in the units of their names."""

    @abstractmethod
    def answer(self, values: Mapping[str, float], result: Run) -> dict[str, Any]:
        """Make every output of the scene from a run, but those of `RUN_OUTPUTS` and `RATE_OUTPUTS`."""

    def misfit(self, values: Mapping[str, float]) -> str:
        """Say why the parts do not fit, or nothing."""
        return ""

    def check(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], keep: Collection[str]
    ) -> list[str]:
        """Check what no single value shows, and return warnings.

        Raises
        ------
        InputError
            If a base value sets a numerics parameter that no method in play uses.
        """
        methods = [str(m) for m in factors.get("method") or [base.get("method") or self.parameters["method"].default]]
        for parameter, usable in (("relative_tolerance", self.tolerances), ("step_s", self.steps)):
            if not _unset(base.get(parameter)) and not any(method in usable for method in methods):
                raise InputError(
                    f"{parameter} = {base[parameter]}: not used by {', '.join(methods)}; leave it out "
                    f"(used by {', '.join(usable)})"
                )
        return []

    def effective(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Complete the values of one point by defaults, and by the numerics of its method."""
        full = {name: values.get(name, parameter.default) for name, parameter in self.parameters.items()}
        method = str(full["method"])
        for name, defaults in (("step_s", self.steps), ("relative_tolerance", self.tolerances)):
            if _unset(full[name]):
                full[name] = defaults.get(method)
        return full

    def prepare(self, points: Mapping[str, NDArray[Any]]) -> None:
        """Compile the kernels of these points' methods, or load their machine code, by short runs."""
        for method in {self.parameters["method"].default if _unset(m) else m for m in points["method"]}:
            if (self.name, str(method)) not in self._prepared:
                self.compile(str(method))
                self._prepared.add((self.name, str(method)))

    def compile(self, method: str) -> None:
        """Compile the kernels of a method, or load their machine code, by a short run."""
        full = self.effective({"duration_s": 1e-6, "method": method})
        self.simulate({name: np.array([value], object) for name, value in full.items()}, ())

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate a block of points; see the scene ``joint``."""
        count = len(points["method"])
        outcome, detail = np.full(count, Outcome.NOT_APPLICABLE, np.int8), [""] * count
        work, followed = np.zeros((3, count), np.int64), np.zeros(count)
        shapes = {name: tuple(self.labels[dim].size for dim in self.outputs[name].dims) for name in keep}
        outputs = {
            name: Values(self.outputs[name].dims, np.full((count, *shape), np.nan)) for name, shape in shapes.items()
        }
        for i in range(count):
            point = {name: column[i] for name, column in points.items()}
            method = str(point["method"])
            numerics = (("step_s", self.steps), ("relative_tolerance", self.tolerances))
            unused = [name for name, users in numerics if not _unset(point[name]) and method not in users]
            if unused:
                detail[i] = f"{' and '.join(unused)} is not used by {method}"
                continue
            full = self.effective({name: None if _unset(value) else value for name, value in point.items()})
            values = {
                name: float(value)
                for name, value in full.items()
                if isinstance(value, int | float | np.number) and self.parameters[name].kind != "choice"
            }
            if reason := self.misfit(values):
                outcome[i], detail[i] = Outcome.JAMMED, reason
                continue
            try:
                result = self._run_point(values, method)
                found = self._answer_point(values, result, keep)
            except Exception as error:  # one point's error is not its neighbours'
                outcome[i], detail[i] = Outcome.ERROR, f"{type(error).__name__}: {error}"
                continue
            outcome[i], detail[i] = result.outcome, result.detail
            work[:, i] = result.steps, result.force_evaluations + result.check_evaluations, result.solves
            followed[i] = result.followed
            for name in keep if found else ():
                outputs[name].data[i] = found[name]
        used = {dim for values in outputs.values() for dim in values.dims}
        labels = {name: label for name, label in self.labels.items() if name in used}
        return BlockResult(outputs, labels, outcome, detail, work[0], work[1], work[2], followed)

    def _run_point(self, values: Mapping[str, float], method: str) -> Run:
        settings = Settings(tolerance=values.get("relative_tolerance", 0.0), budget=int(values["evaluation_budget"]))
        return self.run(values, method, values.get("step_s"), settings)

    def _answer_point(self, values: Mapping[str, float], result: Run, keep: Collection[str]) -> dict[str, Any]:
        """All outputs of a run that may be used, none of any other."""
        if result.outcome != Outcome.FINISHED:
            return {}
        rates = _rates(result) if any(output.name in keep for output in RATE_OUTPUTS) else {}
        return (
            self.answer(values, result)
            | rates
            | {
                "largest_penetration_um": 1e3 * result.penetration,
                "energy_residual": result.energy_residual,
            }
        )


def _rates(result: Run) -> dict[str, float]:
    """What limited the step of a run that counts by its duration; its start is left out, for it lasts no time."""
    chosen = np.unique(np.linspace(1, len(result.times) - 1, _RATE_STATES).round().astype(int))
    states = [State(float(result.times[k]), result.positions[k], result.velocities[k]) for k in chosen]
    rates = fastest_rates(result.assembly, states, pace=1 / float(result.times[-1] - result.times[0]))
    return dict(zip((output.name for output in RATE_OUTPUTS), astuple(rates), strict=True))
