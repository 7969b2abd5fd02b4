"""Result directories: how a run ended, from its files alone.

So the next server gets the same answer, whoever started the run.
"""

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from tripod_doe.errors import CubeError, InputError
from tripod_doe.files.atomic_files import refuse_links, remove_tree
from tripod_doe.files.checksum_list import results_number
from tripod_doe.files.regular_files import read_regular
from tripod_doe.service.problems import RefusedError, among_runs
from tripod_doe.service.requests.uploads import STUDY, UPLOAD, main_file
from tripod_doe.service.runs.processes import has_begun, last_words
from tripod_doe.service.runs.run_table import ID, PointCounts, Run, State
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.definition.study_folder import table_copy
from tripod_doe.study.definition.toml_text import parse_toml
from tripod_doe.study.journal import COMPUTING, Journal, journal_path
from tripod_doe.study.result_directory.open_cube import is_shown
from tripod_doe.workflow.steps_file import STEPS, found_sentences, read_steps

_LEAST = 1_000_000  # free bytes that a run needs to end in order
_FULL = "the disk is full; resume goes on at the next missing point"
_CHOOSES = "a pilot chooses the model of each point before the first one"
_WRITES_CUBE = "all points have ended; now the cube is written"
_MAKES_REPORT = "all points have ended; now the analyses and the report are made"
_OLD_UPLOAD = f".{UPLOAD}.old"
_COPIES = {"fit": "fit.toml", "optimisation": "optimise.toml"}  # of what a search runs, in its directory
_SILENT = "its process ended without a message; resume goes on at the next missing point"


def ending_of(run: Run, counts: PointCounts, steps: Sequence[Mapping[str, Any]], directory: Path) -> tuple[State, str]:
    """State and message of a run whose process has ended."""
    if run.is_search:
        whole, failed = has_report(directory), []
    elif run.kind == "workflow":
        left = [step["name"] for step in steps if step["state"] in ("waiting", "failed", "blocked")]
        whole = not left and has_report(directory)
        failed = [f"{step['name']}: {step['detail']}" for step in steps if step["state"] == "failed"]
    else:
        try:
            whole = not counts.missing and is_shown(directory) and has_report(directory)
        except CubeError as error:
            return State.FAILED, among_runs(str(error), directory)
        failed = []
    if whole:
        return State.FINISHED, found_sentences(directory)
    if run.state is State.STOPPING:
        return State.STOPPED, ""
    if run.is_left_alone:
        here = "" if run.has_function else "extend it here, or "
        missing = "points are missing" if counts.missing else "its report is missing, or being made"
        return State.STOPPED, f"{missing}: {here}run the study again from the command line"
    if failed:  # of the studies that ended, what they were to look for is known
        return State.FAILED, "; ".join(filter(None, (*failed, found_sentences(directory))))
    return State.FAILED, last_words(directory) or (_FULL if _is_full(directory) else _SILENT)


def work_beside_points(run: Run, counts: PointCounts, directory: Path) -> str:
    """What a study at work does before its first or after its last point; else, and if it cannot be read now, empty.

    Workflows and searches say it in their steps.
    """
    if run.plan.get("model_chosen_by_pilot") and not counts.finished + counts.failed:
        return _CHOOSES
    if run.kind != "study" or counts.missing or (run.retry_failed and counts.failed) or not has_begun(directory):
        return ""
    with suppress(CubeError):
        if not is_shown(directory):
            with Journal(directory, read_only=True) as journal:
                return "" if journal.recall(COMPUTING) == "yes" else _WRITES_CUBE
        return _MAKES_REPORT
    return ""


def _is_full(directory: Path) -> bool:
    """Whether the disk is full: then a run cannot even report it."""
    return shutil.disk_usage(directory if directory.exists() else directory.parent).free < _LEAST


def has_report(directory: Path) -> bool:
    """Whether the report exists; it is written last: after the cube of a study, or the last step of a workflow."""
    return page_of(directory).is_file()


def remove_report(directory: Path) -> None:
    """Remove the report before a run goes on: a new report then marks its end, without comparing times."""
    with suppress(OSError):  # the run reports a folder that cannot be written
        page_of(directory).unlink()


def remove_answers(directory: Path) -> None:
    """Remove report and analyses of a study that has grown: they do not belong to the study that waits."""
    with suppress(OSError, InputError):  # the run reports a folder that cannot be written, or is a link
        refuse_links(directory)
        for path in (page_of(directory), *analysis_files(directory).values()):
            path.unlink(missing_ok=True)


def remove_stages(directory: Path) -> None:
    """Remove the stages of a search's earlier run: the search starts again, and reuses the stored points."""
    with suppress(OSError):
        (directory / STEPS).unlink()


