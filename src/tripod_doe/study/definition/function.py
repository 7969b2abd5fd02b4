"""A plain Python function as a simulator: named arguments in, a dict or Dataset out."""

import inspect
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.model_interface import WORK, BlockResult, Candidate, Outcome, Parameter, Simulator, Values, take_labels
from tripod_doe.names import check_cube_name

_TAKEN_NAMES = frozenset(
    {"point", "outcome", "outcome_detail", "excluded", "worker", "cpu_seconds", "wall_seconds", *WORK}
)
"""Names that every cube and its costs use already."""

_WHOLE = 2**53  # up to here float64 holds every whole number


class FunctionSimulator(Simulator):
    """A plain Python function as a simulator.

    Its parameters are the function's arguments; a study must set each one without a default. Its outputs are known
    from its first answer. With model = "auto" the choice is among the attribute ``candidates`` of the function:
    `Candidate` objects over its arguments.

    Args:
        name: ``package.module:function``.
        function: Called once for each point.
        source_hash: Hash of its code.

    Raises:
        InputError: If an argument cannot be given by its name.
    """

    def __init__(self, name: str, function: Callable[..., Any], source_hash: str = "") -> None:
        self.name, self.source_hash = name, source_hash
        self.parameters = _arguments(name, function)
        self.outputs = {}
        self.candidates = tuple(getattr(function, "candidates", ()))
        self._function = function

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Call the function for every point; an exception is the outcome error of that point alone.

        Raises:
            InputError: If answers of points differ in their shapes, dimensions or labels, or a cube cannot hold them.
        """
        count = len(next(iter(points.values())))
        block = BlockResult.blank(count, Outcome.FINISHED, simulated_seconds=np.nan)
        block.steps[:], block.force_evaluations[:] = 1, 1
        for row in range(count):
            arguments = {name: _plain(column[row]) for name, column in points.items()}
            try:
                values, labels = _outputs(self._function(**arguments))
            except Exception as error:
                block.end(row, Outcome.ERROR, f"{type(error).__name__}: {error}")
                continue
            _check_names(values, labels, arguments)
            for name, given in values.items():
                if not keep or name in keep:
                    block.put(name, given.dims, row, given.data, given.unit)
            take_labels(block.coordinates, labels)
        return block

    @property
    def record(self) -> dict[str, Any]:
        """Arguments, candidates and version as plain data, for `RecordedFunction`."""
        return {
            "arguments": {name: parameter.default for name, parameter in self.parameters.items()},
            "candidates": [asdict(candidate) for candidate in self.candidates],
            "source_hash": self.source_hash,
        }


class RecordedFunction(Simulator):
    """A recorded function, which shows results without being imported.

    Args:
        name: ``package.module:function``.
        record: As `FunctionSimulator.record` gives it.
    """

    def __init__(self, name: str, record: Mapping[str, Any]) -> None:
        self.name, self.source_hash = name, str(record.get("source_hash", ""))
        self.parameters = {
            argument: _argument(name, argument, default) for argument, default in record.get("arguments", {}).items()
        }
        self.outputs = {}
        self.candidates = tuple(Candidate(**candidate) for candidate in record.get("candidates", ()))

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Refuse (InputError): only results are read."""
        raise InputError(f"{self.name}: its function is not loaded to read results; run the study to call it")


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _outputs(answer: Any) -> tuple[dict[str, Values], dict[str, NDArray[Any]]]:
    """Outputs of one point by name, and labels along dimensions, from the answer of a function."""
    if isinstance(answer, Mapping) and not hasattr(answer, "data_vars"):  # a Dataset is a mapping, too
        arrays = {str(name): _numbers(value) for name, value in answer.items()}
        return {name: Values(tuple(f"{name}_{axis}" for axis in range(a.ndim)), a) for name, a in arrays.items()}, {}
    import xarray as xr

    if not isinstance(answer, xr.Dataset):
        raise TypeError(f"a study function must return a dict or a Dataset, not {type(answer).__name__}")
    values = {
        str(name): Values(tuple(map(str, each.dims)), _numbers(each.values), str(each.attrs.get("units", "")))
        for name, each in answer.data_vars.items()
    }
    return values, {str(dim): np.asarray(labels) for dim, labels in answer.coords.items() if dim in answer.dims}


def _numbers(value: Any) -> NDArray[np.float64]:
    """An output as numbers; NaN where a masked array has none.

    Raises:
        TypeError: For others than real numbers, of which NumPy would take a part.
        ValueError: For texts, and lists of different lengths.
    """
    written = np.ma.asarray(value)
    if written.dtype.kind in "mMc":
        raise TypeError(f"an output of type {written.dtype}: give real numbers, as amplitudes, or seconds")
    return np.where(np.ma.getmaskarray(written), np.nan, np.asarray(value, float))


def _check_names(values: Mapping[str, Values], labels: Mapping[str, NDArray[Any]], arguments: Collection[str]) -> None:
    """Refuse names of outputs, of their dimensions and labels that a cube cannot hold, or holds already."""
    for dim, each in labels.items():
        if not _fits_cube(each):
            raise InputError(
                f"dimension {dim!r}: labels of type {each.dtype}: a cube holds real numbers, as float64 does, or texts "
                "without a NUL; write dates as texts"
            )
    dims = dict.fromkeys([*(dim for each in values.values() for dim in each.dims), *labels])
    for of, names, others in (("output", values, dims), ("dimension", dims, values)):
        for name in names:
            check_cube_name(name, of)
            if name in arguments or name in _TAKEN_NAMES or name in others:
                raise InputError(
                    f"{of} {name!r}: this name is taken by an argument, by another output or dimension, or by a "
                    "variable of every cube"
                )


def _fits_cube(labels: NDArray[Any]) -> bool:
    if labels.dtype.kind in "iu":
        return bool(np.all((labels >= -_WHOLE) & (labels <= _WHOLE)))
    texts = labels.dtype.kind in "UO" and all(isinstance(label, str) and "\0" not in label for label in labels.flat)
    return texts or labels.dtype.char in "?fd"


def _arguments(reference: str, function: Callable[..., Any]) -> dict[str, Parameter]:
    parameters = {}
    for name, argument in inspect.signature(function).parameters.items():
        if argument.kind in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD, argument.POSITIONAL_ONLY):
            raise InputError(f"function = {reference!r}: its arguments must be named, so not {argument}")
        if name in _TAKEN_NAMES:
            raise InputError(f"function = {reference!r}: argument {name}: every cube holds this name; choose another")
        check_cube_name(name, f"function = {reference!r}: argument")
        default = None if argument.default is argument.empty else argument.default
        if not isinstance(default, int | float | str | None):
            raise InputError(f"function = {reference!r}: argument {argument}: its default must be a number or a word")
        parameters[name] = _argument(reference, name, default)
    return parameters


def _argument(reference: str, name: str, default: Any) -> Parameter:
    return Parameter(name, default, "1", "", f"argument {name} of {reference}", "user function", kind="argument")
