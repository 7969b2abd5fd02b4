"""The joint as a simulator: points in, outputs and outcomes out, by the model each point asks for."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.joint import models
from tripod_doe.joint.outputs import JOINT_OUTPUTS, coordinates
from tripod_doe.joint.parameters import JOINT_PARAMETERS, internal_units
from tripod_doe.mechanics.compilation import KERNEL_SOURCE_HASH
from tripod_doe.quantities import Value
from tripod_doe.results import BlockResult, Outcome, Values

__all__ = ["JointScene", "scene"]

_NUMERICS = ("method", "relative_tolerance", "step_s")


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
    """

    name = "joint"
    parameters = JOINT_PARAMETERS
    outputs = JOINT_OUTPUTS
    source_hash = KERNEL_SOURCE_HASH

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
            If a base value sets a numerics parameter that no method in play uses, or if points would have waveforms
            of different lengths.
        """
        names = factors.get("model") or [base.get("model") or JOINT_PARAMETERS["model"].default]
        in_play = [models.MODELS[str(name)] for name in names]
        for parameter in _NUMERICS:
            users = [model for model in in_play if parameter in model.numerics]
            if base.get(parameter) is not None and not users:
                raise InputError(
                    f"{parameter} = {base[parameter]}: not used by {', '.join(m.name for m in in_play)}; "
                    f"leave it out{_usable(in_play)}"
                )
        long = [name for name in keep if "rotation_deg" in JOINT_OUTPUTS[name].dims]
        if long and "samples_per_revolution" in factors and len(set(factors["samples_per_revolution"])) != 1:
            raise InputError(
                f"samples_per_revolution is a factor, so {' and '.join(long)} would have different lengths; "
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
        for name, value in models.MODELS[str(full["model"])].numerics.items():
            if full[name] is None:
                full[name] = value
        return full

    def prepare(self) -> None:
        """Compile the kernels, or load their machine code from the disk, by a run that costs nothing."""
        point: dict[str, NDArray[Any]] = {}
        for name, value in self.effective({"samples_per_revolution": 30}).items():
            point[name] = np.array([value if isinstance(value, str) else math.nan if value is None else float(value)])
        self.simulate(point, ())

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
        work = np.zeros((2, count), np.int64)
        outputs: dict[str, Values] = {}
        groups = {(str(m), int(n)) for m, n in zip(points["model"], points["samples_per_revolution"], strict=True)}
        for name, per_revolution in sorted(groups):
            model = models.MODELS[name]
            wanted = [output for output in keep if output in model.outputs]
            chosen = np.flatnonzero((points["model"] == name) & (points["samples_per_revolution"] == per_revolution))
            columns = {key: np.asarray(column)[chosen] for key, column in points.items()}
            usable = _reject(model, columns, chosen, outcome, detail)
            if usable.size == 0:
                continue
            result = model.simulate(_numbers(model, columns, usable), per_revolution, wanted)
            where = chosen[usable]
            outcome[where] = result.outcome
            for position, text in zip(where, result.detail, strict=True):
                detail[position] = text
            work[:, where] = result.steps, result.force_evaluations
            for key, values in result.outputs.items():
                if key not in outputs:
                    outputs[key] = Values(values.dims, np.full((count, *values.data.shape[1:]), np.nan))
                finished = result.outcome == Outcome.FINISHED
                outputs[key].data[where[finished]] = values.data[finished]
        used = {dim for values in outputs.values() for dim in values.dims}
        labels = coordinates(int(points["samples_per_revolution"][0]))
        labels = {name: label for name, label in labels.items() if name in used}
        return BlockResult(outputs, labels, outcome, detail, work[0], work[1])


def _usable(in_play: list[models.Model]) -> str:
    names = sorted({name for model in in_play for name in model.numerics})
    return f" (used: {', '.join(names)})" if names else ""


def _numbers(
    model: models.Model, columns: Mapping[str, NDArray[Any]], usable: NDArray[np.int64]
) -> dict[str, NDArray[np.float64]]:
    """Numeric columns of the usable points in internal units, with the model's own numerics where unset."""
    numbers = {}
    for name, parameter in JOINT_PARAMETERS.items():
        if parameter.kind == "choice":
            continue
        column = np.asarray(columns[name][usable], float)
        fallback = model.numerics.get(name)
        numbers[name] = np.where(np.isnan(column), fallback, column) if isinstance(fallback, float) else column
    return internal_units(numbers)


def _reject(
    model: models.Model,
    columns: Mapping[str, NDArray[Any]],
    chosen: NDArray[np.int64],
    outcome: NDArray[np.int8],
    detail: list[str],
) -> NDArray[np.int64]:
    """Mark the points that the model cannot run, and return the positions within `chosen` of all others."""
    usable = np.ones(chosen.size, bool)
    for name in _NUMERICS:
        if name in model.numerics:
            continue
        is_set = np.array([value is not None and value == value for value in columns[name]])
        for position in np.flatnonzero(is_set):
            detail[chosen[position]] = f"{name} is not used by {model.name}"
        usable &= ~is_set
    for misfit, reason in _misfits(columns):
        if usable[misfit]:
            outcome[chosen[misfit]] = Outcome.JAMMED
            detail[chosen[misfit]] = reason
            usable[misfit] = False
    return np.flatnonzero(usable)


def _misfits(columns: Mapping[str, NDArray[Any]]) -> list[tuple[int, str]]:
    """Points whose parts cannot be put together, with the reason."""
    pitch, needle = columns["needle_pitch_diameter_mm"], columns["needle_diameter_mm"]
    bore = pitch + needle + 2 * columns["bearing_radial_clearance_mm"]
    with np.errstate(invalid="ignore"):
        angle = 2 * np.arcsin(np.minimum(needle / pitch, 1.0)) * columns["needle_count"]
    reasons = [
        (needle >= pitch, "the needles leave no trunnion: needle_diameter_mm must be below needle_pitch_diameter_mm"),
        (angle > 2 * math.pi, "the needles do not fit on the pitch circle: reduce needle_count or needle_diameter_mm"),
        (bore >= 2 * columns["roller_radius_mm"], "the bore is larger than the roller: raise roller_radius_mm"),
    ]
    return [(int(position), text) for bad, text in reasons for position in np.flatnonzero(bad)]


scene = JointScene()
"""The scene that study files reach as ``joint``."""