def replace_upload(directory: Path, upload: Path) -> None:
    """Move an upload into a directory, in place of an earlier one."""
    restore_upload(directory)
    own, before = directory / UPLOAD, directory / _OLD_UPLOAD
    remove_tree(before)  # of a run that was killed
    if own.exists():
        own.rename(before)
    upload.rename(own)
    remove_tree(before)


def restore_upload(directory: Path) -> None:
    """Put an upload back that a kill has left aside while another one took its place."""
    with suppress(OSError):
        if not (directory / UPLOAD).exists():
            (directory / _OLD_UPLOAD).rename(directory / UPLOAD)


def results_in(directory: Path) -> dict[str, Any]:
    """What shows whose results are in a directory, by the names of a `Run`; zeros where there is nothing."""
    inode = 0
    with suppress(OSError):
        inode = os.lstat(journal_path(directory)).st_ino
    with suppress(CubeError):  # a list that is none
        return {"inode": inode, "results": results_number(directory)}
    return {"inode": inode, "results": 0}


def with_results(run: Run, directory: Path) -> Run:
    """A run at work with what shows its results, once they are begun."""
    if run.results and (run.inode or not run.place):
        return run
    here = results_in(directory)
    return replace(run, **here) if here["results"] and here["results"] == (run.results or here["results"]) else run


def is_exchanged(run: Run, directory: Path) -> bool:
    """Whether a directory holds other results than its run made.

    Results of the command line are recognised by their file: a link to one run does not open a copy of it that is
    continued elsewhere. A run of the service stays the same run in a copy of the whole folder.
    """
    here = results_in(directory)
    if run.results and here["results"] != run.results:
        return True
    computed = run.counts.finished + run.counts.failed
    if here["results"] and run.state in (State.QUEUED, State.STOPPED) and not (run.place or run.results or computed):
        return not _is_begun_by_hand(run, directory)  # by the service it has computed nothing
    return bool(run.place and run.inode) and here["inode"] != run.inode


def _is_begun_by_hand(run: Run, directory: Path) -> bool:
    """Whether the results in a directory are of what was submitted there: the command line began it, or none are there.

    The price of a larger study, or a formula, makes the journal of a run that was stopped before it started.
    """
    if run.kind == "workflow":  # steps of other studies are made again
        return {step.get("name") for step in read_steps(directory)} <= run.plan["steps"].keys()
    try:
        if run.kind == "study":
            return not is_another_study(directory)
        return read_regular(directory / UPLOAD / main_file(run.kind)) == read_regular(directory / _COPIES[run.kind])
    except (OSError, InputError):  # one of them is missing, or no file
        return False


def is_own(directory: Path) -> bool:
    """Whether the service made a directory, and its results are of what was submitted there."""
    return bool(ID.fullmatch(directory.name)) and (directory / UPLOAD).is_dir() and not is_another_study(directory)


def is_another_study(path: Path) -> bool:
    """Whether the study of a directory, or a table of it, is another one than was submitted there.

    What a run adds does not count: variables by formula, which a later upload need not name, and the samples of each
    model that a pilot has decided.
    """
    submitted = {file.name: file for file in (path / UPLOAD).glob("*")}
    main, stored = submitted.pop(STUDY, None), path / STUDY
    if main and stored.is_file():
        ours, its = read_regular(main), read_regular(stored)
        if ours != its and not _is_grown(_tables(ours), _tables(its)):
            return True
    tables = [(file, table_copy(path, name)) for name, file in submitted.items()]
    return any(copy.is_file() and read_regular(file) != read_regular(copy) for file, copy in tables)


def _is_grown(ours: dict[str, Any], its: dict[str, Any]) -> bool:
    """Whether the tables of a study are those that were submitted, with what the run itself adds."""
    added = ("split", "prices") if "split" not in ours.get("design", {}) else ()
    for tables in (ours, its):
        tables.pop("responses", None)
        for key in added:
            tables.get("design", {}).pop(key, None)
    return ours == its


def _tables(study: bytes) -> dict[str, Any]:
    """The tables of a study; empty if they cannot be read."""
    try:
        return parse_toml(study.decode(errors="replace"), "study")
    except InputError:
        return {}


def refuse_exchanged(run: Run, directory: Path) -> None:
    """Refuse (RefusedError 404) a run whose directory holds other results."""
    if is_exchanged(run, directory):
        soon = "shown in place of this one within seconds if it can be; else " if run.kind == "study" else ""
        raise RefusedError(
            404,
            f"{run.id}: its directory holds the results of another run: {soon}put its own back, or delete this run, "
            "which leaves that directory",
        )


def page_of(directory: Path) -> Path:
    """Its report."""
    return directory / "report" / "index.html"


def is_directory(path: Path) -> bool:
    """Whether a path is a real directory, not a link that may lead out of the folder."""
    return path.is_dir() and not path.is_symlink()
