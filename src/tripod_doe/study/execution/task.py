"""A block of points as a task: small enough to send to any process, and run there without Dask."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.model_interface import Accuracy, BlockResult, Value
from tripod_doe.study.definition.retry_plan import NO_RETRIES, RetryPlan
from tripod_doe.study.definition.simulators import matching_simulator
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.execution.retry import simulate_with_retries

if TYPE_CHECKING:  # for their names only: a single point needs no designs
    from tripod_doe.study.definition.study import Study
    from tripod_doe.study.designs import Points


@dataclass(frozen=True)
class Task:
    """A block with all that a worker needs to simulate it."""

    scene: str
    function: str | None
    folder: StudyFolder | None  # None for a scene
    source_hash: str
    base: Mapping[str, Value]
    columns: dict[str, NDArray[Any]]
    count: int
    keep: tuple[str, ...]
    retry: RetryPlan = NO_RETRIES
    accuracy: Accuracy | None = None


def run_task(task: Task) -> tuple[BlockResult, float, float]:
    """Simulate one block, with retries if the study has them: results, CPU seconds, wall seconds.

    Compilation is not counted.
    """
    simulator = matching_simulator(task.scene, task.function, task.folder, task.source_hash)
    if task.accuracy:
        simulator = simulator.refined_to(task.accuracy)
    points = simulator.columns(task.base, task.columns, task.count)
    return simulate_with_retries(simulator, points, task.keep, task.retry)


def make_task(study: Study, points: Points, chosen: IntArray) -> Task:
    """The task that simulates the chosen points."""
    table = study.file.study
    return Task(
        table.scene,
        table.function,
        study.folder,
        study.simulator.source_hash,
        study.base,
        points.at(chosen),
        chosen.size,
        study.stored,
        study.retry,
        study.accuracy,
    )
