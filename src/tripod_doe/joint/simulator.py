"""The joint as a simulator: outputs and outcomes of points, each computed by its model."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.joint.accuracy import OrderAccuracy
from tripod_doe.joint.geometry.feasibility import infeasible
from tripod_doe.joint.known_errors.error_estimate import (
    FINEST,
    NOT_LOOKED_AT,
    QUANTITY,
    WITHOUT_ITS_VIBRATION,
    WITHOUT_VIBRATION,
    errors_at,
    similar_errors,
)
from tripod_doe.joint.known_errors.operating_ratios import TOUCHING, has_no_thrust, operating_ratios, touching_spheres
from tripod_doe.joint.known_errors.vibration_record import SHARE, near_vibrating, vibration_errors, vibration_share
from tripod_doe.joint.models.balances import some_vibrate
from tripod_doe.joint.models.candidates import JOINT_CANDIDATES
from tripod_doe.joint.models.model import Model
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.outputs import JOINT_OUTPUTS, STEP_ERROR, VIBRATES, vibration_tests
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.unit_conversion import internal_values, point_values
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.compilation.sources import source_hashes
from tripod_doe.mechanics.contact_damping_parameters import settled
from tripod_doe.model_interface import (
    NOT_REPRESENTED,
    NUMERICS,
    Accuracy,
    BlockResult,
    Departure,
    Methods,
    ModelErrors,
    Outcome,
    Simulator,
    Value,
    is_set,
)

_NO_TORQUE = (
    "without torque no force presses the rollers into their grooves; set torque_n_m, or use model equilibrium, which "
    "leaves out their inertia"
)
_NO_END = "settled_needles: model needles follows as many cycles as are asked for, and no further; raise cycles instead"
_KIND = ("model", "method", "samples_per_revolution", "cycles")
"""Parameters that points must share for a common call of a solver."""


class JointSimulator(Simulator):
    """The full tripod joint, simulated by the model that each point names."""

    name = "joint"
    parameters = JOINT_PARAMETERS
    outputs = JOINT_OUTPUTS
    source_hash = source_hashes().results
    candidates = JOINT_CANDIDATES
    model_names = tuple(MODELS)
    accuracy: OrderAccuracy | None = None

    def refined_to(self, accuracy: Accuracy) -> JointSimulator:
        """Make a simulator that refines its runs to the accuracy that a study requires of named orders."""
        for quantity in accuracy.quantities:
            if quantity.output != "thrust_amplitude" or quantity.label is None:
                raise InputError(f"[accuracy]: {quantity.name}: runs are refined to orders of thrust_amplitude")
        other = copy(self)
        other.accuracy = OrderAccuracy.of(accuracy)
        return other

    def effective(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Complete the values of one point; its run finds its tolerance or step if neither is given."""
        full = super().effective(values)
        full |= settled(full)
        if any(is_set(values.get(name)) for name in NUMERICS):
            return full | {"accuracy": None}
        if not MODELS[str(full["model"])].settles:
            return full
        return full | dict.fromkeys(NUMERICS)

    def recorded_price(self, values: Mapping[str, Value]) -> float | None:
        """As recorded for the usual number of cycles; a run in time costs as much for each of them."""
        price, cycles = super().recorded_price(values), self.parameters["cycles"].default
        own = self.effective(values)
        in_time = own["method"] != "newton"  # a balance has no time
        return price and price * (float(own["cycles"] or 0) / float(cycles or 1) if in_time else 1.0)

    def methods(self, values: Mapping[str, Value]) -> Methods:
        """Methods of the model that these values name."""
        return MODELS[str(values["model"])].methods

    def check(
        self, base: Mapping[str, Value], factors: Mapping[str, Collection[Value]], keep: Collection[str]
    ) -> list[str]:
        """Check like any simulator, and warn of factors that no model of the study represents."""
        warnings = super().check(base, factors, keep)
        names = factors.get("model") or [base.get("model") or JOINT_PARAMETERS["model"].default]
        in_play = [MODELS[str(name)] for name in names]
        given = [name for name in NUMERICS if is_set(base.get(name))]
        if given and (is_set(base.get("accuracy")) or "accuracy" in factors):
            warnings.append(f"accuracy has no effect where {given[0]} is given")
        usual = [name for name, output in JOINT_OUTPUTS.items() if not output.on_request]  # kept without [keep]
        lacking = [name for name in keep if name in JOINT_OUTPUTS and not any(name in m.outputs for m in in_play)]
        if lacking and not set(usual) <= set(keep):
            warnings.append(f"{', '.join(lacking)}: not computed by {' or '.join(model.name for model in in_play)}")
        # vibration depends on parameters that do not affect a balance's thrust
        decides = frozenset(JOINT_PARAMETERS) - MODELS["rollers"].ignores
        tests_all, tests_some = vibration_tests(keep)
        asked = decides if tests_all else frozenset()
        # equilibrium tests for vibrations only if their growth is requested
        looked_at = decides if tests_some and any(m.name != "equilibrium" for m in in_play) else frozenset()
        return warnings + [
            f"{name} is not represented by {' or '.join(m.name for m in in_play)}: its values all give the same "
            + ("thrust; whether the joint vibrates may follow from it (vibrates)" if name in looked_at else "answer")
            for name in factors
            if all(name in model.ignores - asked for model in in_play)
        ]

    def model_errors(
        self, points: Mapping[str, NDArray[Any]], outputs: Mapping[str, NDArray[Any]] | None = None
    ) -> ModelErrors:
        """Errors of the third order against `needles`, from similar measured points.

        If the outputs state whether a joint vibrates, the vibration of other joints no longer matters; if they do not
        and a similar joint vibrates, its result is not sure: of such recorded joints that would be, 6 of 72 vibrate by
        which their third order changes by more than 5 %, of those without vibrating neighbours none of 335.
        """
        count = len(points["model"])
        expected, limit, unknown = np.empty(count), np.empty(count), np.empty(count, object)
        vibrates = (outputs or {}).get(VIBRATES, np.full(count, np.nan))
        departures, unsettled = [], np.zeros(count, bool)
        for model, rows, own in _by_model(points):
            ratios, vibration = operating_ratios(own), vibration_errors(own)
            if model.name in WITHOUT_VIBRATION:
                unsettled[rows] = np.isnan(vibrates[rows]) & near_vibrating(own) & ~has_no_thrust(ratios)
            vibration[vibrates[rows] == 0] = 0.0
            expected[rows], limit[rows], unknown[rows] = errors_at(model.name, ratios, vibration, vibrates[rows] == 1)
            share = np.where(vibrates[rows] == 1, 0.0, vibration_share(vibration))
            quantities = own | ratios | {SHARE: share, TOUCHING: touching_spheres(own, ratios)}
            for left in model.valid:
                inside = (quantities[left.quantity] >= left.low) & (quantities[left.quantity] <= left.high)
                beyond = ~inside & ~has_no_thrust(ratios) & (own["torque_n_m"] != 0)  # no ratio holds without torque
                outside = np.zeros(count, bool)
                outside[rows] = beyond
                departures.append(Departure(model.name, left, outside, quantities[left.quantity][beyond]))
        models_of = np.asarray(points["model"], object)
        stated = (WITHOUT_ITS_VIBRATION,)
        return ModelErrors(
            QUANTITY, FINEST, models_of, expected, limit, unknown, departures, stated, unsettled, NOT_LOOKED_AT
        )

    def numerical_errors(self, outputs: Mapping[str, NDArray[Any]]) -> FloatArray | None:
        """Relative numerical error of the third order, if the run reports it; zero for a zero order."""
        known = [outputs[name][:, 3] for name in ("thrust_amplitude_error", STEP_ERROR) if name in outputs]
        if "thrust_amplitude" not in outputs or not known:
            return None
        size, error = outputs["thrust_amplitude"][:, 3], np.fmax.reduce(known)
        return np.asarray(np.divide(error, size, out=np.zeros_like(error), where=size > 0))

    def recorded_errors(self, points: Mapping[str, NDArray[Any]], accuracy: Accuracy) -> FloatArray | None:
        """Errors of the second and third order against `needles` at similar measured points."""
        similar: FloatArray | None = None
        for model, rows, own in _by_model(points):
            vibrates = some_vibrate(own) if model.name in WITHOUT_VIBRATION else None
            errors = similar_errors(model.name, own, accuracy, vibrates)
            if errors is None:
                return None
            if similar is None:
                similar = np.full((len(points["model"]), *errors.shape[1:]), np.nan)
            similar[rows] = errors
        return similar

    def describe_model(self, model: str) -> dict[str, Any]:
        """Parameters that a model ignores and the ranges in which it holds, as plain data."""
        described = MODELS[model]
        return {
            "ignores": sorted(described.ignores),
            "holds": [
                {
                    "quantity": valid.quantity,
                    "minimum": valid.low if np.isfinite(valid.low) else None,
                    "maximum": valid.high if np.isfinite(valid.high) else None,
                    "unit": valid.unit,
                    "meaning": valid.meaning or self.parameters[valid.quantity].meaning,
                    "reason": valid.reason,
                }
                for valid in described.valid
            ],
        }

    def missing_effects(self, model: str) -> Mapping[str, str]:
        """Parameters that lack an effect in a model, each with what the model leaves out."""
        ignored = dict.fromkeys(sorted(MODELS[model].ignores), f"{NOT_REPRESENTED} model {model}")
        return ignored | dict(MODELS[model].lacks)

    def compile(self, model: str, method: str) -> None:
        """Compile the kernels of a model and a method, or load their machine code, by a short run."""
        if method in MODELS[model].methods:
            full = self.effective({"model": model, "method": method, "samples_per_revolution": 30})
            MODELS[model].prepare(point_values(full), method)

    def foreseen(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[int, Outcome, str]]:
        """Points that are not run: parts do not fit or slide, or the model lacks the method or numerics."""
        endings: list[tuple[int, Outcome, str]] = []
        for (name, method, _, _), chosen in self._kinds(points):
            model = MODELS[name]
            if method not in model.methods:
                text = f"method {method} is not one of {model.name}"
                endings += [(int(position), Outcome.NOT_APPLICABLE, text) for position in chosen]
                continue
            columns = _of_rows(points, chosen)
            refused = _refused(model, method, columns, _values(model, method, columns))
            endings += [(int(chosen[row]), *why) for row, why in refused.items()]
        return endings

    def simulate(self, points: Mapping[str, NDArray[Any]], keep: Collection[str]) -> BlockResult:
        """Simulate a block of points, those of one model, method and number of samples together."""
        block = BlockResult.blank(len(points["model"]), Outcome.NOT_APPLICABLE)
        usable = np.ones(block.count, bool)
        for row, outcome, reason in self.foreseen(points):
            block.end(row, outcome, reason)
            usable[row] = False
        for (name, method, samples, _), alike in self._kinds(points):
            model, chosen = MODELS[name], alike[usable[alike]]
            if chosen.size:
                columns = _of_rows(points, chosen)
                wanted = [output for output in keep if output in model.outputs]
                values = _values(model, method, columns)
                block.fill(chosen, model.simulate(values, method, samples, wanted, self.accuracy))
        first = {name: points[name][0] for name in self.length_parameters}
        block.coordinates.update(self.labels(block.outputs, first))
        return block

    def _kinds(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[tuple[str, str, int, int], IntArray]]:
        """Positions of the points with the same model, method, samples per revolution and cycles."""
        count, columns = len(points["model"]), {name: np.asarray(points[name]) for name in _KIND}
        one = count > 0 and all((column == column[0]).all() for column in columns.values())  # as in most blocks
        if one:
            columns = {name: column[:1] for name, column in columns.items()}
        numbers = (columns[name].astype(float) for name in ("samples_per_revolution", "cycles"))
        kinds = [(*solver, int(n), int(c)) for solver, n, c in zip(self.solvers(columns), *numbers, strict=True)]
        if one:
            return [(kinds[0], np.arange(count))]
        rows: dict[tuple[str, str, int, int], list[int]] = {}
        for row, kind in enumerate(kinds):
            rows.setdefault(kind, []).append(row)
        return [(kind, np.array(rows[kind])) for kind in sorted(rows)]


