"""The supervisor of runs: starts queued runs, counts finished points, notices ends, stops and deletes runs.

After a restart it reads all about a run from table and directory: with a free lock and missing points, it is dead.
"""

import logging
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError, StorageError
from tripod_doe.service.problems import RefusedError, among_runs
from tripod_doe.service.requests.uploads import UPLOAD
from tripod_doe.service.runs import processes, run_end
from tripod_doe.service.runs.annotations import AnnotationFiles, with_annotation
from tripod_doe.service.runs.bin import Bin
from tripod_doe.service.runs.events import Events
from tripod_doe.service.runs.run_end import ending_of, is_directory
from tripod_doe.service.runs.run_table import PointCounts, Run, RunTable, State, now, stamp
from tripod_doe.service.runs.run_work import RunWork, next_to_start, refuse_full_queue, start_work
from tripod_doe.service.settings import Settings
from tripod_doe.study.result_directory.annotation import annotated, write_annotation

_PERIOD = 0.25  # seconds between two checks: a finished point must show within a second
_BIN_PERIOD = 3600.0  # seconds from the start until the bin is emptied: a clock that is wrong is set right meanwhile
_FURTHER = "further points, or variables by formula"
_PATIENCE = 20.0  # seconds for a look that a disk delays

log = logging.getLogger(__name__)


@contextmanager
def _logged(what: str) -> Iterator[None]:
    """Log any error, and go on."""
    try:
        yield
    except Exception:
        log.exception("%s", what)


def _planned(plan: Mapping[str, Any]) -> dict[str, Any]:
    """What a run takes from its plan."""
    named = {key: plan[key] for key in ("kind", "name", "question")}
    return {**named, "plan": plan, "counts": PointCounts(plan["unique"])}


