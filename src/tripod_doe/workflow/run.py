"""Run one study from file to cube, analyses and report; run again, and only what is missing runs."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from tqdm import tqdm

from tripod_doe.analysis.registry import check_analyses, run_analyses
from tripod_doe.atomic_files import replace_text
from tripod_doe.errors import InputError
from tripod_doe.interrupts import check_interrupt
from tripod_doe.report.findings import find
from tripod_doe.report.page import write_report
from tripod_doe.simulator import Outcome
from tripod_doe.study.cube import build_cube
from tripod_doe.study.definition import Study, canonical, load_study, parse_study
from tripod_doe.study.designs import Points, make_points, point_keys
from tripod_doe.study.execution import Policy, local_workers, run_blocks
from tripod_doe.study.journal import PILOT, FinishedBlock, Journal
from tripod_doe.study.netcdf import stamp_history, write_dataset
from tripod_doe.study.plan import cube_bytes
from tripod_doe.workflow.choice import chosen_keys, chosen_points, make_choice
from tripod_doe.workflow.pilot_results import pilot_results

__all__ = ["RunSummary", "run"]

_SPARE_BYTES = 20_000_000


@dataclass(frozen=True)
class RunSummary:
    """What a run left behind.

    Attributes
    ----------
    directory
        Where cube, costs, analyses and report are.
    computed, reused
        Points that ran now, and that were there before, those of a pilot included.
    seconds
        Wall time from the first block sent to the last one committed.
    failed
        Points whose outcome was neither finished nor expected, by outcome label.
    analyses
        By name, why an analysis could not be made; empty where it was.
    findings
        Sentences with numbers, from the cube.
    complete
        Whether every point has been run.
    """

    directory: Path
    computed: int
    reused: int
    seconds: float
    failed: dict[str, int]
    analyses: dict[str, str]
    findings: Sequence[str]
    complete: bool

    @property
    def good(self) -> bool:
        """Whether all points are there, none failed unexpectedly, and all analyses could be made."""
        return self.complete and not self.failed and not any(self.analyses.values())


def run(
    study: Study | str | Path,
    out: str | Path,
    workers: int = 2,
    scheduler: str | None = None,
    retry_failed: bool = False,
    fail_fast: bool = False,
    progress: bool = True,
) -> RunSummary:
    """Run what is missing of a study, then make cube, costs, analyses and report.

    Parameters
    ----------
    study
        The study, or its file.
    out
        Result directory; made if it is not there.
    workers
        Worker processes of the local cluster.
    scheduler
        Address of an existing Dask scheduler to use instead.
    retry_failed
        Run points again that failed before.
    fail_fast
        Stop at the first point that fails unexpectedly.
    progress
        Whether to draw a progress bar on standard error.

    Raises
    ------
    InputError
        If the study or the directory cannot be used; nothing is started.
    StorageError
        If writing fails; finished points stay in the journal.
    """
    if not isinstance(study, Study):
        study = load_study(study)
    check_analyses(study)
    points = make_points(study)
    if workers < 1:
        raise InputError(f"--workers {workers}: at least 1 is needed")
    directory = _make_directory(Path(out))
    with ExitStack() as stack:
        journal = stack.enter_context(Journal(directory))
        if study.accuracy:
            _refuse_changes(study, point_keys(study, points), chosen_keys(study, directory), journal, directory)
            _adopt(study, journal, directory)

            def run_pilot(pilot: Study, place: Path) -> None:
                nonlocal scheduler  # one cluster for all stages of the pilot and for the study
                scheduler = scheduler or stack.enter_context(local_workers(workers))
                run(pilot, place, workers, scheduler, progress=progress)

            points = chosen_points(study, points, make_choice(study, points, directory, run_pilot))
        keys = point_keys(study, points)
        _refuse_changes(study, keys[points.allowed], journal.keys(), journal, directory)
        missing = _missing(study, points, keys, journal, retry_failed)
        _check_space(study, directory, points)
        _adopt(study, journal, directory)
        if study.accuracy:
            for block in pilot_results(study, points, keys, missing, directory / PILOT):
                journal.commit(block)
            missing = _missing(study, points, keys, journal, retry_failed)
        policy = Policy(workers, scheduler, study.file.run.block, study.file.run.exclusive)
        computed, seconds = _run_missing(study, points, keys, missing, journal, policy, fail_fast, progress)
        check_interrupt()
        cube, cost = build_cube(study, points, keys, journal.blocks())
    action = f"tripod-doe run: {computed} points computed"
    write_dataset(stamp_history(cost, action), directory / "cost.nc")
    write_dataset(stamp_history(cube, action), directory / "cube.nc")
    analyses = run_analyses(study, cube, directory)
    findings, failures = find(cube), _failures(study, points, cube)
    del cube, cost  # the report reads its own; a large cube need not be in memory twice
    write_report(directory)
    return RunSummary(
        directory,
        computed,
        np.unique(keys[points.allowed]).size - missing.size,
        seconds,
        failures,
        analyses,
        findings,
        complete=computed == missing.size,
    )


def _make_directory(directory: Path) -> Path:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {directory}: cannot make this directory: {error.strerror}") from error
    return directory


def _refuse_changes(
    study: Study, keys: NDArray[np.void], done: NDArray[np.void], journal: Journal, directory: Path
) -> None:
    """Refuse a study that is not the one whose results are here, key by key, unless it only grew."""
    stored = directory / "study.toml"
    if done.size == 0 or not stored.exists():
        return
    kernels = journal.recall("kernel_source_hash")
    if kernels != study.simulator.source_hash:
        raise InputError(
            f"{directory}: its points were computed by another version of the kernels ({kernels}, now "
            f"{study.simulator.source_hash}); choose another --out"
        )
    old, new = canonical(parse_study(stored.read_text(encoding="utf-8"), str(stored), study.folder)), canonical(study)
    grew = bool(np.isin(done, keys).all())
    changed = sorted(key for key in old.keys() | new.keys() if old.get(key) != new.get(key))
    if grew and not any(key.startswith(("keep", "run")) for key in changed):
        return
    told = [f"  {key}: {old.get(key, 'not set')} -> {new.get(key, 'not set')}" for key in changed]
    raise InputError(
        f"{study.origin}: the study changed under the results in {directory}; choose another --out, or take back\n"
        + "\n".join(told or ["  the points of the table"])
    )


def _missing(
    study: Study, points: Points, keys: NDArray[np.void], journal: Journal, retry_failed: bool
) -> NDArray[np.int64]:
    """Indices of the points to run: each different one once, without those in the journal."""
    done = journal.keys()
    if retry_failed:
        ended = {
            key.tobytes(): int(o)
            for block in journal.blocks()
            for key, o in zip(block.keys, block.result.outcome, strict=True)
        }
        good = _good_outcomes(study)
        done = np.array([key for key in done if ended[key.tobytes()] in good], dtype="V16")
    _, first = np.unique(keys, return_index=True)
    first = np.sort(first)
    return first[points.allowed[first] & ~np.isin(keys[first], done)]


def _good_outcomes(study: Study) -> set[int]:
    """Outcomes that do not count as failures: finished, and what the study expects."""
    return {int(Outcome.FINISHED)} | {int(o) for o in Outcome if o.label in study.file.run.expected_outcomes}


def _check_space(study: Study, directory: Path, points: Points) -> None:
    """Refuse to start where journal and cube will not fit."""
    needed = _SPARE_BYTES + 2 * (cube_bytes(study, points) or 0)
    free = shutil.disk_usage(directory).free
    if free < needed:
        raise InputError(
            f"--out {directory}: {free / 1e6:.1f} MB free, but journal and cube need {needed / 1e6:.1f} MB; "
            "keep fewer outputs or choose another --out"
        )


def _adopt(study: Study, journal: Journal, directory: Path) -> None:
    """Make this study the one of the directory."""
    journal.remember("kernel_source_hash", study.simulator.source_hash)
    replace_text(directory / "study.toml", study.text)


def _run_missing(
    study: Study,
    points: Points,
    keys: NDArray[np.void],
    missing: NDArray[np.int64],
    journal: Journal,
    policy: Policy,
    fail_fast: bool,
    progress: bool,
) -> tuple[int, float]:
    """Run the missing points under a progress bar; returns how many came back, and in how many seconds."""
    if missing.size == 0:
        return 0, 0.0
    good = _good_outcomes(study)
    computed = 0
    with tqdm(total=int(missing.size), unit="point", disable=not progress, file=sys.stderr, smoothing=0.05) as bar:

        def commit(block: FinishedBlock) -> bool:
            nonlocal computed
            journal.commit(block)
            computed += block.keys.size
            bar.update(block.keys.size)
            return not (fail_fast and any(int(outcome) not in good for outcome in block.result.outcome))

        seconds = run_blocks(study, points, keys, missing, policy, commit)
    return computed, seconds


def _failures(study: Study, points: Points, cube: xr.Dataset) -> dict[str, int]:
    outcome = cube["outcome"].values.ravel()[points.allowed]
    good = _good_outcomes(study)
    return {
        kind.label: int((outcome == kind).sum())
        for kind in Outcome
        if int(kind) not in good and (outcome == kind).any()
    }
