"""The result directory of a study: locked by one process, filled block by block, and written as cube and costs.

``study.toml`` is the study whose results are here, with copies of its tables in ``tables``; ``journal.sqlite`` its
finished blocks; ``cube.nc`` and ``cost.nc`` are made of them. A later run needs nothing else.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.errors import InputError, option
from tripod_doe.files.atomic_files import refuse_links, replace_text
from tripod_doe.files.checksum_list import remove_pages
from tripod_doe.number_text import size
from tripod_doe.study.cube.dataset import build_cube
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.cube.netcdf import refuse_backslash
from tripod_doe.study.cube.writing import StoredResults, write_cube
from tripod_doe.study.definition.study import Study
from tripod_doe.study.journal import (
    COMPUTING,
    KERNELS,
    OUTDATED,
    POINTS,
    STUDY,
    STUDY_HASH,
    FinishedBlock,
    Journal,
    text_digest,
)
from tripod_doe.study.plan import cube_bytes, unshown_bytes
from tripod_doe.study.result_directory.derived_responses import DERIVED
from tripod_doe.study.result_directory.directory_lock import DirectoryLock
from tripod_doe.study.result_directory.latest_run import FOUND
from tripod_doe.study.result_directory.open_cube import opened_cube
from tripod_doe.study.result_directory.resume import Resume
from tripod_doe.study.result_directory.stored_study import STORED, keep_sources, known_texts
from tripod_doe.study.result_directory.zarr_store import remove_zarr
from tripod_doe.study.study_points import StudyPoints

_SPARE_BYTES = 20_000_000


def make_directory(path: str | Path) -> Path:
    """Make a directory for results if it is not there.

    Raises:
        InputError: If it cannot be made, netCDF cannot write into it, or it holds links by which results would be
            written elsewhere.
    """
    path = Path(path)
    refuse_backslash(path)
    try:
        str(path).encode()
    except UnicodeEncodeError as error:  # netCDF takes names in UTF-8 only
        raise InputError(
            f"{option('out', ascii(str(path)))}: not a name in UTF-8, as which this locale reads it; set PYTHONUTF8=1"
        ) from error
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option('out', str(path))}: cannot make this directory: {error.strerror}") from error
    refuse_links(path)
    return path


class ResultDirectory:
    """The results of one study, locked by this process until it is closed.

    All readable blocks of a damaged journal are kept; the loss is printed to standard error.

    Args:
        path: The directory; made if it is not there.
        take_over: Whether to take the lock of a process that is known to be dead (`DirectoryLock`).

    Raises:
        InputError: If another process holds it, or it cannot be written.
        CubeError: If nothing of its journal can be read.
    """

    def __init__(self, path: str | Path, take_over: bool = False) -> None:
        self.path = make_directory(path)
        self._hold = DirectoryLock(self.path, take_over)
        try:
            self._journal = Journal(self.path)
            if self._journal.repaired:
                print(f"tripod-doe: {self._journal.repaired}", file=sys.stderr)
        except BaseException:
            self._hold.release()
            raise
        self.resume = Resume(self.path, self._journal)

    def __enter__(self) -> ResultDirectory:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def check(self) -> None:
        """Check that no other process took the directory over; StorageError if one did."""
        self._hold.check()

    def end_journal(self) -> None:
        """Make the journal one file again; the directory stays held for what is made of the cube."""
        self._journal.close()

    def close(self) -> None:
        """Release the directory for other processes."""
        try:
            self.end_journal()
        finally:
            self._hold.release()

    def accept(self, asked: StudyPoints, fewer: bool = False) -> None:
        """Make this the study of the directory.

        Args:
            fewer: Whether it may lack points that have results, as `Resume.refuse_changes`.

        Raises:
            InputError: If the directory holds results of another study, or the disk is too small; nothing is changed.
        """
        self.resume.refuse_changes(asked, fewer=fewer)
        self._check_space(asked)
        self.adopt(asked.study)
        self._journal.remember({POINTS: str(int(asked.to_compute.sum()))})

    def note_further(self, points: int) -> None:
        """Remember how many points are computed besides those with results, before all are known."""
        self._journal.remember({POINTS: str(np.unique(self._journal.keys()).size + points)})

    def blocks(self) -> Iterator[FinishedBlock]:
        """All finished blocks, the oldest first."""
        return self._journal.blocks()

    def places(self) -> list[Callable[[], FinishedBlock]]:
        """All finished blocks, the oldest first, each as a function that reads it."""
        return list(self._journal.places())

    def adopt(self, study: Study) -> None:
        """Make this the study of the directory, without checks; what was made of its earlier results is removed.

        A kill leaves the study before or this one, and a directory that is read.
        """
        remove_pages(self.path)
        for stale in analysis_files(self.path).values():
            stale.unlink()
        remove_zarr(self.path)
        digest = text_digest(study.text.encode())
        notes = {KERNELS: study.simulator.source_hash, STUDY_HASH: study.hash, OUTDATED: "yes"}
        notes[STUDY] = " ".join([*known_texts(self._journal), digest])
        self._journal.remember(notes | keep_sources(study, self.path))
        replace_text(self.path / STORED, study.text)
        self._journal.remember({STUDY: digest})

    def note_derived(self, tables: Mapping[str, Any], drop: Collection[str] = ()) -> None:
        """Remember responses that were added to the results, so that later runs keep them; forget some."""
        kept = {name: table for name, table in (self.derived | dict(tables)).items() if name not in drop}
        self._journal.remember({DERIVED: json.dumps(kept)})

    def note_found(self, sentence: str) -> None:
        """Store the search condition of this run and its result."""
        self._journal.remember({FOUND: sentence})

    @property
    def derived(self) -> dict[str, Any]:
        """Tables of the responses that were added to the results, by name."""
        return json.loads(self._journal.recall(DERIVED) or "{}")

    def commit(self, block: FinishedBlock) -> None:
        """Store a finished block; when this returns, no kill can lose it.

        Raises:
            StorageError: If it cannot be written, or another process took the directory over.
        """
        self.check()
        self._journal.commit(block)

    @contextmanager
    def computing(self) -> Iterator[bool]:
        """Mark that points are computed; returns whether an earlier process died while computing here.

        The next run then keeps a point that ends its process away from this one.
        """
        died = self._journal.recall(COMPUTING) == "yes"
        self._journal.remember({COMPUTING: "yes"})
        try:
            yield died
        finally:
            self._journal.remember({COMPUTING: "no"})

    def read(self, asked: StudyPoints) -> xr.Dataset:
        """Cube and costs of some points from all finished blocks; nothing is written."""
        cube, cost = build_cube(asked.study, asked.points, asked.keys, self._journal.blocks())
        return cube.assign({name: cost[name] for name in cost.data_vars})

    def write_cube(self, asked: StudyPoints, action: str) -> xr.Dataset:
        """Make cube and costs from all finished blocks, write them, and open them.

        Args:
            action: The action, for the history of the files.

        Raises:
            StorageError: If they cannot be written; older ones stay.
        """
        results = StoredResults(asked, self._journal.places())
        write_cube(asked, results, self.path, action, self.check)
        self.check()
        self._journal.note_shown()
        return opened_cube(self.path)

    def _check_space(self, asked: StudyPoints) -> None:
        """Refuse (InputError) to start if cube and journal do not fit on the disk."""
        cube = cube_bytes(asked.study, asked.points) or 0
        needed = _SPARE_BYTES + 2 * cube + unshown_bytes(asked.study, asked.points)
        free = shutil.disk_usage(self.path).free
        if free < needed:
            raise InputError(
                f"{option('out', str(self.path))}: {size(free)} free, but journal and cube need {size(needed)}; "
                f"keep fewer outputs or choose another {option('out')}"
            )
