"""The service behind routes and pages: one object per server."""

from __future__ import annotations

import logging
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from typing import Any, cast

from pydantic import BaseModel

from tripod_doe.errors import StorageError, near_match, printable
from tripod_doe.files.atomic_files import remove_tree
from tripod_doe.files.regular_files import read_regular
from tripod_doe.names import path_within
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.uploads import UPLOAD, main_file
from tripod_doe.service.runs.extremes import Extremes
from tripod_doe.service.runs.found_directories import FoundDirectories
from tripod_doe.service.runs.one_run import OneRun
from tripod_doe.service.runs.run_end import has_report, is_directory, refuse_exchanged, restore_upload
from tripod_doe.service.runs.run_table import Run, State
from tripod_doe.service.runs.supervisor import Supervisor
from tripod_doe.service.security.delivered_files import check_delivered
from tripod_doe.service.security.share_links import Shares
from tripod_doe.service.settings import Settings
from tripod_doe.service.workers.worker_pool import LateError, WorkerFailedError, WorkerPool
from tripod_doe.study.cube.file_checks import analysis_files

log = logging.getLogger(__name__)

CHECK_FILE = ".study.cube.file_checks:refuse_unfit"
"""Question that refuses a file that must not be delivered."""

_UPLOADS = ".upload-"
_QUESTIONS = "workers.answers"
_ANSWERS = {"fit": ("fit",), "optimisation": ("front", "candidates")}  # files of searches; the first is the result
_SMALL_SECONDS = 5.0  # CPU time of a short answer
_MOST_SMALL, _MOST_LARGE = 20, 2  # questions of a reader: one at work, the others wait
_SPARE_THREADS = 40  # for requests that need no worker
_WITHOUT_CUBE = ("study", "figure", "report")  # kinds of steps without an analysis


