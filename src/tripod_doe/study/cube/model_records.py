"""Models of the points of a study: known errors, ranges of validity that points leave, and missing effects."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.model_interface import ModelSummary, Trust
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points

MODEL_ERROR, MODEL_ERROR_LIMIT, TRUST = "model_error", "model_error_limit", "trust"
"""Variables of a cube: expected error of each point's model, its limit, and trust in the point."""

Columns = dict[str, tuple[NDArray[Any], str]]

_CHUNK = 10_000
"""Points whose parameters are in memory at once."""

_PART = 100_000
"""Points whose errors are in memory at once where only their summary is needed."""


class ModelRecords:
    """Models of the points of a study with a result, collected part by part.

    Sentences about an ablation count the points with all mechanisms on, whose thrust is broken down; those about a
    multifidelity study the points of the truth, since cheaper models only narrow its intervals.
    """

    def __init__(self, study: Study) -> None:
        self._study, self._every = study, ModelSummary()
        self._counted = ModelSummary("with all mechanisms on" if study.switches else "")

    def of(
        self,
        points: Points,
        used: Mapping[str, NDArray[Any]],
        answered: NDArray[np.bool_],
        outputs: Mapping[str, NDArray[Any]],
    ) -> Columns:
        """Add some points, and return the known errors of their models.

        Args:
            used: Parameters that a pilot or retries changed at each point; an empty word where they are unchanged.
            answered: Points with a result, or a possible one, shape (point,). The others get no error.
            outputs: Outputs of the points, each of shape (point, ...).

        Returns:
            Error, limit and trust of every point, shape (point,) each, with their meanings; empty without known errors.
        """
        rows = np.flatnonzero(points.allowed & answered)
        if self._study.auto_model is not None and "model" not in used:
            return {}
        expected, limit = np.full((2, points.count), np.nan)
        trust, of = np.full(points.count, Trust.NOT_KNOWN, np.int8), ""
        for start in range(0, rows.size, _CHUNK):
            chosen = rows[start : start + _CHUNK]
            columns = self._parameters(points, used, chosen)
            known = {name: data[chosen] for name, data in outputs.items()}
            errors = self._study.simulator.model_errors(columns, known)
            if errors is None:
                return {}
            numerical = self._study.simulator.numerical_errors(known)
            trust[chosen] = self._every.add(errors, numerical)
            checks, prices = self._study.simulator.surer_models(columns, known, trust[chosen])
            self._every.add_checks(checks, prices)
            if required := self._required():
                own = np.all([columns[name] == value for name, value in required.items()], axis=0)
                self._counted.add(errors.of(own), None if numerical is None else numerical[own])
                self._counted.add_checks(checks[own], prices)
            expected[chosen], limit[chosen] = errors.expected, errors.limit
            of = f"relative error of the {errors.quantity} by the model, against {errors.reference}"
        judged = {TRUST: (trust, "how far the point can be trusted")} if rows.size else {}
        if not np.isfinite(expected).any():
            return judged
        return judged | {
            MODEL_ERROR: (expected, f"{of}: median of similar points"),
            MODEL_ERROR_LIMIT: (limit, f"{of}: 90th percentile of similar points"),
        }

    def _required(self) -> dict[str, object]:
        """Values of the points that sentences count; empty if they count all."""
        design, required = self._study.file.design, dict[str, object](dict.fromkeys(self._study.switches, 1))
        if design.kind == "multifidelity" and (values := self._study.factors[design.fidelity].values):
            return required | {design.fidelity: values[-1]}
        return required

    def _parameters(self, points: Points, used: Mapping[str, NDArray[Any]], rows: IntArray) -> dict[str, NDArray[Any]]:
        """All parameters of some points, with the model of the last attempt."""
        columns = self._study.simulator.columns(self._study.base, points.at(rows), rows.size)
        if "model" in used:
            columns["model"] = np.where(used["model"][rows] == "", columns["model"], used["model"][rows])
        return columns

    @property
    def _summary(self) -> ModelSummary:
        """The points that sentences count: chosen ones, else all."""
        return self._counted if self._counted.models else self._every

    @property
    def verdict(self) -> list[str]:
        """Trust in the points, in one sentence; none without points."""
        return self._summary.verdict_texts

    @property
    def error_sentences(self) -> list[str]:
        """Sentences that name the models with their errors."""
        return self._summary.error_texts

    @property
    def warnings(self) -> list[str]:
        """Sentences about ranges of validity that points leave."""
        return self._summary.departure_texts

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes of a cube: models, notes and missing effects; empty without known errors."""
        models = self._every.models
        if not models:
            return {}
        lacking = [self._study.simulator.missing_effects(model) for model in models]
        missing = {name: reason for name, reason in lacking[0].items() if all(name in other for other in lacking)}
        return {
            "models": ", ".join(models),
            "model_notes": "\n".join(self._summary.texts),
            "missing_effects": json.dumps(missing),
        }


def model_records(study: Study, points: Points, able: NDArray[np.bool_]) -> ModelRecords:
    """Records of the models of all points that may get a result, shape (point,), before any has run."""
    records = ModelRecords(study)
    for start in range(0, points.count, _PART):
        stop = min(start + _PART, points.count)
        records.of(points.part(start, stop), {}, able[start:stop], {})
    return records