def _by_model(points: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Model, IntArray, dict[str, NDArray[Any]]]]:
    """The points of each model: their positions and all their parameters."""
    names = list(dict.fromkeys(points["model"].tolist()))
    for name in names:
        rows = np.flatnonzero(points["model"] == name) if len(names) > 1 else np.arange(len(points["model"]))
        yield MODELS[name], rows, _of_rows(points, rows)


def _of_rows(points: Mapping[str, NDArray[Any]], rows: IntArray) -> dict[str, NDArray[Any]]:
    """All parameters of some points, whose ascending rows are given; no copies where these are all points."""
    if rows.size == len(points["model"]):
        return {name: np.asarray(column) for name, column in points.items()}
    return {name: np.asarray(column)[rows] for name, column in points.items()}


def _values(model: Model, method: str, columns: Mapping[str, NDArray[Any]]) -> JointValues[FloatArray]:
    """Values of points in internal units, with the method's own numerics where they are not given."""
    own = {} if model.settles else {name: value for name, value in model.methods[method].items() if value is not None}
    numerics = {name: np.asarray(columns[name], float) for name in own}
    return internal_values(
        {**columns, **{name: np.where(np.isnan(column), own[name], column) for name, column in numerics.items()}}
    )


def _refused(
    model: Model, method: str, columns: Mapping[str, NDArray[Any]], values: JointValues[FloatArray]
) -> dict[int, tuple[Outcome, str]]:
    """Points of one model and method that are not run, with outcome and reason."""
    refused: dict[int, tuple[Outcome, str]] = {}
    for name in NUMERICS:
        if name not in model.methods[method]:
            text = f"{name} is not used by {model.name} with {method}"
            given = np.flatnonzero(~np.isnan(np.asarray(columns[name], float)))
            refused |= {int(row): (Outcome.NOT_APPLICABLE, text) for row in given}
    if model.name not in WITHOUT_VIBRATION:
        refused |= {int(row): (Outcome.OUT_OF_RANGE, _NO_TORQUE) for row in np.flatnonzero(values.torque == 0)}
    if model.name == FINEST:
        refused |= {int(row): (Outcome.NOT_APPLICABLE, _NO_END) for row in np.flatnonzero(values.settled_needles > 0)}
    return infeasible(values) | refused


simulator = JointSimulator()
"""The scene that study files reach as ``joint``."""
