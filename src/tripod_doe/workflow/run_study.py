"""Run one study from file to cube, analyses and report; a second run computes only missing points."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from tripod_doe.analyses.findings import find
from tripod_doe.analyses.model_choice.pilot import pilot_results
from tripod_doe.analyses.model_choice.study_choice import make_choice
from tripod_doe.analyses.multifidelity.study_split import (
    needs_split,
    split_lines,
    split_study,
    stored_split,
    with_samples_so_far,
)
from tripod_doe.analyses.registry import findings_of_all
from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError, option
from tripod_doe.model_interface import Outcome
from tripod_doe.names import path_within
from tripod_doe.number_text import count_of
from tripod_doe.process.interrupts import check_interrupt
from tripod_doe.reports.study_report import read_analyses, write_report
from tripod_doe.study.cube.file_digest import stored_digest
from tripod_doe.study.cube.responses import refuse_unknown_outputs
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler, tls_files
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.failure_summary import Failure, failures_in
from tripod_doe.study.journal import PILOT
from tripod_doe.study.query.look_for_sentence import found_points
from tripod_doe.study.result_directory.derived_responses import with_derived
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.study.result_directory.stored_choice import chosen_keys, chosen_points
from tripod_doe.study.study_points import StudyPoints
from tripod_doe.workflow.analyses import check_analyses, run_analyses
from tripod_doe.workflow.notebook import summary_html
from tripod_doe.workflow.progress import Progress, work_of
from tripod_doe.workflow.tolerance_confirmation import RunStudy, confirm_tolerances


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """Results of a run: where they are, counts of points, failures and findings."""

    directory: Path  # where cube, costs, analyses and report are
    # computed, reused: points of this run and of earlier ones, both with points of a pilot
    computed: int
    reused: int
    seconds: float  # wall time of blocks of points, without compilation and the start of workers
    # points whose outcome was neither finished nor expected, by outcome and reason, the most frequent first
    failures: Sequence[Failure]
    retried: bool  # whether the study has retries
    analyses: dict[str, str]  # for each analysis by name, why it failed; empty if it did not
    found: str  # sentence on the points that the study looks for; empty if it looks for none
    answers: Sequence[str]  # sentences with numbers: `found`, and the sentences of the requested analyses
    findings: Sequence[str]  # sentences with numbers, from the cube
    model_notes: Sequence[str]  # the models with their known errors, and points outside their ranges
    complete: bool  # whether every point has been run
    digest: str  # of the written cube, as at the end of its file

    @property
    def failed(self) -> dict[str, int]:
        """Number of points whose outcome was neither finished nor expected, by outcome label."""
        counts: dict[str, int] = {}
        for failure in self.failures:
            counts[failure.outcome.label] = counts.get(failure.outcome.label, 0) + failure.count
        return counts

    @property
    def good(self) -> bool:
        """Whether all points are there, none failed unexpectedly, and all analyses could be made."""
        return self.complete and not self.failures and not any(self.analyses.values())

    def _repr_html_(self) -> str:
        """The run as a notebook shows it."""
        count = f"{count_of(self.computed, 'point')} computed, {self.reused:,} reused"
        problems = [f"{label}: {count_of(number, 'point')}" for label, number in self.failed.items()]
        problems += [f"analysis {name} failed: {reason}" for name, reason in self.analyses.items() if reason]
        sentences = [*self.answers, *self.findings, *self.model_notes]
        return summary_html(count, sentences, problems, self.directory)


def run(
    study: Study | Mapping[str, Any] | str | Path,
    out: str | Path | None = None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
    fail_fast: bool = False,
    progress: bool = True,
    oversubscribe: bool = False,
    scheduler_file: str | Path | None = None,
    wait: float | None = None,
    take_over: bool = False,
    tls_ca_file: str | Path | None = None,
    tls_cert: str | Path | None = None,
    tls_key: str | Path | None = None,
    refuse_impossible: bool = False,
) -> RunSummary:
    """Run the missing points of a study, then make cube, costs, analyses and report.

    Args:
        study: The study, its file, or its tables as a dict.
        out: Result directory; made if it is not there. If omitted, it is ``results/NAME`` with the name of the study.
        workers: Worker processes, at most as many as this machine has processors; 0 runs everything in this process;
            None takes this process where that is faster than a start of workers, and two workers otherwise.
        scheduler: Address of an existing Dask scheduler to use instead.
        retry_failed: Run failed points again.
        fail_fast: Stop at the first point that fails unexpectedly.
        progress: Whether to print the progress to standard error.
        oversubscribe: Allow more workers than this machine has processors.
        scheduler_file: File of the existing Dask scheduler, in place of its address.
        wait: Seconds to wait for that scheduler, at the start as well; if omitted, 60 for one that is lost.
        take_over: Take the lock of a process that is known to be dead.
        tls_ca_file, tls_cert, tls_key: PEM files for a scheduler that talks TLS: certificates of its authority and of
            this client, and its key.
        refuse_impossible: Refuse a study at all of whose points parts do not fit or cannot move, unless it expects
            that.

    Raises:
        InputError: If the study or the directory cannot be used; nothing is started.
        StorageError: If writing fails; finished points stay in the journal.
    """
    existing, tls = None, tls_files(tls_ca_file, tls_cert, tls_key)
    if scheduler or scheduler_file:
        existing = ExistingScheduler(scheduler, Path(scheduler_file) if scheduler_file else None, wait, tls)
    elif tls:
        raise InputError(
            f"{option('tls_cert', str(tls.cert))}: credentials are for {option('scheduler')}; give it, too"
        )
    with Execution(workers, existing, oversubscribe) as execution:
        return run_on(
            execution,
            study,
            out,
            retry_failed=retry_failed,
            fail_fast=fail_fast,
            progress=progress,
            take_over=take_over,
            refuse_impossible=refuse_impossible,
        )


def run_on(
    execution: Execution,
    study: Study | Mapping[str, Any] | str | Path,
    out: str | Path | None = None,
    *,
    retry_failed: bool = False,
    fail_fast: bool = False,
    progress: bool = True,
    take_over: bool = False,
    refuse_impossible: bool = False,
    fewer: bool = False,
) -> RunSummary:
    """`run` on an execution that several studies share, with its worker processes.

    Args:
        fewer: Whether the study may lack points that have results in the directory.
    """
    study = study if isinstance(study, Study) else load_study(study)
    check_analyses(study)
    asked = StudyPoints(study, make_points(study))
    if refuse_impossible:
        asked.refuse_impossible()
    with ResultDirectory(out or results_of(study.file.study.name), take_over) as directory:
        if not fewer:
            directory.resume.refuse_unknown_version(study)
        study = _with_derived(study, directory, progress)
        asked = StudyPoints(study, asked.points)
        if study.auto_model:
            asked = _choose_models(asked, directory, execution, progress, take_over)
        piloted = 0
        if needs_split(study):
            asked, piloted = _split_samples(asked, directory, execution, fail_fast, progress)
            study = asked.study
        directory.accept(asked, fewer)
        if study.auto_model:
            _take_over_pilot(asked, directory, retry_failed)
        missing = directory.resume.missing(asked, retry_failed)
        left = missing.size
        computed = _compute(asked, missing, directory, execution, fail_fast, progress)
        del missing  # frees eight bytes per point, which the cube needs
        check_interrupt()
        written = directory.write_cube(asked, f"tripod-doe run: {piloted + computed} points computed")
        found = found_points(study, written)
        directory.note_found(found)

        def run_other(other: Study, place: Path) -> None:
            run_on(execution, other, place, retry_failed=retry_failed, progress=progress, take_over=take_over)

        return summary_of(
            asked,
            directory,
            written,
            run_other if computed == left else None,
            found,
            computed=piloted + computed,
            reused=int(asked.to_compute.sum()) - left - piloted,
            seconds=execution.seconds if piloted + computed else 0.0,
            complete=computed == left,
        )


def results_of(name: str) -> Path:
    """The usual result directory of a study by its name."""
    return path_within(Path("results"), re.sub(r"[^\w-]+", "_", name).strip("_") or "study")


def _with_derived(study: Study, directory: ResultDirectory, progress: bool) -> Study:
    """The study with the responses added to these results; its own responses of the same names replace them."""
    derived = directory.derived
    own = {name: table for name, table in study.file.responses.items() if name in derived}
    said = {
        "kept: {}, added to these results before": [name for name in derived if name not in own],
        "replaced: {}, added to these results before, by the study's formula": [
            name for name, table in own.items() if table.formula != derived[name].get("formula")
        ],
    }
    for text, names in said.items():
        if names and progress:
            print(text.format(", ".join(names)), file=sys.stderr)
    return with_derived(study, derived)


def summary_of(
    asked: StudyPoints,
    directory: ResultDirectory,
    written: xr.Dataset,
    run_other: RunStudy | None = None,
    found: str = "",
    **counts: Any,
) -> RunSummary:
    """Write analyses and report of a result directory, which is held until they are there; returns their summary.

    Args:
        asked, directory: The study with its points, and where its results are.
        written: Its cube, which is closed.
        found: Sentence on what the study looks for.
        run_other: Runs a study that confirms an analysis; None to run no study.
        **counts: ``computed``, ``reused``, ``seconds`` and ``complete`` of the summary.
    """
    study, path = asked.study, directory.path
    directory.end_journal()
    digest = stored_digest(path / "cube.nc")
    with written as cube:
        analyses = run_analyses(study, cube, path, directory.check)
        confirm_tolerances(study, path, run_other)
        findings, failures = find(cube), failures_in(cube, asked)
        notes = str(cube.attrs.get("model_notes", "")).splitlines()
    answers = [found] if found else []
    answers += findings_of_all(read_analyses(path))
    del cube, written  # the report opens the cube itself; it must not be in memory twice
    directory.check()
    write_report(path, findings)
    return RunSummary(
        directory=path,
        failures=failures,
        retried=bool(study.retry.changes),
        analyses=analyses,
        found=found,
        answers=answers,
        findings=findings,
        model_notes=notes,
        digest=digest,
        **counts,
    )


def _choose_models(
    asked: StudyPoints, directory: ResultDirectory, execution: Execution, progress: bool, take_over: bool
) -> StudyPoints:
    """The points with the chosen model of each point: the stored choice, or the choice of a pilot."""
    study = asked.study
    directory.resume.refuse_changes(asked, done=[chosen_keys(study, directory.path)])
    directory.adopt(study)

    def run_pilot(pilot: Study, place: Path) -> None:
        # after a kill it grows again from its first stage, to the same choice
        run_on(execution, pilot, place, progress=progress, take_over=take_over, fewer=True)

    choice = make_choice(study, asked.points, directory.path, run_pilot)
    return StudyPoints(study, chosen_points(study, asked.points, choice))


def _take_over_pilot(asked: StudyPoints, directory: ResultDirectory, retry_failed: bool) -> None:
    """Commit the missing points that the pilot has run with the chosen model."""
    for block in pilot_results(asked, directory.resume.missing(asked, retry_failed), directory.path / PILOT):
        directory.commit(block)


def _split_samples(
    pilot: StudyPoints, directory: ResultDirectory, execution: Execution, fail_fast: bool, progress: bool
) -> tuple[StudyPoints, int]:
    """The points with the samples of each model, stored or from the pilot; and the number of computed pilot points."""
    computed = 0
    study = stored_split(pilot.study, directory.path)
    if study is None:
        missing = directory.resume.missing(pilot)
        if missing.size:
            so_far = with_samples_so_far(pilot.study, directory.path)
            if so_far is pilot.study:
                directory.accept(pilot)
            else:
                directory.resume.refuse_changes(StudyPoints(so_far, make_points(so_far)))
                directory.note_further(missing.size)
            computed = _compute(pilot, missing, directory, execution, fail_fast, progress)
        study, split = split_study(pilot.study, directory.read(pilot), directory.path)
        if progress:
            print("\n".join(split_lines(split)), file=sys.stderr)
    return StudyPoints(study, make_points(study)), computed


def _compute(
    asked: StudyPoints,
    missing: IntArray,
    directory: ResultDirectory,
    execution: Execution,
    fail_fast: bool,
    progress: bool,
) -> int:
    """Run the missing points with a progress bar, commit their blocks, and return their number."""
    if missing.size == 0:
        return 0
    computed = 0
    with (
        Progress(int(missing.size), progress, work_of(asked, missing)) as shown,
        directory.computing() as died_before,
        closing(execution.run(asked, missing, careful=died_before)) as finished,
    ):
        for block in finished:
            directory.commit(block)
            if not computed and (block.result.outcome == Outcome.FINISHED).any():
                refuse_unknown_outputs(asked.study, block.result.outputs)
            computed += block.keys.size
            shown.add(block.keys.size)
            if fail_fast and not asked.good_outcomes.issuperset(block.result.outcome.tolist()):
                break
    return computed
