"""The table of runs, an SQLite file that outlives the server; and a run as clients see it."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import sqlite3
import threading
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from enum import StrEnum
from functools import cache, cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

from pydantic import ConfigDict, TypeAdapter

from tripod_doe.errors import CubeError, InputError, StorageError, option
from tripod_doe.names import path_within
from tripod_doe.study.journal.damage import refuse_strange_files
from tripod_doe.study.journal.rows import DamagedRowError
from tripod_doe.study.result_directory.annotation import Annotation

TABLE = "service.sqlite"
"""File of the folder that holds the table."""

ID = re.compile(r"[0-9a-f]{16}")
"""Id of a run, also the name of its directory."""


class State(StrEnum):
    """State of a run."""

    QUEUED = "queued"
    RUNNING = "running"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FINISHED = "finished"
    FAILED = "failed"

    @property
    def at_rest(self) -> bool:
        """Whether no process is running, and none will start."""
        return self in (State.STOPPED, State.FINISHED, State.FAILED)

    @property
    def alive(self) -> bool:
        """Whether a process is at work."""
        return self in (State.RUNNING, State.STOPPING)


@dataclass(frozen=True)
class PointCounts:
    """Points of a run."""

    total: int  # points to compute: repeated points count once, excluded points do not count
    finished: int = 0  # points that ended well: finished, or with an outcome that the study expects
    failed: int = 0  # all other ended points
    outcomes: Mapping[str, int] | None = None  # points by the label of their outcome
    cpu_seconds: float = 0.0  # CPU time of all points; repeated runs of a point add up

    @property
    def missing(self) -> int:
        """Points that have not ended."""
        return max(0, self.total - self.finished - self.failed)

    def of(self, total: int) -> PointCounts:
        """The same of another total, or of the points that have ended where a pilot or a search asked for more."""
        return replace(self, total=max(total, self.finished + self.failed))


@dataclass(frozen=True)
class Run:
    """One run of a study, a workflow, a fit or an optimisation."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid")  # of rows of the table

    id: str  # random; also the name of its result directory
    kind: str  # "study", "workflow", "fit" or "optimisation"
    # name, question: from its file
    name: str
    question: str
    state: State  # its current state
    message: str = ""  # why it failed or stopped, what it does besides its points, or what it found
    # its price, as `plans.plan_upload` gave it when it was submitted
    plan: Mapping[str, Any] = field(default_factory=dict)
    counts: PointCounts = field(default_factory=lambda: PointCounts(0))  # points that have ended
    # results of the steps of a workflow, or of the stages of a fit or an optimisation, in order
    steps: tuple[Mapping[str, Any], ...] = ()
    # time until the last point at the pace so far; None if it does not run or has no pace yet
    eta_seconds: float | None = None
    # created, updated: times in UTC
    created: str = ""
    updated: str = ""
    retry_failed: bool = False  # whether the queued run repeats failed points
    place: str = ""  # name of its directory, if the command line filled it; else empty, and the id is the name
    # inode, results: of the journal in its directory, and the number of the results in it; 0 if unknown
    inode: int = 0
    results: int = 0
    taken: bool = False  # whether the service runs that directory's study, after an extension here
    # key, digest: the client's Idempotency-Key, and the hash of its upload
    key: str | None = None
    digest: str = ""
    # label, owner, tags, note: what people wrote about it, see `study.result_directory.annotation`
    label: str = ""
    owner: str = ""
    tags: tuple[str, ...] = ()
    note: str = ""
    binned: str = ""  # time when it was put into the bin; empty if it is not there

    @property
    def is_search(self) -> bool:
        """Whether its points depend on earlier points, so that their number is not known in advance."""
        return self.kind in ("fit", "optimisation")

    @property
    def is_left_alone(self) -> bool:
        """Whether the command line filled its directory, and the service added nothing."""
        return bool(self.place) and not self.taken

    @property
    def has_function(self) -> bool:
        """Whether its study names a function, which only the command line runs."""
        return bool(self.plan.get("function"))

    @property
    def shown_name(self) -> str:
        """The label of the run, else the name of its study."""
        return self.label or self.name

    @cached_property
    def searched_text(self) -> str:
        """Every text of the run in which words are looked for, without upper case."""
        parts = [self.id, self.name, self.label, self.question, self.note, self.owner, self.state.value, self.kind]
        parts += [str(name) for key in ("factors", "models") for name in self.plan.get(key, ())]
        return "\n".join([*parts, *self.tags]).casefold()

    @property
    def annotation(self) -> Annotation:
        """What people wrote about it."""
        return Annotation(self.label, self.owner, self.tags, self.note)

    def record(self) -> dict[str, Any]:
        """The run as clients see it."""
        counts = {name: getattr(self.counts, name) for name in ("total", "finished", "failed", "missing")}
        as_they_are = ("id", "owner", "note", "kind", "question", "message", "created", "updated", "binned")
        record: dict[str, Any] = {name: getattr(self, name) for name in as_they_are} | {
            "name": self.shown_name,
            "tags": list(self.tags),
            "found": bool(self.place),
            "state": self.state.value,
            "points": counts,
            "outcomes": dict(self.counts.outcomes or {}),
            "cpu_seconds": round(self.counts.cpu_seconds, 3),
            "eta_seconds": None if self.eta_seconds is None else round(self.eta_seconds, 1),
        }
        if self.kind != "study":
            record["steps"] = [dict(step) for step in self.steps]
        return record

    def changed(self, **values: Any) -> Run:
        """A copy with other values, and the present time as `updated`."""
        return replace(self, updated=now(), **values)


