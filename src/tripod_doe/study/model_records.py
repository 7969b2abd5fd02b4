"""What is known of the models behind the points of a study: their errors, ranges that points leave, missing effects."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.simulator import Departure, ModelErrors, ValidRange, departure_texts, model_error_texts
from tripod_doe.study.definition import Study
from tripod_doe.study.designs import Points

__all__ = ["MODEL_ERROR", "MODEL_ERROR_LIMIT", "ModelRecords", "model_records"]

MODEL_ERROR, MODEL_ERROR_LIMIT = "model_error", "model_error_limit"
"""Variables of a cube: the error to expect of each point's model, and its limit."""

_CHUNK = 20_000
"""Points whose parameters are held at once."""


@dataclass(frozen=True)
class ModelRecords:
    """The models of all points that no constraint excludes.

    Attributes
    ----------
    errors
        Their models, and the errors known of them.
    departures
        What ranges the points leave.
    missing_effects
        Parameters that none of the models represents in full, each with what they leave out.
    allowed
        Which points of the study these are, shape (point,).
    """

    errors: ModelErrors
    departures: list[Departure]
    missing_effects: Mapping[str, str]
    allowed: NDArray[np.bool_]

    @property
    def told_errors(self) -> list[str]:
        """Sentences that name the models with their errors."""
        return model_error_texts(self.errors)

    @property
    def warnings(self) -> list[str]:
        """Sentences on the ranges that points leave."""
        return departure_texts(self.departures, self.errors.models)

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes of a cube: models, notes and missing effects."""
        return {
            "models": ", ".join(dict.fromkeys(self.errors.models)),
            "model_notes": "\n".join([*self.told_errors, *self.warnings]),
            "missing_effects": json.dumps(dict(self.missing_effects)),
        }

    @property
    def columns(self) -> dict[str, tuple[NDArray[np.float64], str]]:
        """Error and limit of every point, shape (point,) each, with their meanings; empty where none is known."""
        found: dict[str, tuple[NDArray[np.float64], str]] = {}
        if not np.isfinite(self.errors.expected).any():
            return found
        of = f"relative error of the {self.errors.quantity} by the model, against {self.errors.reference}"
        for name, values, meaning in (
            (MODEL_ERROR, self.errors.expected, f"{of}: median of similar points"),
            (MODEL_ERROR_LIMIT, self.errors.limit, f"{of}: 90th percentile of similar points"),
        ):
            whole = np.full(self.allowed.size, np.nan)
            whole[self.allowed] = values
            found[name] = whole, meaning
        return found


def model_records(study: Study, points: Points, used: Mapping[str, NDArray[Any]]) -> ModelRecords | None:
    """What is known of the models of all points; None where the simulator has one model only, or none is chosen yet.

    Parameters
    ----------
    study, points
        The study and its points.
    used
        What a pilot or retries changed of the parameters of each point; an empty word where they changed nothing.
    """
    rows = np.flatnonzero(points.allowed)
    if not rows.size or (study.accuracy is not None and "model" not in used):
        return None
    known = []
    outside: dict[tuple[str, ValidRange], NDArray[np.bool_]] = {}
    for start in range(0, rows.size, _CHUNK):
        chosen = slice(start, start + _CHUNK)
        columns = _parameters(study, points, used, rows[chosen])
        errors = study.simulator.model_errors(columns)
        if errors is None:
            return None
        known.append(errors)
        for departure in study.simulator.departures(columns):
            left = outside.setdefault((departure.model, departure.left), np.zeros(rows.size, bool))
            left[chosen] = departure.outside
    errors = ModelErrors.joined(known)
    lacking = [study.simulator.missing_effects(model) for model in dict.fromkeys(errors.models)]
    missing = {name: reason for name, reason in lacking[0].items() if all(name in other for other in lacking)}
    departures = [Departure(*kind, left) for kind, left in outside.items()]
    return ModelRecords(errors, departures, missing, points.allowed)


def _parameters(
    study: Study, points: Points, used: Mapping[str, NDArray[Any]], rows: NDArray[np.int64]
) -> dict[str, NDArray[Any]]:
    """Every parameter of some points, with the model that each ran with in the end."""
    varied = {name: column[rows] for name, column in points.settings.items()}
    columns = study.simulator.columns(study.base, varied, rows.size)
    if "model" in used:
        columns["model"] = np.where(used["model"][rows] == "", columns["model"], used["model"][rows])
    return columns
