"""A study that was read and checked: constant, and sufficient to make all its points. `study_file` reads it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tripod_doe.errors import InputError
from tripod_doe.model_interface import Accuracy, Simulator, Value
from tripod_doe.study.definition.accuracy_table import AutoModel
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.responses import Response, stored_outputs
from tripod_doe.study.definition.retry_plan import NO_RETRIES, RetryPlan
from tripod_doe.study.definition.study_file_schema import StudyFile
from tripod_doe.study.definition.study_folder import StudyFolder


@dataclass(frozen=True)
class Study:
    """A checked study: constant, and sufficient to make all its points."""

    file: StudyFile  # the parsed study file
    simulator: Simulator  # what simulates its points
    base: Mapping[str, Value]  # checked base values
    factors: Mapping[str, Factor]  # factors by name, in file order
    keep: tuple[str, ...]  # names of the outputs to keep; empty for a function that keeps all
    warnings: tuple[str, ...]  # shown to the user before it runs
    text: str  # the study file as written
    origin: str  # where it came from, for messages
    folder: StudyFolder  # where its tables and functions are looked up
    # names of the factors that an ablation switches off (0) and on (1); empty for other designs
    switches: tuple[str, ...] = ()
    retry: RetryPlan = NO_RETRIES  # changes tried on points that failed
    # accuracy for which a pilot chooses the model of every point; None where the study names its model
    auto_model: AutoModel | None = None
    # accuracy to which runs are refined where the study names its model; None for the default of `simulator`
    accuracy: Accuracy | None = None
    responses: tuple[Response, ...] = ()  # variables of the cube by formula, in file order

    @property
    def stored(self) -> tuple[str, ...]:
        """Names of the outputs that runs give: those to keep, and those that formulas of responses use."""
        return stored_outputs(self.simulator, self.keep, self.responses)

    @property
    def hash(self) -> str:
        """Hash of the study text (16 hex digits)."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]

    def fail(self, where: str, error: InputError | str) -> InputError:
        """An error that names this study file and the key; one of a kind stays of that kind."""
        kind = type(error) if isinstance(error, InputError) else InputError
        return kind(f"{self.origin}: {where}: {error}")


def canonical(study: Study) -> dict[str, str]:
    """Keys that decide the points and values of a study, with their values, to compare two versions of it."""
    flat: dict[str, str] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                walk(f"{prefix}.{key}" if prefix else key, item)
        elif value is not None:
            flat[prefix] = json.dumps(value)

    content = study.file.model_dump()
    walk("", {key: content[key] for key in ("base", "factors", "design", "designs", "keep")})
    walk("study", {key: content["study"][key] for key in ("scene", "function")})
    if study.accuracy:
        flat["accuracy"] = json.dumps(study.accuracy.text)
    if study.retry.changes:  # retries change the values of a point
        walk("run", {key: content["run"][key] for key in ("retry", "expected_outcomes")})
    return flat
