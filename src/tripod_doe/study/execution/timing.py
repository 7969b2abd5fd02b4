"""Timing of some points of a study, in a process that can be stopped in time."""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Timer

import numpy as np

from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.child_process import answers, start_child
from tripod_doe.study.execution.task import make_task, run_task

_SAMPLES = 12
_BATCH_SECONDS = 0.2
_TIMES = 3  # repetitions of all points of a small study
_CANDIDATES = 50_000  # points from which those to time are drawn


def time_points(study: Study, seconds: float) -> list[float]:
    """CPU seconds per point, for points spread over the design.

    The first call of a process is slower: it counts only where no other ends in time.

    Args:
        seconds: Time after which timing stops, compilation not counted; the measurements until then are returned.
    """
    folder = {"path": str(study.folder.path), "trusted": study.folder.trusted}
    asked = json.dumps({"text": study.text, "origin": study.origin, "folder": folder})
    with start_child(__name__) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        stop = Timer(seconds, process.kill)
        try:
            process.stdin.write(asked)
            process.stdin.close()
            process.stdout.readline()  # its kernels are compiled
            stop.start()
            measured = [float(line) for line in process.stdout]
            return measured[1:] or measured
        finally:
            stop.cancel()
            process.kill()


def timings(study: Study, prepared: Callable[[], object] = lambda: None) -> Iterator[float]:
    """Yield the CPU seconds of one point, and per point of some batches of points, of a fifth of a second each.

    Timing ends after three times the number of points of the study. `prepared` is called when the kernels are
    compiled.
    """
    points = make_points(study)
    allowed = np.flatnonzero(points.allowed)
    allowed = allowed[np.unique(np.linspace(0, allowed.size - 1, _CANDIDATES).astype(int))]
    full = study.simulator.columns(study.base, points.at(allowed), allowed.size)
    allowed = np.delete(allowed, [row for row, *_ in study.simulator.foreseen(full)])  # these cost nothing
    study.simulator.prepare(full)
    prepared()
    if not allowed.size:
        return
    yield run_task(make_task(study, points, allowed[:1]))[1]
    random, batch, timed = np.random.default_rng(0), 1, 0
    for _ in range(_SAMPLES):
        if timed >= _TIMES * allowed.size:
            return
        chosen = random.choice(allowed, min(batch, allowed.size), replace=False)
        timed += chosen.size
        seconds = run_task(make_task(study, points, chosen))[1] / chosen.size
        wanted = int(np.clip(_BATCH_SECONDS / max(seconds, 1e-6), 1, min(allowed.size, 10_000)))
        if 2 * batch >= wanted:  # smaller batches are mostly overhead
            yield seconds
        batch = wanted


if __name__ == "__main__":
    stream = answers()
    asked = json.load(sys.stdin)
    folder = StudyFolder(Path(asked["folder"]["path"]), asked["folder"]["trusted"])
    timed = parse_study(asked["text"], asked["origin"], folder)
    for seconds in timings(timed, lambda: print("prepared", file=stream, flush=True)):
        print(seconds, file=stream, flush=True)
