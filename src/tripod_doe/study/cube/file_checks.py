"""Checks of a netCDF file before it is read: undamaged, in a result directory one of its results, usable attributes.

All readers of netCDF files call `refuse_unfit`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tripod_doe.errors import CubeError
from tripod_doe.files.checksum_list import names_results, number_in, refuse_changed, refuse_other_results
from tripod_doe.files.regular_files import refuse_irregular, version_of
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.file_digest import is_damaged, is_sealed
from tripod_doe.study.cube.netcdf import opened_file, reading, remedy, results_in_history
from tripod_doe.study.journal import STUDY_HASH, Journal, journal_path
from tripod_doe.study.memory import refuse_too_many_points

if TYPE_CHECKING:
    import xarray as xr  # queries do without it

MOST_CHECKED = 100_000_000
"""Bytes of a file up to which its digest is checked when it is opened: 0.2 s."""

ANALYSES = "analysis"
"""Folder of a result directory with its analyses."""

_RESULTS = ("cube.nc", "cost.nc", "choice.nc")
_LISTED = ("cube.nc", "fit.nc", "front.nc", "candidates.nc")  # of a step, a fit and an optimisation
_POINT_BYTES = 16  # at least, of a point while its outcome is checked
_TABLES = {"fixed_parameters", "package_versions"}
_WORDS = {"flag_meanings", "long_name", "role", "units"}
"""Attributes of variables that pages and tables read."""

_TEXTS = {
    "design_notes", "history", "kernel_source_hash", "model_notes", "question", "source", "study", "study_hash",
    "title",
}  # fmt: skip
"""Attributes of cubes and analyses that pages and tables read."""


class OtherStudyError(CubeError):
    """A result of another study than its directory's, or of one that has been replaced meanwhile."""


def refuse_unfit(path: Path, whole: bool = False) -> None:
    """Refuse a missing or damaged file, or one that does not belong to its result directory.

    Args:
        path: The file; outside of a result directory, a file without a digest is accepted.
        whole: Whether a large file is also read for its digest.

    Raises:
        OtherStudyError: If the study of the directory is another one.
        CubeError: For any other reason; both with the remedy.
    """
    _refuse_damaged(path, whole)
    directory = _directory_of(path)
    refuse_changed(path, unlisted=directory is None and path.name in _LISTED and names_results(path.parent))
    if directory is not None:
        if directory != path.parent:  # an analysis has no list next to it
            refuse_other_results(directory)
        _refuse_other_study(path, directory)


def analysis_files(directory: Path) -> dict[str, Path]:
    """The files of analyses in a result directory, by names of the analyses, without hidden files."""
    files = sorted((directory / ANALYSES).glob("*.nc"))
    return {path.stem: path for path in files if not path.name.startswith(".")}


def _refuse_damaged(path: Path, whole: bool) -> None:
    refuse_irregular(path, CubeError)
    with reading(path):
        if is_damaged(path, None if whole else MOST_CHECKED):
            raise CubeError(f"{path}: damaged: its content does not match its checksum; {remedy(path)}")
        if _directory_of(path) is not None and not is_sealed(path):
            raise CubeError(
                f"{path}: the checksum at its end is missing, as another program changed the file, or its end is lost; "
                f"{remedy(path)}; or move the file out of the result directory to read it as it is"
            )


def _directory_of(path: Path) -> Path | None:
    """The result directory of a file, from its path; None if it is not a result."""
    inside = path.name in _RESULTS or path.parent.name == ANALYSES
    directory = path.parent.parent if path.parent.name == ANALYSES else path.parent
    return directory if inside and journal_path(directory).exists() else None


def _refuse_other_study(path: Path, directory: Path) -> None:
    with Journal(directory, read_only=True) as journal:
        expected = journal.recall(STUDY_HASH)
    known, number = _origin(path)
    if expected is not None and known != expected and (known or path.parent.name == ANALYSES):
        raise OtherStudyError(
            f"{path}: its results are of another study, or of this one before it was extended; {remedy(path)}"
        )
    if number and number != number_in(journal_path(directory)):
        raise CubeError(f"{path}: its results are of another directory; {remedy(path)}")


def study_hash(path: Path) -> str:
    """Read the hash of the study of a cube or an analysis; empty without one.

    Raises:
        CubeError: If the file is missing or damaged.
    """
    _refuse_damaged(path, whole=False)
    return _origin(path)[0]


def _origin(path: Path) -> tuple[str, int]:
    """Hash of the study and number of the results of a file; empty and 0 without them."""
    with reading(path):
        return _stored_origin(path, version_of(path.stat()))


@lru_cache(maxsize=1000)
def _stored_origin(path: Path, version: tuple[int, ...]) -> tuple[str, int]:
    with opened_file(path) as stored:
        study, history = (
            str(stored.getncattr(name)) if name in stored.ncattrs() else "" for name in ("study_hash", "history")
        )
        return study, results_in_history(history)


def refuse_unusable(path: Path, stored: xr.Dataset) -> None:
    """Refuse unusable attributes and unknown outcomes, as in files from another program."""
    if path.parent.name == ANALYSES and not isinstance(stored.attrs.get("analysis_kind"), str):
        raise CubeError(f"{path}: it does not say of which kind of analysis it is; {remedy(path)}")
    for name in _TEXTS.intersection(stored.attrs):
        if not isinstance(stored.attrs[name], str):
            raise CubeError(f"{path}: the attribute {name} holds no text; {remedy(path)}")
    for label, variable in stored.variables.items():
        for key in _WORDS.intersection(variable.attrs):
            if not isinstance(variable.attrs[key], str):
                raise CubeError(f"{path}: {label}: the attribute {key} holds no text; {remedy(path)}")
        if "flag_values" in variable.attrs and not _are_flags(variable.attrs):
            raise CubeError(f"{path}: {label}: flag_values and flag_meanings do not fit each other; {remedy(path)}")
    for name in _TABLES.intersection(stored.attrs):
        try:
            table = isinstance(json.loads(stored.attrs[name]), dict)
        except (ValueError, TypeError, RecursionError):
            table = False
        if not table:
            raise CubeError(f"{path}: the attribute {name} holds no table in JSON; {remedy(path)}")
    if "outcome" not in stored:
        return
    refuse_too_many_points(stored["outcome"].size, _POINT_BYTES)
    if not np.isin(stored["outcome"].values, list(Outcome)).all():
        raise CubeError(f"{path}: it holds an outcome that does not exist; {remedy(path)}")


def _are_flags(attributes: Mapping[str, Any]) -> bool:
    """Whether a flag has a number for each word."""
    values = np.atleast_1d(attributes["flag_values"])
    return values.dtype.kind in "iuf" and values.size == len(attributes.get("flag_meanings", "").split())
