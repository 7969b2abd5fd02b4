"""A block on a Dask worker: computed, or refused with a reason.

Why not `Client.get_versions`: it looks once (66 ms), at the present workers; others join at any time.
"""

import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError
from tripod_doe.study.definition.simulators import matching_simulator
from tripod_doe.study.execution.block_answer import Answer
from tripod_doe.study.execution.task import Task, run_task
from tripod_doe.study.execution.user_code import UserCode, placed


@dataclass(frozen=True)
class Unfit:
    """Refusal of a worker that cannot run a study."""

    # name, address: of the worker
    name: str
    address: str
    reason: str  # the reason, as the end of a sentence about the worker


@cache
def our_version() -> str:
    """Version of the package in this process, cached since it is parsed from a file."""
    return version("tripod-doe")


def _by_value() -> Callable[[str, bytes], tuple[str, str, bytes | str]]:
    """A function that is sent with its code, without references to this package, so that any worker can answer."""

    def run_block(wanted: str, work: bytes) -> tuple[str, str, bytes | str]:
        from distributed import get_worker

        worker = get_worker()
        try:
            from tripod_doe.study.execution.dask_task import answer_as_bytes, our_version
        except Exception as error:
            problem = f"it has no tripod-doe that can be used ({type(error).__name__}: {error})"
            return str(worker.name), str(worker.address), problem
        if our_version() != wanted:
            problem = f"it has tripod-doe {our_version()}, and {wanted} is needed"
            return str(worker.name), str(worker.address), problem
        return str(worker.name), str(worker.address), answer_as_bytes(work, str(worker.name))

    return run_block


run_block = _by_value()
"""Run pickled work (a task and the user's code, if any) on a worker of a wanted version of this package.

Gives name and address of the worker with a pickled answer, or with the reason why it cannot run it.
"""


def answer_as_bytes(work: bytes, name: str) -> bytes | str:
    """On a worker: the pickled answer of a block, or the reason why this worker cannot run it."""
    task: Task
    code: UserCode | None
    task, code = pickle.loads(work)
    try:
        if code and task.folder:
            place = Path(placed(code, str(task.folder.path)))
            task = replace(task, folder=replace(task.folder, path=place))
        matching_simulator(task.scene, task.function, task.folder, task.source_hash)
    except InputError as error:
        return str(error)
    return pickle.dumps(Answer(*run_task(task), name))


def read_answer(sent: tuple[str, str, Any]) -> Answer | Unfit:
    """The answer or refusal that a worker sent."""
    name, address, content = sent
    return pickle.loads(content) if isinstance(content, bytes) else Unfit(name, address, content)
