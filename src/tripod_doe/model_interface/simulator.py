"""The simulator: the base class of every scene and user function; studies use models only through it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface.block import BlockResult
from tripod_doe.model_interface.candidate import Candidate
from tripod_doe.model_interface.known_error import NOTABLE_ERROR, ModelErrors
from tripod_doe.model_interface.model_summary import ModelSummary
from tripod_doe.model_interface.outcome import Outcome
from tripod_doe.model_interface.output import Dimension, Output
from tripod_doe.model_interface.parameter import Parameter, Value, is_set
from tripod_doe.model_interface.required_accuracy import Accuracy
from tripod_doe.model_interface.verdict import Trust, verdicts

Methods = Mapping[str, Mapping[str, float]]
"""Methods of a model by name, the default first: the numerics parameters that each uses, with their defaults."""

NUMERICS = ("relative_tolerance", "step_s")
"""Numerics parameters that only some methods use; with other methods they must not be set."""

NOT_REPRESENTED = "not represented by"
"""How `Simulator.missing_effects` begins for a parameter without any effect."""


_COMPILED: set[tuple[str, str, str]] = set()
"""Scenes, models and methods that this process has compiled."""

Declared = TypeVar("Declared", Parameter, Output)


def by_name(declared: Iterable[Declared]) -> dict[str, Declared]:
    """Parameters or outputs in a table by their names, in the given order."""
    return {entry.name: entry for entry in declared}


class Simulator(ABC):
    """A model that a study can run: parameters and outputs with metadata, and a function of a block of points."""

    name: str  # name of the scene, or ``package.module:function``
    parameters: Mapping[str, Parameter]  # everything that can be set, by name
    outputs: Mapping[str, Output]  # everything that can be kept, by name; empty if known only from results
    source_hash: str = ""  # hash of the sources that decide the results; different hashes are never mixed
    # the choices of model = "auto", from the cheapest to the finest; empty with one model
    candidates: tuple[Candidate, ...] = ()
    model_names: tuple[str, ...] = ()  # names of its models, from the cheapest to the finest; empty with one

    @abstractmethod
    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate a block of points.

        Args:
            points: Every parameter by name, as `columns` gives them, each of shape (point,); NaN or None where unset.
            keep: Names of the outputs to return.

        Returns:
            In the order of the points; values of a point do not depend on other points of the block.
        """

    def refined_to(self, accuracy: Accuracy) -> Simulator:
        """The same simulator with runs that are refined to the accuracy of a study.

        Raises:
            InputError: If runs cannot be refined to a quantity.
        """
        raise InputError(f"{self.name}: runs of this scene do not adapt their tolerance; leave [accuracy] out")

    def foreseen(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[int, Outcome, str]]:
        """Points that are known to fail without a run: position, outcome, reason; each point once."""
        return []

    def recorded_price(self, values: Mapping[str, Value]) -> float | None:
        """Recorded CPU seconds of the candidate that is most similar to these values.

        None if no candidate has the same model and method (compared only if candidates set them).
        """
        full = self.effective(values)
        words = [name for name, parameter in self.parameters.items() if parameter.kind == "choice"]
        alike = [
            candidate
            for candidate in self.candidates
            if all(full[name] == candidate.values[name] for name in words if name in candidate.values)
        ]
        if not alike:
            return None
        return min(alike, key=lambda candidate: _distance(full, candidate.values)).price

    def prepare(self, points: Mapping[str, NDArray[Any]]) -> None:
        """Compile or load the kernels for these points, so that compilation does not count in the first block."""
        for model, method in dict.fromkeys(self.solvers(points)):
            if (self.name, model, method) not in _COMPILED:
                self.compile(model, method)
                _COMPILED.add((self.name, model, method))

    def compile(self, model: str, method: str) -> None:  # noqa: B027 - a function has nothing to compile
        """Compile the kernels of a model and a method, or load their machine code, by a short run."""

    def solvers(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[str, str]]:
        """Model (empty with one model) and method of every point; empty without methods."""
        models = [str(model) for model in points["model"]] if "model" in self.parameters else None
        default = {model: next(iter(self.methods({"model": model})), "") for model in dict.fromkeys(models or [""])}
        if not any(default.values()):
            return []
        own = models or [""] * len(points["method"])
        return [
            (model, str(method) if is_set(method) else default[model])
            for model, method in zip(own, points["method"], strict=True)
        ]

    def methods(self, values: Mapping[str, Value]) -> Methods:
        """Methods that can solve points with these values; empty without a choice."""
        return {}

    def check(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], keep: Collection[str]
    ) -> list[str]:
        """Check values against each other, and return warnings.

        Args:
            base: Values that were given, the same for all points.
            factors: Values of each factor; empty if it is sampled.

        Raises:
            InputError: If a base value sets a method that no model in play has, or numerics that no method in play
                uses, or if points would have outputs of different lengths.
        """
        self._check_numerics(base, factors)
        self.check_lengths(factors, keep)
        return []

    def model_errors(
        self, points: Mapping[str, NDArray[Any]], outputs: Mapping[str, NDArray[Any]] | None = None
    ) -> ModelErrors | None:
        """Known errors of the models at some points, and valid ranges of the models; None with a single model.

        Args:
            points: Every parameter by name, as for `simulate`.
            outputs: Available outputs of the points, which may narrow the errors; each of shape (point, ...).
        """
        return None

    def numerical_errors(self, outputs: Mapping[str, NDArray[Any]]) -> FloatArray | None:
        """Relative numerical error that runs report of the quantity of `model_errors`, shape (point,); None without."""
        return None

    def surer_models(
        self, points: Mapping[str, NDArray[Any]], outputs: Mapping[str, NDArray[Any]], trust: NDArray[np.int8]
    ) -> tuple[NDArray[np.object_], dict[str, float]]:
        """The cheapest model that is sure at each doubtful point.

        Points that are doubtful by the numerical error of their run get none: another model may have as large a one.

        Args:
            points, outputs: As for `model_errors`.
            trust: `Trust` in each point, shape (point,).

        Returns:
            Names, shape (point,), empty at other points, None where no finer model is sure or runs; and the recorded
            prices of these models (CPU seconds of a point).
        """
        names, prices = np.full(trust.size, "", object), dict[str, float]()
        inexact, left = self.numerical_errors(outputs), trust == Trust.DOUBTFUL
        if inexact is not None:
            left &= ~(inexact > NOTABLE_ERROR)
        for rank, model in enumerate(self.model_names):
            finer = np.flatnonzero(left & ~np.isin(points["model"], self.model_names[rank:]))
            if not finer.size:
                continue
            there = {name: column[finer] for name, column in points.items()}
            there["model"] = np.full(finer.size, model, object)
            errors = self.model_errors(there, {name: values[finer] for name, values in outputs.items()})
            if errors is None:
                continue
            sure = verdicts(errors).trust == Trust.SURE
            sure[[row for row, *_ in self.foreseen(there)]] = False
            sure = finer[sure]
            names[sure], left[sure] = model, False
            first = {name: column.tolist()[0] for name, column in there.items()}
            price = self.recorded_price({name: value for name, value in first.items() if is_set(value)})
            if price is not None:
                prices[model] = price
        names[left] = None
        return names, prices

    def recorded_errors(self, points: Mapping[str, NDArray[Any]], accuracy: Accuracy) -> FloatArray | None:
        """Recorded errors of the models at points similar to the given ones, for the quantities of a study.

        Args:
            points: Every parameter by name, as for `simulate`.

        Returns:
            Relative to the allowed errors, shape (point, similar, quantity); NaN for unknown errors, None without any
            record.
        """
        return None

    def describe_model(self, model: str) -> dict[str, Any]:
        """Parameters that a model ignores and its valid ranges, as plain data."""
        raise KeyError(model)

    def missing_effects(self, model: str) -> Mapping[str, str]:
        """Parameters whose effect a model neglects, each with the neglected part, or with `NOT_REPRESENTED`."""
        return {}

    def effective(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Complete the values of one point by defaults, dependent parameters, and the numerics of the method."""
        full = {name: values.get(name, parameter.default) for name, parameter in self.parameters.items()}
        for name, parameter in self.parameters.items():
            if full[name] is None and parameter.follows:
                full[name] = full[parameter.follows]
        if methods := self.methods(full):
            if full["method"] is None:
                full["method"] = next(iter(methods))
            for name, value in methods.get(str(full["method"]), {}).items():
                if full[name] is None:
                    full[name] = value
        return full

    def columns(
        self, base: Mapping[str, Value], varied: Mapping[str, NDArray[Any]], count: int
    ) -> dict[str, NDArray[Any]]:
        """Every parameter of a block as a column: factors as given, all others from the base values or defaults.

        Args:
            base: Values that all points share.
            varied: Values of the factors, each of shape (point,).
            count: Number of points.

        Returns:
            Numbers as float arrays (NaN where unset), choices as object arrays (None where unset), a function's
            arguments as they are written, each of shape (point,).
        """
        full: dict[str, NDArray[Any]] = {}
        for name, parameter in self.parameters.items():
            if name in varied:
                full[name] = varied[name]
                continue
            value = base.get(name, parameter.default)
            if value is None and parameter.kind != "choice":
                value = math.nan
            full[name] = np.repeat(parameter.column([value]), count)
        return full

    def labels(self, names: Collection[str], values: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
        """Labels along the dimensions of some outputs, for points with these values."""
        dimensions = (dimension for name in names for dimension in self.outputs[name].dimensions)
        return {dimension.name: dimension.labels_of(values) for dimension in dimensions}

    def dimension_attributes(self, name: str) -> dict[str, str]:
        """Unit and meaning of a dimension by its name; if no output declares it, the name in words."""
        declared = (dimension for output in self.outputs.values() for dimension in output.dimensions)
        same = next((dimension for dimension in declared if dimension.name == name), None)
        return (same or Dimension(name, np.empty(0))).attributes

    @property
    def length_parameters(self) -> set[str]:
        """Parameters that set the length of an output."""
        dimensions = (dimension for output in self.outputs.values() for dimension in output.dimensions)
        return {dimension.length_parameter for dimension in dimensions if dimension.length_parameter}

    def check_lengths(self, varied: Mapping[str, Collection[Value]], keep: Collection[str]) -> None:
        """Refuse points whose outputs would have different lengths.

        Args:
            varied: Values that each parameter takes, of the factors or of all points.

        Raises:
            InputError: If a parameter sets the length of such an output and takes several values.
        """
        for parameter, values in varied.items():
            long = [
                name
                for name, output in self.outputs.items()
                if name in keep and any(dimension.length_parameter == parameter for dimension in output.dimensions)
            ]
            if long and len(different := np.unique(np.array(list(values), float))) != 1:
                takes = "{:g} and {:g}".format(*different) if len(different) == 2 else "several values"
                raise InputError(
                    f"{parameter} takes {takes}, so {' and '.join(long)} would have different lengths; "
                    f"give {parameter} one value under [base], or keep other outputs"
                )

    def _check_numerics(self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]]) -> None:
        """Refuse a method, step or tolerance that no model or method of the study uses."""
        tables = list(self._methods_in_play(base, factors))
        known = {method: used for _, methods in tables for method, used in methods.items()}
        if not known:
            return
        of = ", ".join(model for model, _ in tables if model)
        if base.get("method") is not None and str(base["method"]) not in known:
            raise InputError(f"method = {base['method']}: not a method of {of}; known: {', '.join(known)}")
        for parameter in NUMERICS:
            if base.get(parameter) is None:
                continue
            asked = [value for value in factors.get("method") or [base.get("method")] if value is not None]
            methods = [str(method) for method in asked] or [next(iter(methods)) for _, methods in tables]
            if not any(parameter in known.get(method, {}) for method in methods):
                users = [method for method, used in known.items() if parameter in used]
                raise InputError(
                    f"{parameter} = {base[parameter]}: not used by {', '.join(methods)}{f' ({of})' if of else ''}; "
                    "leave it out" + (f", or take a method that uses it: {', '.join(users)}" if users else "")
                )

    def _methods_in_play(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]]
    ) -> Iterator[tuple[str, Methods]]:
        """Every model of a study by name (empty if there is only one), with its methods."""
        if "model" not in self.parameters:
            yield "", self.methods({})
            return
        for model in factors.get("model") or [base.get("model") or self.parameters["model"].default]:
            yield str(model), self.methods({"model": model})


def model_notes(
    simulator: Simulator, points: Mapping[str, NDArray[Any]], outputs: Mapping[str, NDArray[Any]]
) -> list[str]:
    """Sentences about some points: how far they can be trusted, known errors of their models, ranges that they leave.

    Args:
        points: Every parameter by name, as for `Simulator.simulate`.
        outputs: Their outputs, each of shape (point, ...).
    """
    errors = simulator.model_errors(points, outputs)
    if errors is None:
        return []
    summary = ModelSummary()
    trust = summary.add(errors, simulator.numerical_errors(outputs))
    summary.add_checks(*simulator.surer_models(points, outputs, trust))
    return summary.texts


def _distance(values: Mapping[str, Value], others: Mapping[str, Value]) -> float:
    """Distance of two sets of positive numbers: the sum of the logarithms of their ratios; unset ones add nothing."""
    pairs = ((values[name], other) for name, other in others.items())
    numbers = [(a, b) for a, b in pairs if isinstance(a, int | float) and isinstance(b, int | float)]
    return sum(abs(math.log(a / b)) for a, b in numbers if a > 0 < b)
