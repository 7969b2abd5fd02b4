"""The joint as a simulator: points in, outputs and outcomes out, by the model each point asks for."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.joint import models
from tripod_doe.joint.fit import misfits
from tripod_doe.joint.ladder import JOINT_LADDER
from tripod_doe.joint.outputs import JOINT_OUTPUTS, coordinates
from tripod_doe.joint.parameters import JOINT_PARAMETERS, internal_units
from tripod_doe.mechanics.sources import source_hashes
from tripod_doe.quantities import Value
from tripod_doe.results import BlockResult, Outcome, Values

__all__ = ["JointScene", "scene"]

_NUMERICS = ("relative_tolerance", "step_s")


class JointScene:
    """The full tripod joint, simulated by a model of the ladder.

    Attributes
    ----------
    name
        Name of the scene in study files.
    parameters, outputs
        Everything that can be set and kept.
    source_hash
        Hash of all kernel sources: results with different hashes must not be mixed.
    ladder
        Models and numerics that model = "auto" may choose from.
    """

    name = "joint"
    parameters = JOINT_PARAMETERS
    outputs = JOINT_OUTPUTS
    source_hash = source_hashes().results
    ladder = JOINT_LADDER
    _prepared: ClassVar[set[tuple[str, str]]] = set()

    def check(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], keep: Collection[str]
    ) -> list[str]:
        """Check what no single value shows, and return warnings.

        Parameters
        ----------
        base
            Values that were given, the same for all points.
        factors
            Values that each factor takes.
        keep
            Outputs to keep.

        Raises
        ------
        InputError
            If a base value sets a method that no model in play has, or numerics that no method in play uses, or if
            points would have outputs of different lengths.
        """
        names = factors.get("model") or [base.get("model") or JOINT_PARAMETERS["model"].default]
        in_play = [models.MODELS[str(name)] for name in names]
        _check_numerics(base, factors, in_play)
        for factor, dim in (("samples_per_revolution", "rotation_deg"), ("cycles", "cycle")):
            long = [name for name in keep if dim in JOINT_OUTPUTS[name].dims]
            if long and factor in factors and len(set(factors[factor])) != 1:
                raise InputError(
                    f"{factor} is a factor, so {' and '.join(long)} would have different lengths; "
                    "keep other outputs, for instance thrust_amplitude"
                )
        return [
            f"{name} is not represented by {' or '.join(m.name for m in in_play)}: its values all give the same answer"
            for name in factors
            if all(name in model.ignores for model in in_play)
        ]

    def effective(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Complete the values of one point: defaults, and what follows from other parameters or from the model."""
        full = {name: values.get(name, parameter.default) for name, parameter in JOINT_PARAMETERS.items()}
        if full["groove_spin_friction"] is None:
            full["groove_spin_friction"] = full["groove_sliding_friction"]
        if full["groove_rolling_lever_mm"] is None:
            full["groove_rolling_lever_mm"] = full["roller_radius_mm"]
        model = models.MODELS[str(full["model"])]
        if full["method"] is None:
            full["method"] = model.default_method
        for name, value in model.methods.get(str(full["method"]), {}).items():
            if full[name] is None:
                full[name] = value
        return full

    def prepare(self, points: Mapping[str, NDArray[Any]]) -> None:
        """Compile the kernels that these points need, or load their machine code, by runs that cost nothing."""
        for name, method in {(name, _method(name, method)) for name, method in _pairs(points)}:
            if (name, method) not in self._prepared and method in models.MODELS[name].methods:
                full = self.effective({"model": name, "method": method, "samples_per_revolution": 30})
                column = {key: np.array([value], float) for key, value in full.items() if not isinstance(value, str)}
                models.MODELS[name].prepare(internal_units(column), method)
                self._prepared.add((name, method))

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate a block of points.

        Parameters
        ----------
        points
            Every parameter by name, each of shape (point,); NaN or None where unset.
        keep
            Names of the outputs to return.

        Returns
        -------
        BlockResult
            In the order of the points; no point's values depend on the others in the block.
        """
        count = len(points["model"])
        outcome = np.full(count, Outcome.NOT_APPLICABLE, np.int8)
        detail = [""] * count
        work, followed = np.zeros((3, count), np.int64), np.zeros(count)
        outputs: dict[str, Values] = {}
        methods = np.array([_method(model, method) for model, method in _pairs(points)])
        kinds = list(zip(points["model"], methods, points["samples_per_revolution"], points["cycles"], strict=True))
        for kind in sorted(set(kinds)):
            name, method, per_revolution = str(kind[0]), str(kind[1]), int(kind[2])
            model = models.MODELS[name]
            wanted = [output for output in keep if output in model.outputs]
            chosen = np.flatnonzero([other == kind for other in kinds])
            columns = {key: np.asarray(column)[chosen] for key, column in points.items()}
            usable = _reject(model, method, columns, chosen, outcome, detail)
            if usable.size == 0:
                continue
            result = model.simulate(_numbers(model, method, columns, usable), method, per_revolution, wanted)
            where = chosen[usable]
            outcome[where] = result.outcome
            for position, text in zip(where, result.detail, strict=True):
                detail[position] = text
            work[:, where] = result.steps, result.force_evaluations, result.solves
            followed[where] = result.simulated_seconds
            for key, values in result.outputs.items():
                if key not in outputs:
                    outputs[key] = Values(values.dims, np.full((count, *values.data.shape[1:]), np.nan))
                finished = result.outcome == Outcome.FINISHED
                outputs[key].data[where[finished]] = values.data[finished]
        used = {dim for values in outputs.values() for dim in values.dims}
        labels = coordinates(int(points["samples_per_revolution"][0]), int(points["cycles"][0]))
        labels = {name: label for name, label in labels.items() if name in used}
        return BlockResult(outputs, labels, outcome, detail, work[0], work[1], work[2], followed)


def _unset(value: object) -> bool:
    return value is None or value != value


def _pairs(points: Mapping[str, NDArray[Any]]) -> list[tuple[str, object]]:
    return list(zip((str(model) for model in points["model"]), points["method"], strict=True))


def _method(model: str, method: object) -> str:
    """The method of a point: the model's own where none is named."""
    return models.MODELS[model].default_method if _unset(method) else str(method)


