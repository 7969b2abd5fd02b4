"""Base of the small scenes as simulators: one model, one run per point."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import astuple, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.mechanics.assembly import State
from tripod_doe.mechanics.compilation.first_compilation import first_compilation
from tripod_doe.mechanics.compilation.sources import source_hashes
from tripod_doe.mechanics.contact_damping_parameters import BOTH, DAMPING_PARAMETERS, greased_and_dry, settled
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import Run
from tripod_doe.mechanics.stability.linearisation import fastest_rates
from tripod_doe.mechanics.stability.rates import RATE_OUTPUTS
from tripod_doe.model_interface import (
    NUMERICS,
    BlockResult,
    Dimension,
    Methods,
    Outcome,
    Output,
    Parameter,
    Simulator,
    Value,
    by_name,
    is_set,
    read_parameters,
)

PLACES = np.linspace(0.0, 1.0, 101)
"""Parts of the duration at which paths are sampled."""

PROGRESS = Dimension("progress", PLACES)
"""The dimension along which paths are sampled."""

RUN_OUTPUTS = (
    Output("largest_penetration_um", "um", "delta", "largest penetration of all contacts"),
    Output(
        "energy_residual",
        "1",
        "",
        "energy residual over the converted energy; motion that a method damps instead of resolving it counts, as the "
        "rattling of needles",
    ),
)
"""Outputs of every run."""

_RATE_STATES = 10
"""Number of states of a run at which it is linearised."""


def scene_parameters(file: str, methods: Methods, evaluation_budget: int) -> dict[str, Parameter]:
    """Parameters of a scene from its file, with contact damping, and numerics with the first method as the default."""
    own = read_parameters("tripod_doe.mechanics.scenes", file, {})
    last = {name: parameter for name, parameter in own.items() if parameter.group == "stability studies"}
    numerics = read_parameters("tripod_doe.mechanics.scenes", "numerics.toml", {"method": tuple(METHODS)})
    defaults: dict[str, Value] = {"method": next(iter(methods)), "evaluation_budget": evaluation_budget}
    numerics |= {name: replace(numerics[name], default=value) for name, value in defaults.items()}
    first = {name: parameter for name, parameter in own.items() if name not in last}
    return first | by_name(DAMPING_PARAMETERS) | last | numerics


class SceneSimulator(Simulator):
    """A scene of mechanics as a simulator of studies: one model, one run per point."""

    numerics: Methods  # methods, the default first, with the default step or tolerance of each
    source_hash = source_hashes().results

    @abstractmethod
    def run(self, values: Mapping[str, float], method: str, step: float | None, settings: Settings) -> Run:
        """Simulate one point, all values in the units of their names."""

    @abstractmethod
    def answer(self, values: Mapping[str, float], result: Run) -> dict[str, Any]:
        """Compute every output of the scene from a run, except those of `RUN_OUTPUTS` and `RATE_OUTPUTS`."""

    def foreseen(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[int, Outcome, str]]:
        """Points that set a step or tolerance that their method does not use, or contacts both greased and dry."""
        refused = [(i, Outcome.OUT_OF_RANGE, BOTH) for i in greased_and_dry(points)]
        for i, method in enumerate(points["method"]):
            used = self.numerics.get(str(method), {})
            if unused := [name for name in reversed(NUMERICS) if is_set(points[name][i]) and name not in used]:
                refused.append((i, Outcome.NOT_APPLICABLE, f"not used by {method}: {', '.join(unused)}"))
        return refused

    def effective(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Complete the values of one point, and settle its contact damping."""
        full = super().effective(values)
        return full | settled(full)

    def methods(self, values: Mapping[str, Value]) -> Methods:
        """Methods of the scene, whatever the values."""
        return self.numerics

    def compile(self, model: str, method: str) -> None:
        """Compile the kernels of a method, the same for all scenes, or load their machine code, by a short run."""
        full = self.effective({"duration_s": 1e-6, "method": method})
        with first_compilation(f"the scenes with {method}", seconds=40):
            self.simulate({name: np.array([value], object) for name, value in full.items()}, ())

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate points one by one; an exception makes that point an error, not the block."""
        block = BlockResult.blank(len(points["method"]), Outcome.NOT_APPLICABLE)
        for name in keep:
            dims, shape = self.outputs[name].dims, self.outputs[name].shape({})
            block.put(name, dims, slice(None), np.full((block.count, *shape), np.nan))
        block.coordinates.update(self.labels(keep, {}))
        foreseen = {i: (outcome, reason) for i, outcome, reason in self.foreseen(points)}
        for i in range(block.count):
            if i in foreseen:
                block.end(i, *foreseen[i])
                continue
            given = {name: column[i] if is_set(column[i]) else None for name, column in points.items()}
            method = str(given["method"])
            values = {
                name: float(value)
                for name, value in self.effective(given).items()
                if isinstance(value, int | float | np.number) and self.parameters[name].kind != "choice"
            }
            try:
                result = self._run_point(values, method)
                answers = self._answer_point(values, result, keep)
            except Exception as error:  # other points must not fail
                block.end(i, Outcome.ERROR, f"{type(error).__name__}: {error}")
                continue
            block.end(i, result.outcome, result.detail)
            block.steps[i], block.solves[i], block.simulated_seconds[i] = result.steps, result.solves, result.followed
            block.force_evaluations[i] = result.force_evaluations + result.check_evaluations
            for name in keep if answers else ():
                block.put(name, self.outputs[name].dims, i, np.asarray(answers[name]))
        return block

    def _run_point(self, values: Mapping[str, float], method: str) -> Run:
        settings = Settings(tolerance=values.get("relative_tolerance", 0.0), budget=int(values["evaluation_budget"]))
        return self.run(values, method, values.get("step_s"), settings)

    def _answer_point(self, values: Mapping[str, float], result: Run, keep: Collection[str]) -> dict[str, Any]:
        """All outputs of a valid run; none for an invalid run."""
        if result.outcome != Outcome.FINISHED:
            return {}
        rates = _rates(result) if any(output.name in keep for output in RATE_OUTPUTS) else {}
        return (
            self.answer(values, result)
            | rates
            | {"largest_penetration_um": 1e3 * result.penetration, "energy_residual": result.energy_residual}
        )


def _rates(result: Run) -> dict[str, float]:
    """Rates that limited the step of a run, without its start."""
    chosen = np.unique(np.linspace(1, len(result.times) - 1, _RATE_STATES).round().astype(int))
    states = [State(float(result.times[k]), result.positions[k], result.velocities[k]) for k in chosen]
    rates = fastest_rates(result.assembly, states, pace=1 / float(result.times[-1] - result.times[0]))
    return dict(zip((output.name for output in RATE_OUTPUTS), astuple(rates), strict=True))
