"""Cube and costs of a result directory, written from its finished blocks: small ones whole, others slab by slab."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import xarray as xr

from tripod_doe.study.cube.dataset import cf_points, design_coordinates, part_of_cube
from tripod_doe.study.cube.model_records import ModelRecords
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset
from tripod_doe.study.cube.provenance import cost_attributes, cube_attributes
from tripod_doe.study.cube.slab_file import cube_file
from tripod_doe.study.cube.slabs import Slab, box, slabs
from tripod_doe.study.cube.stored_results import StoredResults
from tripod_doe.study.study_points import StudyPoints

_SLAB_BYTES = 32_000_000
_OTHER_BYTES = 200  # of a point besides its outputs: costs, outcome, factors, and what is made of them


def write_cube(
    asked: StudyPoints, results: StoredResults, directory: Path, action: str, check: Callable[[], None]
) -> None:
    """Write ``cube.nc`` and ``cost.nc``; a kill leaves the old ones or the new ones.

    Parameters
    ----------
    asked
        What the cube shows.
    results
        Its finished blocks.
    directory
        Where they are written.
    action
        What was done, for the history of the files.
    check
        Called before the files take their places; it raises where they must not.

    Raises
    ------
    StorageError
        If they cannot be written; older ones stay.
    """
    study, points, models = asked.study, asked.points, ModelRecords(asked.study)
    lengths = box(points.shape, results.point_bytes + _OTHER_BYTES, _SLAB_BYTES)
    if lengths == points.shape:
        cube, cost = part_of_cube(study, points, results.between(0, points.count), models)
        cube = cube.assign_attrs(cube_attributes(study, points, models))
        cost = cost.assign_attrs(cost_attributes(study, points, models))
        check()
        write_dataset(stamp_history(cost, action), directory / "cost.nc")
        write_dataset(stamp_history(cube, action), directory / "cube.nc")
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
            stamped = stamp_history(xr.Dataset(attrs=attributes(study, points, models)), action)
            written.finish(stamped.attrs)
        check()