def _check_numerics(
    base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], in_play: list[models.Model]
) -> None:
    """Refuse a method, step or tolerance that nothing in play uses."""
    named = ", ".join(model.name for model in in_play)
    known = {method: used for model in in_play for method, used in model.methods.items()}
    asked = factors.get("method") or [base.get("method")]
    if base.get("method") is not None and str(base["method"]) not in known:
        raise InputError(f"method = {base['method']}: not a method of {named}; theirs are {', '.join(known)}")
    for parameter in _NUMERICS:
        if base.get(parameter) is None:
            continue
        methods = [str(name) for name in asked] if asked != [None] else [model.default_method for model in in_play]
        if not any(parameter in known.get(method, {}) for method in methods):
            users = [method for method, used in known.items() if parameter in used]
            raise InputError(
                f"{parameter} = {base[parameter]}: not used by {', '.join(methods)} ({named}); leave it out"
                + (f", or take a method that uses it: {', '.join(users)}" if users else "")
            )


def _numbers(
    model: models.Model, method: str, columns: Mapping[str, NDArray[Any]], usable: NDArray[np.int64]
) -> dict[str, NDArray[np.float64]]:
    """Numeric columns of the usable points in internal units, with the model's own numerics where unset."""
    numbers = {}
    for name, parameter in JOINT_PARAMETERS.items():
        if parameter.kind == "choice":
            continue
        column = np.asarray(columns[name][usable], float)
        fallback = model.methods[method].get(name)
        numbers[name] = column if fallback is None else np.where(np.isnan(column), fallback, column)
    return internal_units(numbers)


def _reject(
    model: models.Model,
    method: str,
    columns: Mapping[str, NDArray[Any]],
    chosen: NDArray[np.int64],
    outcome: NDArray[np.int8],
    detail: list[str],
) -> NDArray[np.int64]:
    """Mark the points that the model cannot run, and return the positions within `chosen` of all others."""
    usable = np.ones(chosen.size, bool)
    if method not in model.methods:
        for position in chosen:
            detail[position] = f"method {method} is not one of {model.name}"
        return np.flatnonzero(~usable)
    for name in _NUMERICS:
        if name in model.methods[method]:
            continue
        is_set = np.array([not _unset(value) for value in columns[name]])
        for position in np.flatnonzero(is_set):
            detail[chosen[position]] = f"{name} is not used by {model.name} with {method}"
        usable &= ~is_set
    for misfit, reason in misfits(_numbers(model, method, columns, np.arange(chosen.size))):
        if usable[misfit]:
            outcome[chosen[misfit]] = Outcome.JAMMED
            detail[chosen[misfit]] = reason
            usable[misfit] = False
    return np.flatnonzero(usable)


scene = JointScene()
"""The scene that study files reach as ``joint``."""