def now() -> str:
    """The time in UTC, to the millisecond."""
    return stamp(datetime.now(UTC))


def stamp(time: datetime) -> str:
    """A UTC time in the form that runs use."""
    return time.isoformat(timespec="milliseconds").replace("+00:00", "Z")


_SCHEMA = """
CREATE TABLE IF NOT EXISTS run (
    number INTEGER PRIMARY KEY AUTOINCREMENT,  -- the order in which runs were submitted
    id TEXT NOT NULL UNIQUE,
    key TEXT UNIQUE,                           -- the client's Idempotency-Key
    record TEXT NOT NULL                       -- everything else, as JSON
);
"""


class RunTable:
    """The table of runs of a folder.

    Args:
        folder: Where the table is; it must exist.
        read_only: Open an existing table, and change nothing.

    Raises:
        InputError: If it cannot be opened.
    """

    def __init__(self, folder: Path, read_only: bool = False) -> None:
        self.path = folder / TABLE
        self._lock = threading.Lock()
        self._version = -1
        try:
            refuse_strange_files(self.path)
            self._connection = _opened_for_reading(self.path) if read_only else _opened(self.path)
        except (sqlite3.Error, DamagedRowError, CubeError) as error:
            raise _unusable(self.path, error) from error
        self._connection.text_factory = partial(str, encoding="utf-8", errors="replace")  # of a damaged row

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._connection.close()

    def all(self) -> list[Run]:
        """All runs, in the order of submission; a run with a damaged row counts as failed, with a message.

        Skips rows whose id a service cannot have given: an id names a directory, and the table may be a stranger's.
        """
        with self._lock:
            try:
                rows = self._connection.execute("SELECT id, key, record FROM run ORDER BY number").fetchall()
            except sqlite3.DatabaseError as error:
                raise _unusable(self.path, error) from error
        return [_from_row(*row) for row in rows if ID.fullmatch(str(row[0]))]

    def is_changed(self) -> bool:
        """Whether another process has changed the table since the last call."""
        with self._lock:
            version = int(self._connection.execute("PRAGMA data_version").fetchone()[0])
        changed, self._version = version != self._version, version
        return changed

    def put(self, run: Run) -> None:
        """Store a new or changed run; after this returns, no kill can lose it.

        Raises:
            StorageError: If the disk is full or fails.
        """
        self._write(
            "INSERT INTO run (id, key, record) VALUES (?, ?, ?) "
            "ON CONFLICT (id) DO UPDATE SET key = excluded.key, record = excluded.record",
            (run.id, run.key, _to_text(run)),
        )

    def remove(self, id: str) -> None:
        """Forget a run; StorageError if the disk is full or fails."""
        self._write("DELETE FROM run WHERE id = ?", (id,))

    def _write(self, statement: str, values: tuple[Any, ...]) -> None:
        try:
            with self._lock, self._connection:
                self._connection.execute(statement, values)
        except sqlite3.Error as error:
            raise StorageError(f"{self.path}: cannot write ({error}); nothing that was finished is lost") from error