class Service:
    """Runs, and the workers that answer questions about them.

    All methods may wait for a process or for the disk: call them from a thread, not from the event loop.

    Attributes:
        runs: The supervisor of the runs.
        found: Directories that the command line fills.
        extremes: Best and worst points of the runs.
        shares: Links that open one run.
        computes: Whether this client may simulate points.
        is_open: Whether the client's access is still open.
        left: Set when the client leaves: its questions are then dropped. Orders, such as a submitted run, are still
            carried out.
        threads: Threads that it needs, so that some stay free even if the most questions wait.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.runs = Supervisor(settings)
        self.found = FoundDirectories(settings.folder, self.runs, self._plan_directory)
        self._pool = WorkerPool(2, settings.limits, waiting=40)
        self._finding = WorkerPool(1, settings.limits)
        self._planning = WorkerPool(1, settings.limits, waiting=settings.limits.queued)
        self._computing = WorkerPool(1, settings.limits)
        self._large = WorkerPool(1, settings.limits)
        self._of_readers = (
            WorkerPool(2, settings.limits, waiting=40, of_one=_MOST_SMALL),
            WorkerPool(2, settings.limits, of_one=_MOST_LARGE),
        )
        self._pools = (self._pool, self._finding, self._planning, self._computing, self._large, *self._of_readers)
        self._reader = ""
        self.threads = _SPARE_THREADS + sum(pool.threads for pool in self._pools)
        self.shares = Shares(settings.folder)
        self.computes = not settings.read_only
        self.is_open: Callable[[], bool] = lambda: True
        self.left: threading.Event | None = None
        self.extremes = Extremes(self._find_extremes)
        self._started = False

    def asked_by(self, left: threading.Event) -> Service:
        """The service for one client, who may leave."""
        asked = copy(self)
        asked.left = left
        return asked

    def seen_by(self, settings: Settings, is_open: Callable[[], bool]) -> Service:
        """The service for a reader: it changes nothing, and shows only one run if the settings name one.

        Readers have workers of their own, so that the owner never waits for their questions; one reader leaves some of
        these to the others.

        Args:
            settings: Settings for this reader.
            is_open: Whether the reader's access is still open.
        """
        seen = copy(self)
        seen.settings, seen.is_open, seen.computes = settings, is_open, False
        seen._reader = settings.key
        seen._pool, seen._large = self._of_readers
        if settings.only_run:
            seen.runs = cast("Supervisor", OneRun(self.runs, settings.only_run))
        return seen

    def start(self) -> None:
        """Read the table of runs, and start workers; a second call does nothing."""
        if self._started:
            return
        self._started = True
        if not self.settings.read_only:
            self._tidy()
        self.runs.start()
        threading.Thread(target=self._watch_folder, name="directories", daemon=True).start()

    def _tidy(self) -> None:
        """Remove uploads that a kill kept from their runs, and put those back that it left aside."""
        for left in self.settings.folder.glob(f"{_UPLOADS}*"):
            remove_tree(left)
        for directory in filter(is_directory, self.settings.folder.iterdir()):
            restore_upload(directory)

    def _watch_folder(self) -> None:
        self._pool.warm()
        self.found.watch()

    def _plan_directory(self, path: Path) -> Any:
        """Counts of the study of a directory that the command line filled, on a worker for such questions alone."""
        limits = self.settings.limits
        return self._finding.ask(f"{_QUESTIONS}:plan_directory", limits.query_seconds, path=str(path), limits=limits)

    def close(self) -> None:
        """End supervision and workers; runs go on."""
        self.found.end()
        self.runs.close()
        self.end_questions()

    def end_questions(self) -> None:
        """Answer no more questions, not even waiting ones (`ServerEndsError`)."""
        self.found.end()
        for pool in self._pools:
            pool.close()

    def plan(self, body: bytes, as_json: bool = False) -> Any:
        """Price of a study or a workflow before anything of it runs; see `plans.plan_upload`."""
        limits = self.settings.limits
        timing = self.ask_body("wants_timing", body)
        pool, seconds = (self._computing, limits.simulate_seconds) if timing else (self._planning, limits.query_seconds)
        return pool.ask(f"{_QUESTIONS}:plan", seconds, as_json, self.left, body=body, limits=limits)

    def submit(self, body: bytes, key: str | None = None) -> Run:
        """Check a study or a workflow, and queue it."""
        with self._upload_folder() as upload:
            plan, digest = self._ask_plan("check", body, folder=str(upload))
            return self.runs.submit(upload, plan, key, digest)

    def resume(self, run_id: str) -> Run:
        """Queue an inactive run again: for its missing points, or where it is finished for damaged or lost files."""
        finished, directory = self.runs.find(run_id).state is State.FINISHED, self.runs.directory(run_id)
        damaged = finished and (not has_report(directory) or self.ask(f"{_QUESTIONS}:is_damaged", path=str(directory)))
        return self.runs.resume(run_id, damaged=damaged)

    @contextmanager
    def _upload_folder(self) -> Iterator[Path]:
        """Name a new folder next to the runs; at the end, remove all that was not moved from there."""
        folder = self.settings.folder
        try:
            place = Path(tempfile.mkdtemp(prefix=_UPLOADS, dir=folder))
            try:
                yield place / UPLOAD
            finally:
                remove_tree(place)
        except OSError as error:
            raise StorageError(f"{folder}: cannot write here: {error.strerror}") from error

    def fields_of(self, body: bytes, form: type[BaseModel]) -> tuple[bytes, type[BaseModel], int]:
        """The argument ``fields`` of a question: the worker passes the fields of a body as arguments."""
        return body, form, self.settings.limits.nesting

    def compute(self, question: str, as_json: bool = False, **arguments: Any) -> Any:
        """Ask a question that may take the time of a simulated point."""
        return self._computing.ask(question, self.settings.limits.simulate_seconds, as_json, self.left, **arguments)

    def simulate_again(self, place: str, **arguments: Any) -> Any:
        """Ask a question about a point of a result directory that simulates it again.

        Raises:
            RefusedError: 403 for readers, and on a read-only server: they compute nothing.
        """
        if not self.computes:
            raise RefusedError(403, "this server or this token only reads, and a point in motion is simulated again")
        return self.compute(place, **arguments)

    def ask(self, question: str, as_json: bool = False, **arguments: Any) -> Any:
        """Ask a question that a worker answers within the time of a query; see `WorkerPool.ask`.

        A long question starts again on the worker for large answers, so that small questions do not wait.
        """
        seconds = self.settings.limits.query_seconds
        try:
            small = min(_SMALL_SECONDS, seconds)
            return self._pool.ask(question, small, as_json, self.left, self._reader, **arguments)
        except LateError:
            if seconds <= _SMALL_SECONDS:
                raise
            return self.ask_large(question, as_json, **arguments)

    def ask_large(self, question: str, as_json: bool = False, **arguments: Any) -> Any:
        """Ask a question with a large answer, on a separate worker, so that small questions need not wait.

        Raises:
            AllBusyError: Also if one such question of this reader is at work, and another one waits.
        """
        seconds = self.settings.limits.query_seconds
        return self._large.ask(question, seconds, as_json, self.left, self._reader, **arguments)

    def ask_body(self, question: str, body: bytes, as_json: bool = False, **arguments: Any) -> Any:
        """Ask a question of `workers.answers` about the body of a request."""
        return self.ask(f"{_QUESTIONS}:{question}", as_json, body=body, limits=self.settings.limits, **arguments)

    def _ask_plan(self, question: str, body: bytes, **arguments: Any) -> Any:
        """Ask a question about an order, on a separate worker, so that queries need not wait for long plans."""
        limits = self.settings.limits
        place = f"{_QUESTIONS}:{question}"
        return self._planning.ask(place, limits.query_seconds, False, body=body, limits=limits, **arguments)

    def _find_extremes(self, run: Run, order: int) -> dict[str, Any] | None:
        """Best and worst point of a run; None if its cube lacks the order."""
        try:
            path = str(self.directory(run.id))
            extremes: dict[str, Any] | None = self.ask("explorer.answers:extremes", path=path, order=order)
        except (RefusedError, WorkerFailedError):  # without this order, or about to go
            return None
        return extremes

    def cube_path(self, run_id: str, step: str | None, analysis: str | None) -> str:
        """Path of the results of a run, a step or an analysis; for a search without a step or analysis, its answer."""
        run = self.runs.find(run_id)
        if run.is_search and step is None and analysis is None:
            analysis = _ANSWERS[run.kind][0]
        return str(self.analysis_file(run_id, analysis, step) if analysis else self.results(run_id, step))

    def analysis_files(self, run_id: str, step: str | None = None) -> dict[str, str]:
        """Files of a run's analyses by name; for a workflow, the analyses of its steps."""
        run = self.runs.find(run_id)
        if run.is_search and step is None:
            directory = self.directory(run_id)
            files = {name: directory / f"{name}.nc" for name in _ANSWERS[run.kind]}
            return {name: str(path) for name, path in files.items() if path.is_file()}
        if run.kind == "workflow" and step is None:
            names = [name for name, step in run.plan["steps"].items() if step["kind"] not in _WITHOUT_CUBE]
            made = {name: self.results(run_id, name) / "cube.nc" for name in names}
            return {name: str(path) for name, path in made.items() if path.is_file()}
        return {name: str(path) for name, path in analysis_files(self.results(run_id, step)).items()}

    def studies_behind(self, run_id: str, name: str, step: str | None = None) -> dict[str, str]:
        """Directories of the studies that an analysis has read, by step; a single study has an empty step name."""
        run = self.runs.find(run_id)
        if run.kind == "study" or step:
            return {step or "": str(self.results(run_id, step))}
        steps = run.plan["steps"]
        wanted, existing = list(steps.get(name, {}).get("inputs", ())), {}
        while wanted:  # an analysis may read another analysis, which reads a study
            other = wanted.pop(0)
            if "points" in steps.get(other, {}):
                existing[other] = str(self.results(run_id, other))
            else:
                wanted += steps.get(other, {}).get("inputs", ())
        return existing

    def diff(self, run_id: str, other_id: str, variables: list[str]) -> bytes:
        """What differs between two runs of studies, as ``diff --format json`` gives it."""
        paths = [str(self.results(each)) for each in (run_id, other_id)]
        answer: bytes = self.ask(f"{_QUESTIONS}:diff", a=paths[0], b=paths[1], variables=variables)
        return answer

    def plan_of(self, run_id: str) -> dict[str, Any]:
        """The price of a run at submission, and its choice of models if a pilot makes one."""
        run, directory = self.runs.find(run_id), self.directory(run_id)
        plan = dict(run.plan)
        if run.plan.get("model_chosen_by_pilot"):
            folder = directory if run.is_left_alone else directory / UPLOAD
            plan["choice"] = self.ask(f"{_QUESTIONS}:choice", folder=str(folder), path=str(directory))
        return plan

    def upload_of(self, run_id: str) -> dict[str, Any]:
        """The submitted study or workflow of a run, and its files; RefusedError 404 if they are gone or damaged."""
        run = self.runs.find(run_id)
        if run.is_left_alone:
            text, tables = self.ask(
                ".study.result_directory.stored_study:texts_of_study", directory=self.directory(run_id)
            )
            return {"study": text, "files": tables}
        folder = self.directory(run_id, UPLOAD) / UPLOAD
        try:
            texts = {path.name: read_regular(path).decode() for path in sorted(folder.iterdir())}
            return {run.kind: texts.pop(main_file(run.kind)), "files": texts}
        except (OSError, KeyError, UnicodeDecodeError) as error:
            raise RefusedError(
                404, "the submitted files of this run are gone or damaged; its results are kept"
            ) from error

    def submitted_texts(self, run_id: str) -> dict[str, str]:
        """The texts of an upload by file name, the study or the workflow first."""
        upload = self.upload_of(run_id)
        kind = next(name for name in upload if name != "files")
        return {main_file(kind): upload[kind], **upload["files"]}

    def base_of(self, run_id: str, candidate: int | None = None) -> str:
        """The joint that a fit or an optimisation gave, as [base] to paste into a study.

        Raises:
            RefusedError: 404 if there is no such candidate, or no answer yet; 409 if the run is no search.
        """
        run = self.runs.find(run_id)
        if not run.is_search:
            raise RefusedError(409, "only a fit or an optimisation gives a joint")
        path = self.cube_path(run_id, None, None)
        text: str = self.ask(f"{_QUESTIONS}:base", path=path, kind=run.kind, candidate=candidate)
        return text

    def extend(self, run_id: str, body: bytes) -> Run:
        """Queue a run with a larger study: its results stay, and only new points run.

        Raises:
            RefusedError: 409 if the run is active, or runs a workflow.
        """
        return self._extend("extend", run_id, body)

    def derive(self, run_id: str, body: bytes) -> Run:
        """Queue a run with variables by formula added to its study: its results stay.

        Raises:
            RefusedError: As for `extend`.
        """
        return self._extend("derive", run_id, body)

    def _extend(self, question: str, run_id: str, body: bytes) -> Run:
        path = self._extended(run_id)

        def note() -> None:
            if question == "derive":
                self._ask_plan("note_derived", body, path=path)

        texts = {"texts": self.submitted_texts(run_id)} if question == "derive" else {}
        with self._upload_folder() as upload:
            plan = self._ask_plan(question, body, folder=str(upload), path=path, **texts)
            return self.runs.extend(run_id, upload, plan, note)

    def _extended(self, run_id: str) -> str:
        """The directory of a run whose study may grow."""
        self.runs.refuse_extension(run_id)
        return str(self.directory(run_id))

    def plan_extension(self, run_id: str, body: bytes, as_json: bool = False) -> Any:
        """Price of what a larger study, or variables by formula, add to the results of a run.

        Raises:
            RefusedError: As for `extend`.
        """
        path = self._extended(run_id)
        arguments: dict[str, Any] = {"limits": self.settings.limits, "texts": self.submitted_texts(run_id)}
        return self.compute(f"{_QUESTIONS}:plan_extension", as_json, body=body, path=path, **arguments)

    def directory(self, run_id: str, part: str = "") -> Path:
        """The directory of a run, for delivery of a part of it; see `check_delivered`.

        Raises:
            RefusedError: 404 if there is no such run, or its directory holds other results; 403 if the part holds a
                file that must not be delivered.
        """
        run, directory = self.runs.find(run_id), self.runs.directory(run_id)
        refuse_exchanged(run, directory)
        extended = (directory / UPLOAD).is_dir()  # by this service, whose files are private in any directory
        check_delivered(directory, bool(run.place) and not extended, part)
        return directory

    def results(self, run_id: str, step: str | None = None) -> Path:
        """The directory with the cube of a run or its step; for the candidates of an optimisation, their file.

        Raises:
            RefusedError: 404 if there is no such run or step, 409 if a workflow or a search needs a step.
        """
        run = self.runs.find(run_id)
        if run.kind == "study":
            if step:
                raise RefusedError(404, f"step: {printable(step[:100])}: this run is a study; it has no steps")
            return self.directory(run_id)
        steps = run.plan["steps"]
        if step is None:
            what = "a workflow" if run.kind == "workflow" else f"a search ({run.kind})"
            raise RefusedError(409, f"step: this run is {what}: name one of its steps ({', '.join(steps)})")
        if run.kind == "optimisation" and step in _ANSWERS[run.kind]:
            return self.directory(run_id) / f"{step}.nc"
        if step not in steps:
            raise RefusedError(404, f"step: {printable(step[:100])}: no step of this run ({', '.join(steps)})")
        return path_within(self.directory(run_id, f"steps/{step}"), "steps", step)

    def analysis_file(self, run_id: str, name: str, step: str | None = None) -> Path:
        """The result of an analysis of a run, or of a study step; RefusedError 404 if there is no such analysis."""
        made = self.analysis_files(run_id, step)
        if name not in made:  # a client's name only chooses; it never becomes a path
            raise RefusedError(404, f"analysis: {name[:100]}: not made{near_match(name, made)}")
        return Path(made[name])
