"""What a study knows of a model: a protocol, found by name. Scenes and plain functions answer it alike."""

from __future__ import annotations

import importlib
import inspect
import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.errors import InputError, near_match
from tripod_doe.quantities import Output, Parameter, Rung, Value
from tripod_doe.results import BlockResult, Outcome, Values

__all__ = ["SCENES", "FunctionSimulator", "Simulator", "column_of", "load_simulator", "point_columns"]

SCENES = {
    "joint": "tripod_doe.joint.scene:scene",
    "needle-between-plates": "tripod_doe.mechanics.scenes.needle_between_plates:scene",
    "trunnion": "tripod_doe.joint.trunnion:scene",
    "roller-in-groove": "tripod_doe.mechanics.scenes.roller_in_groove:scene",
}
"""Scenes by the name that study files and the command line use, each ``package.module:object``."""


class Simulator(Protocol):
    """A model that a study can run: parameters and outputs with metadata, and a function of a block of points."""

    @property
    def name(self) -> str:
        """Name of the scene, or ``package.module:function``."""
        ...

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Everything that can be set."""
        ...

    @property
    def outputs(self) -> dict[str, Output]:
        """Everything that can be kept; empty where it is known only from the answers."""
        ...

    @property
    def source_hash(self) -> str:
        """Hash of the sources that decide the results; results with different hashes are not mixed."""
        ...

    @property
    def ladder(self) -> tuple[Rung, ...]:
        """Rungs that model = "auto" may choose from, from the cheapest to the finest; empty with one model."""
        ...

    def check(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], keep: Collection[str]
    ) -> list[str]:
        """Refuse (InputError) what cannot be run in these combinations, and return warnings."""
        ...

    def effective(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Complete the values of one point with defaults and with what follows from them."""
        ...

    def prepare(self, points: Mapping[str, NDArray[Any]]) -> None:
        """Compile what these points need, so that the first block is timed like any other."""
        ...

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate a block; no point's values may depend on its neighbours."""
        ...