def _unusable(path: Path, error: Exception) -> InputError:
    return InputError(
        f"{path}: cannot use this table of runs ({error}); choose another {option('folder')}, or move this file away"
    )


def _without_programs(connection: sqlite3.Connection) -> sqlite3.Connection:
    """Refuse (DamagedRowError) a table of a stranger with views or triggers, which may run without end."""
    if connection.execute("SELECT 1 FROM sqlite_schema WHERE type IN ('view', 'trigger')").fetchone():
        connection.close()
        raise DamagedRowError("it has views or triggers")
    return connection


def _opened(path: Path) -> sqlite3.Connection:
    connection = _without_programs(sqlite3.connect(path, check_same_thread=False))
    connection.execute("PRAGMA journal_mode = DELETE")  # a lost write-ahead log would lose rows in silence
    connection.execute("PRAGMA synchronous = FULL")
    connection.executescript(_SCHEMA)
    return connection


def _opened_for_reading(path: Path) -> sqlite3.Connection:
    """The existing table, or an empty table in memory; writes nothing, even into a writable folder."""
    if not path.exists():
        connection = sqlite3.connect(":memory:", check_same_thread=False)
        connection.executescript(_SCHEMA)
        return connection
    address = f"{path.absolute().as_uri()}?mode=ro"
    try:
        return _without_programs(sqlite3.connect(address, uri=True, check_same_thread=False))
    except sqlite3.OperationalError:  # a kill has left a change in its journal, which only a writer can take back
        return _without_programs(_recovered(path))


def _recovered(path: Path) -> sqlite3.Connection:
    """A copy of a table in memory, without the change that a kill has interrupted."""
    copy = sqlite3.connect(":memory:", check_same_thread=False)
    with TemporaryDirectory(prefix="tripod-doe-") as folder:
        for ending in ("", "-journal", "-wal"):
            with suppress(FileNotFoundError):
                shutil.copyfile(f"{path}{ending}", Path(folder) / f"{path.name}{ending}")
        with closing(sqlite3.connect(Path(folder) / path.name)) as whole:
            whole.backup(copy)
    return copy


def _to_text(run: Run) -> str:
    content = {item.name: getattr(run, item.name) for item in fields(run)}
    content["counts"] = {item.name: getattr(run.counts, item.name) for item in fields(run.counts)}
    text = json.dumps(content)
    return f"{_checksum(text)} {text}"


def _checksum(text: str) -> str:
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def _from_row(id: str, key: str | None, text: str) -> Run:
    try:
        checksum, _, content = ("", "", text) if text.startswith("{") else text.partition(" ")  # of old rows: none
        if checksum and checksum != _checksum(content):
            raise ValueError("its checksum is another")
        run = _row_form().validate_json(content, strict=True)
        if run.id != id:
            raise ValueError(f"it is of {run.id}")
        if run.place:
            path_within(Path(), run.place)
        json.dumps(run.record(), allow_nan=False)  # as clients get it
    except Exception as error:  # whatever the row holds: the other runs must be shown
        message = (
            f"its row in {TABLE} is damaged ({type(error).__name__}: {error}); its results are kept until it is deleted"
        )
        return Run(str(id), "study", str(id), "", State.FAILED, message, key=key)
    return run


@cache
def _row_form() -> TypeAdapter[Run]:
    return TypeAdapter(Run)