class Supervisor:
    """The runs of a folder; InputError if the table of runs cannot be opened."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.events = Events()
        self._table = RunTable(settings.folder, settings.read_only)
        self._lock = threading.RLock()
        self._runs: dict[str, Run] = {}
        self._bin = Bin(settings.folder, self._table)
        self._work: dict[str, RunWork] = {}
        self._changing: set[str] = set()  # runs that are taking a larger study now
        self._annotation_files = AnnotationFiles()
        self._bin_due = time.monotonic() + _BIN_PERIOD
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look_after, name="supervisor", daemon=True)

    def start(self) -> None:
        """Find the runs of earlier servers, and supervise all runs from now on."""
        rows = self._table.all()
        self._bin.show(run for run in rows if run.binned)
        for run in [run for run in rows if not run.binned]:
            if not run.place or is_directory(self.settings.folder / run.place):
                self._show(run)
                if run.state is State.RUNNING and self._is_unbegun(run):
                    self._store(run.changed(state=State.QUEUED))
            elif not self.settings.read_only:
                self._table.remove(run.id)
        if not self.settings.read_only:
            self._bin.remove_leftovers()
        self._thread.start()

    def _is_unbegun(self, run: Run) -> bool:
        """Whether the server before ended while it was starting the process of a run."""
        directory = self.directory(run.id)
        own = not (run.is_left_alone or self.settings.read_only)
        return own and not processes.is_held(directory) and not processes.was_begun(directory)

    def close(self) -> None:
        """End the supervision; started runs go on."""
        self.events.close()
        self._ended.set()
        self._thread.join(_PATIENCE)  # a disk that does not answer must not keep the server
        self._table.close()

    def directory(self, run_id: str) -> Path:
        """The result directory of a run."""
        run = self._runs.get(run_id)
        return self.settings.folder.absolute() / (run.place if run and run.place else run_id)

    def by_place(self) -> dict[str, Run]:
        """All runs by the names of their directories."""
        with self._lock:
            return {run.place or run.id: run for run in (*self._runs.values(), *self._bin.all())}

    def forget(self, gone: Sequence[Run]) -> None:
        """Forget runs that no process of the service is at work on, as their directories were removed or exchanged."""
        with self._lock:
            for run in [self._runs[run.id] for run in gone if run.id in self._runs]:
                if (run.state.at_rest or run.is_left_alone) and run.id not in self._changing:
                    self._work.pop(run.id, None)
                    if not self.settings.read_only:
                        self._table.remove(run.id)
                    del self._runs[run.id]
                    self.events.forget(run.id)

    def adopt(self, directory: Path, plan: Mapping[str, Any]) -> None:
        """Show a directory of the folder that the command line filled, or is filling, perhaps once more.

        One that the service filled, and whose row was lost, is its run again.
        """
        study = {"state": State.RUNNING, **run_end.results_in(directory), **_planned(plan)}
        with self._lock:
            run = self.by_place().get(directory.name)
            if run is None:
                written = stamp(datetime.fromtimestamp(directory.stat().st_mtime, UTC))
                own = run_end.is_own(directory)
                study |= {"created": written, "updated": written, "place": "" if own else directory.name}
                run = self._store(Run(directory.name if own else secrets.token_hex(8), **study))
            elif run.state.at_rest and run.id not in self._changing:
                self._store(run.changed(message="", place=directory.name, taken=False, **study))
        self._look_at(run.id)

    def all(self) -> list[Run]:
        """All runs except those in the bin, the newest first."""
        with self._lock:
            return list(reversed(self._runs.values()))

    def in_bin(self) -> list[Run]:
        """The runs in the bin, the last deleted first."""
        return self._bin.all()

    def find(self, run_id: str) -> Run:
        """A run by its id; RefusedError 404 if there is none."""
        with self._lock:
            run = self._runs.get(run_id)
        if run is None and run_id in self._bin:
            raise RefusedError(404, f"{run_id[:100]}: this run is in the bin: restore it first")
        if run is None:
            raise RefusedError(404, f"{run_id[:100]}: no run of this id")
        return run

    def find_by_key(self, key: str, digest: str) -> Run | None:
        """The run that was submitted with an Idempotency-Key; None if there is none.

        Raises:
            RefusedError: 422 if a different upload was submitted with this key.
        """
        with self._lock:
            run = next((run for run in self._runs.values() if run.key == key), None)
        if run is not None and run.digest != digest:
            raise RefusedError(422, f"Idempotency-Key: {key[:100]}: another study was submitted with this key")
        return run

    def submit(self, upload: Path, plan: Mapping[str, Any], key: str | None = None, digest: str = "") -> Run:
        """Put a checked upload into the queue.

        Args:
            upload: Folder with its files, on the file system of the folder of runs; it is moved to the run.
            plan: The result of `plans.plan_upload`.
            key, digest: The client's Idempotency-Key, and the hash of its upload.

        Raises:
            RefusedError: 413 if the queue is full.
        """
        with self._lock:
            if key and (earlier := self.find_by_key(key, digest)):
                return earlier
            refuse_full_queue(self._runs.values(), len(self._changing), self.settings.limits)
            run_id, time_now = secrets.token_hex(8), now()
            directory = self.directory(run_id)
            directory.mkdir(mode=0o700)
            upload.rename(directory / UPLOAD)
            own: dict[str, Any] = {"created": time_now, "updated": time_now, "key": key or None, "digest": digest}
            return self._store(Run(run_id, state=State.QUEUED, **_planned(plan), **own))

    def stop(self, run_id: str) -> Run:
        """Stop a run: a queued run at once, a started run after its current points.

        Raises:
            RefusedError: 409 if it neither waits nor runs.
        """
        with self._lock:
            run = self._run_to_control(run_id)
            if run.state is State.QUEUED:
                return self._store(run.changed(state=State.STOPPED, message="stopped before it started"))
            if not run.state.alive:
                raise RefusedError(409, f"state: {run.state}: only a queued or running run can be stopped")
            if run.state is State.RUNNING:
                run = self._store(run.changed(state=State.STOPPING))
                self._work_of(run).stop()
            return run

    def resume(self, run_id: str, retry_failed: bool = False, damaged: bool = False) -> Run:
        """Queue an inactive run again: for its missing points, with `retry_failed` its failed ones, or `damaged` files.

        Raises:
            RefusedError: 409 if it waits or runs, or there is nothing to run; 413 if the queue is full.
        """
        with self._lock:
            run = self._run_to_control(run_id)
            if not run.state.at_rest:
                raise RefusedError(
                    409, f"state: {run.state}: only a run that has stopped, finished or failed can be resumed"
                )
            if retry_failed and not run.counts.failed:
                raise RefusedError(409, "no point of this run failed")
            if run.state is State.FINISHED and not (retry_failed or damaged):
                raise RefusedError(409, f"state: {run.state}: no point of this run is missing, and no file is damaged")
            if processes.is_held(self.directory(run_id)):
                raise RefusedError(409, "another process computes into the directory of this run")
            run_end.refuse_exchanged(run, self.directory(run_id))
            refuse_full_queue(self._runs.values(), len(self._changing), self.settings.limits)
            run = run_end.with_results(run, self.directory(run_id))  # perhaps begun by the command line
            return self._store(run.changed(state=State.QUEUED, message="", retry_failed=retry_failed))

    def extend(self, run_id: str, upload: Path, plan: Mapping[str, Any], note: Callable[[], None]) -> Run:
        """Queue an inactive run with a checked upload that replaces its own.

        Args:
            run_id: Its id.
            upload: Folder with the files, moved to the run.
            plan: Plan of its study.
            note: Called after all checks, to store the upload's additions; the run accepts no other change then.

        Raises:
            RefusedError: 409 if it waits or runs, 413 if the queue is full.
        """
        with self._lock:
            self.refuse_extension(run_id)
            refuse_full_queue(self._runs.values(), len(self._changing), self.settings.limits)
            self._changing.add(run_id)
        try:
            note()
            with self._lock:
                return self._take_upload(self._runs[run_id], upload, plan)
        finally:
            self._changing.discard(run_id)

    def _take_upload(self, run: Run, upload: Path, plan: Mapping[str, Any]) -> Run:
        """Replace the upload of a run, and queue the run."""
        run_end.replace_upload(self.directory(run.id), upload)
        run_end.remove_answers(self.directory(run.id))
        new = {"counts": run.counts.of(plan["unique"]), "name": plan["name"], "question": plan["question"]}
        return self._store(run.changed(state=State.QUEUED, message="", plan=plan, taken=bool(run.place), **new))

    def refuse_extension(self, run_id: str) -> Run:
        """The run; RefusedError 409 if it takes nothing further: it is no study, is active, or has a function."""
        with self._lock:
            run = self._run_at_hand(run_id)
            if run.kind != "study":
                raise RefusedError(409, f"kind: {run.kind}: only the run of a study takes {_FURTHER}")
            if run.has_function:
                raise RefusedError(409, "its study has a function, which only the command line runs: change it there")
            if not run.state.at_rest or processes.is_held(self.directory(run_id)):
                raise RefusedError(
                    409, f"state: {run.state}: only a run that has stopped, finished or failed takes {_FURTHER}"
                )
            return run

    def annotate(self, run_id: str, changes: dict[str, Any]) -> Run:
        """Change the annotation of a run: name, owner, tags, note.

        Raises:
            RefusedError: 404 if there is no such run, or its directory holds other results; 403 if that is a link.
            InputError: If a value cannot be used.
        """
        with self._lock:
            run = self.find(run_id)
            annotation = annotated(run.annotation, changes)
            if (directory := self.directory(run_id)).is_symlink():
                raise RefusedError(403, f"{directory.name}: a symbolic link, and nothing is written through it")
            run_end.refuse_exchanged(run, directory)
            write_annotation(directory, annotation)
            return self._store(with_annotation(run, annotation))

    def delete(self, run_id: str, from_bin: bool = False) -> None:
        """Put a run into the bin; a second call changes nothing.

        Args:
            from_bin: Whether to remove a run in the bin, with its directory.

        Raises:
            RefusedError: 404 if there is no such run; 409 if a process is at work on it, or it is not in the bin yet.
        """
        if run_id in self._bin:
            if from_bin:
                self._bin.remove(run_id)
            return
        if from_bin:
            self.find(run_id)
            raise RefusedError(409, "this run is not in the bin: delete it first")
        with self._lock:
            run = self._run_to_control(run_id)
            if run.place:
                raise RefusedError(409, f"the command line made the directory {run.place}: remove it there")
            if run.state.alive or processes.is_held(self.directory(run_id)):
                raise RefusedError(409, f"state: {run.state}: stop this run before you delete it")
            if run.state is State.QUEUED:
                run = run.changed(state=State.STOPPED, message="stopped before it started")
            self._bin.add(run)
            del self._runs[run_id]
            self._work.pop(run_id, None)
            self.events.forget(run_id)

    def restore(self, run_id: str) -> Run:
        """Take a run out of the bin; RefusedError 404 if it is not there."""
        with self._lock:
            run = self._bin.take(run_id)
            there = self._runs | {run_id: run}
            self._runs = {row.id: there[row.id] for row in self._table.all() if row.id in there}  # as submitted
            self._show(run)
            return run

    def _run_to_control(self, run_id: str) -> Run:
        """A run that the service may stop and resume."""
        run = self._run_at_hand(run_id)
        if run.is_left_alone:
            raise RefusedError(409, f"the command line filled the directory {run.place}: change it there, or extend it")
        return run

    def _run_at_hand(self, run_id: str) -> Run:
        """A run that is not taking another study now."""
        run = self.find(run_id)
        if run_id in self._changing:
            raise RefusedError(409, "this run is being changed: try again in a moment")
        return run

    def _store(self, run: Run) -> Run:
        """Store a run whose state changed, and publish it to watchers."""
        before = self._runs.get(run.id)
        if not self.settings.read_only:
            self._table.put(run)
        self._show(run)
        if before is not None and run.state.at_rest and not before.state.at_rest and not run.is_left_alone:
            self._notify(run)
        return run

    def _notify(self, run: Run) -> None:
        """Send the notification that a run has ended."""
        if self.settings.notifier is not None and not self.settings.read_only:
            record = run.record()
            facts = {name: record[name] for name in ("state", "name", "message", "id", "kind", "points")}
            self.settings.notifier.tell_in_thread(facts)

    def _show(self, run: Run) -> None:
        self._runs[run.id] = run
        self.events.publish(run)

    def _look_after(self) -> None:
        while not self._ended.wait(_PERIOD):
            for run in [run for run in self.all() if run.state.alive]:
                self._for_one(run, self._look_at)
            if self.settings.read_only:
                with _logged("the table of runs"):
                    self._read_again()
            else:
                with _logged("what people write about runs"):
                    self._read_annotations()
                self._start_waiting()
                if time.monotonic() > self._bin_due:
                    self._bin_due += _BIN_PERIOD
                    self._bin.empty(self.settings.limits.bin_days)

    def _for_one(self, run: Run, step: Callable[[str], None]) -> None:
        """Call a step for a run; an error fails this run only, and the others go on."""
        try:
            step(run.id)
        except StorageError as error:  # a full disk: the state is stored as soon as it can be
            log.error("%s: %s", run.id, error)
        except Exception as error:
            log.exception("run %s", run.id)
            with _logged(f"the failure of run {run.id}"):
                self._fail(run.id, f"the service cannot supervise it ({type(error).__name__}: {error})")

    def _fail(self, run_id: str, message: str) -> None:
        """End the process of a run, if any, and store that the run failed."""
        with self._lock:
            run = self._runs.get(run_id)
            if run is None or run.state.at_rest:
                return
            if not run.is_left_alone and not self.settings.read_only:
                processes.kill_run(self.directory(run_id))
            self._work.pop(run_id, None)
            self._store(run.changed(state=State.FAILED, message=message, eta_seconds=None, retry_failed=False))

    def _work_of(self, run: Run) -> RunWork:
        if run.id not in self._work:
            self._work[run.id] = RunWork(run, self.directory(run.id))
        return self._work[run.id]

    def _read_again(self) -> None:
        """Take over the changes of the server that runs studies in this folder."""
        if not self._table.is_changed():
            return
        rows = self._table.all()
        stored = {run.id: run for run in rows if not run.binned}
        with self._lock:
            self._bin.show(run for run in rows if run.binned)
            places = {run.place for run in stored.values()}
            own = {run.id for run in self._runs.values() if run.place and run.place not in places}  # by this server
            for gone in self._runs.keys() - stored.keys() - own:
                del self._runs[gone]
                self.events.forget(gone)
            for run in stored.values():
                if run != self._runs.get(run.id):
                    self._show(run)

    def _look_at(self, run_id: str) -> None:
        """Count the points of a run at work, and notice its end."""
        directory, run = self.directory(run_id), self._runs.get(run_id)
        if run is None or not run.state.alive:
            return
        alive, work = processes.is_held(directory), self._work_of(run)
        if alive and not work.progress.is_due():
            with self._lock:
                self._stop_again(run_id, work)
            return
        counts, steps = work.progress.read()
        doing = run_end.work_beside_points(run, counts, directory) if alive else ""
        with self._lock:
            run = self._runs[run_id]
            if not run.state.alive:
                return
            if (known := run_end.with_results(run, directory)) != run:
                run = self._store(known)
            if alive:
                if (counts, steps, doing) != (run.counts, run.steps, run.message):
                    eta = work.progress.eta_seconds(counts)
                    self._show(run.changed(counts=counts, steps=steps, message=doing, eta_seconds=eta))
                self._stop_again(run_id, work)
                return
            state, message = work.ending = work.ending or ending_of(run, counts, steps, directory)
            steps = tuple(dict(step) | ({"state": state.value} if step["state"] == "running" else {}) for step in steps)
            if state is State.FINISHED:  # the points of a search or a fed step are known only now
                counts = counts.of(0)
            ended = run.changed(eta_seconds=None, retry_failed=False)
            self._store(ended.changed(state=state, message=message, counts=counts, steps=steps))
            self._work.pop(run_id, None)

    def _stop_again(self, run_id: str, work: RunWork) -> None:
        if self._runs[run_id].state is State.STOPPING:
            work.stop()

    def _read_annotations(self) -> None:
        """Take over annotations that the command line wrote."""
        files = self._annotation_files
        for run_id, annotation in files.changed([(run.id, self.directory(run.id)) for run in self.all()]):
            with self._lock:  # `annotate` may have changed it first
                run, directory = self._runs.get(run_id), self.directory(run_id)
                if run is None or run.annotation == annotation or run_end.is_exchanged(run, directory):
                    continue
                if files.is_current(run_id, directory):
                    self._store(with_annotation(run, annotation))

    def _start_waiting(self) -> None:
        """Start the runs that have waited longest, up to the limit of simultaneous runs."""
        with self._lock:
            for run in next_to_start(self._runs.values(), self.settings.limits):
                self._for_one(run, self._start)

    def _start(self, run_id: str) -> None:
        run, directory = self._runs[run_id], self.directory(run_id)
        if run_end.is_exchanged(run, directory):
            self._store(replace(run, state=State.FAILED, message="its directory holds the results of another run"))
            return
        self._store(run.changed(state=State.RUNNING, inode=0))  # before the start, so that a kill is noticed
        try:
            start_work(run, directory, self.settings)
        except InputError as error:
            self._store(replace(self._runs[run_id], state=State.FAILED, message=among_runs(str(error), directory)))