@dataclass(frozen=True)
class FunctionSimulator:
    """A plain Python function as a simulator: named arguments in, a dict or Dataset out.

    Attributes
    ----------
    name
        ``package.module:function``.
    function
        Called once a point.
    parameters
        Its arguments; those without default must be set.
    outputs
        Empty: a function's outputs are known when it has answered.
    source_hash
        Empty: the function's source is the user's own affair.
    ladder
        What the function itself names as its attribute ``ladder``: `Rung`s over its arguments.
    """

    name: str
    function: Callable[..., Any]
    parameters: dict[str, Parameter]
    outputs: dict[str, Output]
    source_hash: str = ""
    ladder: tuple[Rung, ...] = ()

    def check(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], keep: Collection[str]
    ) -> list[str]:
        """Refuse a study that leaves an argument without a value."""
        missing = [
            name
            for name, parameter in self.parameters.items()
            if parameter.default is None and name not in base and name not in factors
        ]
        if missing:
            raise InputError(f"{self.name} needs {', '.join(missing)}: give each as a base value or as a factor")
        return []

    def effective(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Complete the values with the function's defaults."""
        return {name: values.get(name, parameter.default) for name, parameter in self.parameters.items()}

    def prepare(self, points: Mapping[str, NDArray[Any]]) -> None:
        """Nothing to compile."""

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Call the function for every point; an exception makes that point an error, not the block."""
        count = len(next(iter(points.values())))
        answers: list[xr.Dataset | None] = []
        detail = [""] * count
        for position in range(count):
            arguments = {name: _plain(column[position]) for name, column in points.items()}
            try:
                answers.append(_as_dataset(self.function(**arguments)))
            except Exception as error:
                answers.append(None)
                detail[position] = f"{type(error).__name__}: {error}"
        good = [answer for answer in answers if answer is not None]
        names = dict.fromkeys(str(name) for answer in good for name in answer.data_vars)
        outputs = {name: _stacked(name, answers) for name in names if not keep or name in keep}
        labels = {str(dim): np.asarray(values) for answer in good for dim, values in answer.coords.items()}
        outcome = np.array([Outcome.ERROR if text else Outcome.FINISHED for text in detail], np.int8)
        ones = np.ones(count, np.int64)
        return BlockResult(outputs, labels, outcome, detail, ones, ones, np.zeros_like(ones), np.full(count, np.nan))


def _stacked(name: str, answers: Sequence[xr.Dataset | None]) -> Values:
    """One output of all points; NaN where a point failed or did not give it."""
    given = [None if answer is None or name not in answer else answer[name] for answer in answers]
    like = next(values for values in given if values is not None)
    for values in given:
        if values is not None and values.shape != like.shape:
            raise InputError(f"{name}: points have different shapes {like.shape} and {values.shape}")
    rows = [np.full(like.shape, np.nan) if values is None else values.values for values in given]
    return Values(tuple(str(dim) for dim in like.dims), np.stack(rows).astype(float))


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _as_dataset(answer: Any) -> xr.Dataset:
    if isinstance(answer, xr.Dataset):
        return answer
    if not isinstance(answer, Mapping):
        raise TypeError(f"a study function must return a dict or a Dataset, not {type(answer).__name__}")
    variables = {}
    for name, value in answer.items():
        array = np.asarray(value, float)
        variables[str(name)] = (tuple(f"{name}_{axis}" for axis in range(array.ndim)), array)
    return xr.Dataset(variables)


def load_simulator(scene: str = "joint", function: str | None = None, folder: str | None = None) -> Simulator:
    """Find a scene by its name, or a function by ``package.module:function``.

    Parameters
    ----------
    scene
        A key of `SCENES`; ignored where a function is named.
    function
        Where to import the function from.
    folder
        Folder of the study file, searched for the function's module first.

    Raises
    ------
    InputError
        If there is no such scene, module or function.
    """
    if function is None:
        if scene not in SCENES:
            raise InputError(f"scene = {scene!r}: unknown scene{near_match(scene, SCENES)}")
        simulator: Simulator = _import_object(SCENES[scene])
        return simulator
    if folder and folder not in sys.path:
        sys.path.insert(0, folder)
    called = _import_object(function)
    if not callable(called):
        raise InputError(f"function = {function!r}: this is not a function")
    ladder = tuple(getattr(called, "ladder", ()))
    return FunctionSimulator(function, called, _arguments(function, called), {}, ladder=ladder)


def _import_object(reference: str) -> Any:
    module_name, separator, name = reference.partition(":")
    if not separator:
        raise InputError(f"function = {reference!r}: write it as package.module:function")
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise InputError(f"function = {reference!r}: cannot import {module_name}: {error}") from error
    if not hasattr(module, name):
        raise InputError(f"function = {reference!r}: no {name} in {module_name}{near_match(name, dir(module))}")
    return getattr(module, name)


def _arguments(reference: str, function: Callable[..., Any]) -> dict[str, Parameter]:
    parameters = {}
    for name, argument in inspect.signature(function).parameters.items():
        if argument.kind in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD, argument.POSITIONAL_ONLY):
            raise InputError(f"function = {reference!r}: its arguments must be named, so not {argument}")
        default = None if argument.default is argument.empty else argument.default
        meaning = f"argument {name} of {reference}"
        parameters[name] = Parameter(name, default, "1", "", meaning, "user function", kind="argument")
    return parameters


def point_columns(
    simulator: Simulator, base: Mapping[str, Value], columns: Mapping[str, NDArray[Any]], count: int
) -> dict[str, NDArray[Any]]:
    """Every parameter of a block as a column: factors as given, all others from the base values or defaults.

    Returns
    -------
    dict
        Numbers as float arrays (NaN where unset), choices as object arrays (None where unset), a function's arguments
        as they are written, each of shape (count,).
    """
    full: dict[str, NDArray[Any]] = {}
    for name, parameter in simulator.parameters.items():
        if name in columns:
            full[name] = columns[name]
            continue
        value = base.get(name, parameter.default)
        if value is None and parameter.kind != "choice":
            value = math.nan
        full[name] = np.repeat(column_of(parameter, [value]), count)
    return full


def column_of(parameter: Parameter, values: Sequence[Value]) -> NDArray[Any]:
    """Values of one parameter as an array: choices as objects, numbers as floats, a function's arguments as written."""
    if parameter.kind == "choice" or any(isinstance(value, str) for value in values):
        return np.array(values, dtype=object)
    return np.array(values) if parameter.kind == "argument" else np.array(values, dtype=float)
