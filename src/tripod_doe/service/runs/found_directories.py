"""Result directories that the table of runs does not know, found while the server of their folder runs.

The command line filled them, or the table was lost: a directory with an upload is a run of the service.
"""

import logging
import os
import threading
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from tripod_doe.errors import TripodDoeError
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.uploads import STUDY, UPLOAD
from tripod_doe.service.runs.run_end import is_another_study, is_directory, is_exchanged, page_of
from tripod_doe.service.runs.run_table import Run
from tripod_doe.service.runs.supervisor import Supervisor
from tripod_doe.service.security.delivered_files import check_delivered
from tripod_doe.service.workers.worker_pool import AllBusyError, ServerEndsError, WorkerFailedError
from tripod_doe.study.journal import journal_path
from tripod_doe.workflow.steps_file import STEPS

_PERIOD = 2.0  # seconds between two looks

log = logging.getLogger(__name__)


class Signature(NamedTuple):
    """State of a directory, which changes when the command line continues there or its owner repairs it."""

    inode: int  # of its journal
    mode: int
    owner: int
    # study, journal, cube, page: when each file or its mode changed last (ns); 0 if it is not there
    study: int
    journal: int
    cube: int
    page: int

    @property
    def newest(self) -> int:
        """When any of the files changed last."""
        return max(self.study, self.journal, self.cube, self.page)


class FoundDirectories:
    """The result directories of a folder that the command line filled, looked for again and again.

    Args:
        folder: The folder.
        runs: The runs, which show them.
        plan: Counts of the study of a directory; it may take a while.
    """

    def __init__(self, folder: Path, runs: Supervisor, plan: Callable[[Path], Mapping[str, Any]]) -> None:
        self._folder, self._runs, self._plan = folder, runs, plan
        self._seen: dict[str, Signature] = {}
        self._wanted, self._ended = threading.Event(), threading.Event()

    def look_soon(self) -> None:
        """Look now and not only when the time has come."""
        self._wanted.set()

    def end(self) -> None:
        """Look no more."""
        self._ended.set()
        self._wanted.set()

    def watch(self) -> None:
        """Look until the end."""
        while not self._ended.is_set():
            try:
                self._look()
            except Exception:  # a full disk, or a folder that is not there just now: look again later
                log.exception("the folder of runs")
            self._wanted.wait(_PERIOD)
            self._wanted.clear()

    def _look(self) -> None:
        """Show new directories and those that the command line has changed, and forget those that are gone."""
        with os.scandir(self._folder) as entries:
            names = {entry.name for entry in entries if entry.is_dir(follow_symlinks=False)}
        known = self._runs.by_place()
        self._runs.forget([run for place, run in known.items() if run.place and place not in names])
        self._seen = {name: signature for name, signature in self._seen.items() if name in names}
        for name in sorted(names):
            run = known.get(name)
            if self._ended.is_set():
                return
            if run is None or (run.kind == "study" and not run.binned and _may_be_another(run, self._folder / name)):
                self._look_at(self._folder / name, run)

    def _look_at(self, path: Path, run: Run | None) -> None:
        """Show a directory that is new, or that has changed since its run was shown.

        A run in whose place there are the results of another one is forgotten: links to it lead nowhere then.
        """
        signature = _signature(path)
        if signature is None or signature == self._seen.get(path.name):
            return
        try:
            is_another = run is not None and is_exchanged(run, path)
            if run is None or is_another or _is_continued(path, run, signature):
                check_delivered(path, found=True)
                plan = self._plan(path)
                # journals of earlier versions have no number, and a new file may get the inode of a deleted one
                if run is not None and (is_another or plan["name"] != run.name):
                    self._runs.forget([run])
                self._runs.adopt(path, plan)
        except (AllBusyError, ServerEndsError):
            return  # the next look tries again
        except (RefusedError, TripodDoeError, WorkerFailedError, OSError) as error:
            log.warning("%s is not shown: %s", path.name, error)
        except Exception:  # still show the others
            if not self._ended.is_set():
                log.exception("%s is not shown", path.name)
        self._seen[path.name] = signature


def _may_be_another(run: Run, path: Path) -> bool:
    """Whether the directory of a run must be looked at: the run is not active, or its results were exchanged."""
    return run.state.at_rest or (run.is_left_alone and is_exchanged(run, path))


def _is_continued(path: Path, run: Run, signature: Signature) -> bool:
    """Whether the command line has continued in the directory of a run that is not active.

    In a run that the service made, by another study or table than was submitted: times alone change in a copy.
    """
    shown = 1e9 * datetime.fromisoformat(run.updated).timestamp()
    if run.place:
        return signature.newest > shown
    return signature.newest > shown and is_another_study(path)


def _signature(path: Path) -> Signature | None:
    """The signature of a directory; None if it holds no study, and no workflow or search of the service."""
    study, journal = path / STUDY, journal_path(path)
    if is_directory(path / UPLOAD) and not study.exists():
        study = journal = path / STEPS
    if not _changed(study) or not _changed(journal):
        return None
    top, files = os.lstat(path), (study, journal, path / "cube.nc", page_of(path))
    return Signature(os.lstat(journal).st_ino, top.st_mode, top.st_uid, *map(_changed, files))


def _changed(path: Path) -> int:
    """When a file or its mode changed last (ns), which no copy can set back; 0 if it is not there."""
    try:
        return os.lstat(path).st_ctime_ns
    except OSError:
        return 0
