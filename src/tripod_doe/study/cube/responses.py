"""Variables of a cube that follow from its outputs by the formulas of [responses.NAME], made while it is written."""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.phases import PHASE_ATTRIBUTES
from tripod_doe.study.definition.responses import (
    ERROR,
    POINT,
    Response,
    divides_by_rounding,
    evaluated,
    numeric_parameters,
)
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.named_arrays import NamedArray

_MOST_POINTS = 500  # that are evaluated together
_MOST_VALUES = 2_000_000  # of an intermediate array: waveforms of a point may be broadcast over other dimensions

Outputs = Mapping[str, tuple[tuple[str, ...], NDArray[Any]]]
"""Outputs by name: the dimensions of a point's value, and values of all points, the first axis the point."""


@dataclass(frozen=True)
class ResponseValues:
    """A response at some points."""

    response: Response
    dims: tuple[str, ...]  # dimensions of a point's value
    # shape (point, *dims); NaN where a point did not finish, an output has no value, or it divides by rounding
    values: FloatArray
    error: FloatArray | None  # numerical error, of the same shape; None where it is not known

    @property
    def attributes(self) -> dict[str, Any]:
        """Unit, meaning and formula, as attributes of the variable."""
        numerical = f"in {self.response.name}{ERROR}" if self.error is not None else "not known"
        return {
            "units": self.response.unit,
            "long_name": self.response.meaning,
            "formula": self.response.formula,
            "comment": f"numerical error: {numerical}; error of the model: not known for a formula; no value where it "
            "divides by rounding",
            **(PHASE_ATTRIBUTES if self.response.expression.is_phase else {}),
        }

    @property
    def error_attributes(self) -> dict[str, Any]:
        """The same of its error."""
        meaning = f"numerical error: what the errors of the outputs in the formula change in {self.response.name}"
        return {"units": self.response.unit, "long_name": meaning}


def response_values(
    study: Study, points: Points, outputs: Outputs, labels: Mapping[str, NDArray[Any]], finished: NDArray[np.bool_]
) -> Iterator[ResponseValues]:
    """The responses of a study at some points.

    Args:
        outputs, labels: All outputs that runs gave, with labels along their dimensions.
        finished: Whether a point finished, shape (point,).

    Raises:
        InputError: If a formula of a function's outputs cannot be evaluated; the finished points are kept.
    """
    if not study.responses or not finished.any():
        return
    refuse_unknown_outputs(study, outputs)
    outputs = {
        name: (dims, study.simulator.outputs[name].given(data) if name in study.simulator.outputs else data)
        for name, (dims, data) in outputs.items()
    }
    known = tuple(response for response in study.responses if _is_given(response, study.responses, outputs))
    parts: dict[str, list[tuple[NamedArray, NDArray[Any] | None]]] = {response.name: [] for response in known}
    rounding = {response.name: np.zeros(points.count, bool) for response in known}
    parameters = _parameters(study, points)
    together = _points_together(known, outputs)
    for start in range(0, points.count, together):
        rows = slice(start, start + together)
        arrays = {
            name: NamedArray((POINT, *dims), data[rows], {dim: labels[dim] for dim in dims if dim in labels})
            for name, (dims, data) in outputs.items()
        }
        arrays |= {name: NamedArray((POINT,), column[rows]) for name, column in parameters.items()}
        errors = {
            name: outputs[f"{name}{ERROR}"][1][rows]
            for name, (dims, _) in outputs.items()
            if outputs.get(f"{name}{ERROR}", ((),))[0] == dims and f"{name}{ERROR}" in outputs
        }
        try:
            for response, value, wrong in evaluated(known, arrays, errors):
                parts[response.name].append((value, wrong))
                inherited = [rounding[other][rows] for other in response.responses]
                rounding[response.name][rows] = np.any([divides_by_rounding(response, arrays), *inherited], axis=0)
                arrays[response.name] = value
        except InputError as refused:
            raise _wrong(study, refused) from refused
    for response in known:
        own = parts[response.name]
        values, errs = (
            np.concatenate([value.data for value, _ in own]),
            [wrong for _, wrong in own if wrong is not None],
        )
        without = ~finished | rounding[response.name] | _without_value(response, study.responses, outputs)
        values[without] = np.nan
        error = np.concatenate(errs) if len(errs) == len(own) else None
        if error is not None:
            error[without] = np.nan
            error = error if np.isfinite(error).any() else None
        yield ResponseValues(response, own[0][0].dims[1:], values, error)


def _points_together(responses: Collection[Response], outputs: Outputs) -> int:
    """Number of points whose formulas are evaluated together, so that intermediate arrays stay small."""
    sizes = [math.prod(data.shape[1:]) for _, data in outputs.values()]
    widest = max([1, *sizes, *(response.widest for response in responses)])
    return max(1, min(_MOST_POINTS, _MOST_VALUES // widest))


def refuse_unknown_outputs(study: Study, names: Collection[str]) -> None:
    """Refuse formulas that use what a function does not return; InputError with the key and near names."""
    if study.simulator.outputs:
        return
    for response in study.responses:
        for name in response.outputs:
            if name not in names:
                reason = f"{response.expression.text!r}: unknown name {name!r}{near_match(name, names)}"
                raise _wrong(study, f"[responses.{response.name}]: formula = {reason}")


def _wrong(study: Study, reason: object) -> InputError:
    remedy = "finished points are kept: correct the formula and run the study again"
    return InputError(f"{study.origin}: {reason}; {remedy}")


def _outputs_for(response: Response, responses: Collection[Response]) -> set[str]:
    """All outputs from which a response is computed."""
    before = [other for other in responses if other.name in response.responses]
    return set(response.outputs).union(*(_outputs_for(other, responses) for other in before))


def _is_given(response: Response, responses: Collection[Response], outputs: Outputs) -> bool:
    """Whether runs gave all outputs of a response: a model may lack one."""
    return _outputs_for(response, responses) <= outputs.keys()


def _without_value(response: Response, responses: Collection[Response], outputs: Outputs) -> NDArray[np.bool_]:
    """Points at which an output has no number, shape (point,): a comparison with it would be false, and not unknown."""
    used = [outputs[name][1] for name in _outputs_for(response, responses)]
    empty: NDArray[np.bool_] = np.any([np.isnan(data).all(axis=tuple(range(1, data.ndim))) for data in used], axis=0)
    return empty


def _parameters(study: Study, points: Points) -> dict[str, NDArray[Any]]:
    """The parameters that formulas use, shape (point,) each; NaN where a model decides."""
    used = {name for response in study.responses for name in response.expression.used}
    columns = study.simulator.columns(study.base, points.at(slice(None)), points.count)
    for name, parameter in study.simulator.parameters.items():
        if parameter.follows and columns[name].dtype.kind == "f":
            columns[name] = np.where(np.isnan(columns[name]), columns[parameter.follows], columns[name])
    return {name: columns[name] for name in numeric_parameters(study.simulator) if name in used}
