"""Cube and costs of a result directory, written from its finished blocks: small ones whole, others slab by slab."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.files.checksum_list import number_in
from tripod_doe.model_interface import take_labels
from tripod_doe.study.cube.dataset import PlacedBlock, cf_points, design_coordinates, part_of_cube
from tripod_doe.study.cube.model_records import ModelRecords
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset
from tripod_doe.study.cube.provenance import cost_attributes, cube_attributes
from tripod_doe.study.cube.slab_file import cube_file
from tripod_doe.study.cube.slabs import Slab, box, slabs
from tripod_doe.study.journal import FinishedBlock, journal_path
from tripod_doe.study.study_points import StudyPoints

_SLAB_BYTES = 32_000_000
_OTHER_BYTES = 200  # of a point besides its outputs: costs, outcome, factors, and copies of them


class StoredResults:
    """Places of the newest results of all points in the finished blocks of a study, in eight bytes per point.

    Args:
        blocks: All finished blocks, the newest last, each as a function that reads it.

    Attributes:
        point_bytes: Largest number of bytes of the outputs of a point.
    """

    def __init__(self, asked: StudyPoints, blocks: Iterable[Callable[[], FinishedBlock]]) -> None:
        self._block = np.full(asked.points.count, -1, np.int32)
        self._row = np.zeros(asked.points.count, np.int32)
        self._read: list[Callable[[], FinishedBlock]] = []
        self.point_bytes = 0
        labels: dict[str, NDArray[Any]] = {}  # of all slabs, which are written one by one
        for number, read in enumerate(blocks):
            block = read()
            rows, at = asked.index.places(block.keys)
            if at.size:
                take_labels(labels, block.result.coordinates)
            self._block[at], self._row[at] = number, rows
            self._read.append(read)
            self.point_bytes = max(self.point_bytes, block.result.nbytes // max(block.keys.size, 1))
        self._block[~asked.points.allowed] = -1

    def between(self, start: int, stop: int) -> Iterator[PlacedBlock]:
        """The blocks with results of consecutive points, with their rows and their places after the first point."""
        numbers, rows = self._block[start:stop], self._row[start:stop]
        order = np.argsort(numbers, kind="stable")
        for at in np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1):
            if at.size and numbers[at[0]] >= 0:
                yield self._read[numbers[at[0]]](), rows[at].astype(np.int64), at


def write_cube(
    asked: StudyPoints, results: StoredResults, directory: Path, action: str, check: Callable[[], None]
) -> None:
    """Write ``cube.nc`` and ``cost.nc``; a kill leaves the old ones, the new ones, or the old cube next to new costs.

    In a result directory the last is recognised by the note `OUTDATED` in its journal, which is still "yes".

    Args:
        action: The action, for the history of the files.
        check: Called before the files take their places; raises if they must not.

    Raises:
        StorageError: If they cannot be written; older ones stay.
    """
    study, points, models = asked.study, asked.points, ModelRecords(asked.study)
    number = number_in(journal_path(directory))

    def stamped(data: xr.Dataset, attributes: Callable[..., dict[str, Any]]) -> xr.Dataset:
        return stamp_history(data.assign_attrs(attributes(study, points, models)), action, number)

    lengths = box(points.shape, results.point_bytes + _OTHER_BYTES, _SLAB_BYTES)
    if lengths == points.shape:
        cube, cost = part_of_cube(study, points, results.between(0, points.count), models)
        cube, cost = stamped(cube, cube_attributes), stamped(cost, cost_attributes)
        check()
        write_dataset(cost, directory / "cost.nc")
        write_dataset(cube, directory / "cube.nc")
        return
    points = cf_points(points)
    levels = design_coordinates(study, points) if points.is_grid else {}
    with ExitStack() as files:
        cube_slabs = files.enter_context(cube_file(directory / "cube.nc", points, lengths, levels))
        cost_slabs = files.enter_context(
            cube_file(directory / "cost.nc", points, lengths, levels)
        )  # takes its place first

        def write(slab: Slab, cube: xr.Dataset, cost: xr.Dataset) -> None:
            cube_slabs.write(slab, cube)
            cost_slabs.write(slab, cost)

        with ThreadPoolExecutor(1, "cube") as writer:  # a slab is compressed while the next one is made
            writing: Future[None] | None = None
            for slab in slabs(points.shape, lengths):
                part = points.part(slab.start, slab.stop)
                cube, cost = part_of_cube(study, part, results.between(slab.start, slab.stop), models)
                if writing:
                    writing.result()
                writing = writer.submit(write, slab, cube, cost)
            if writing:
                writing.result()
        for written, attributes in ((cube_slabs, cube_attributes), (cost_slabs, cost_attributes)):
            written.finish(stamped(xr.Dataset(), attributes).attrs)
        check()
