"""Confirmation of a tolerance analysis with other points: runs its first change of factors as a separate study."""

import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomlkit
import xarray as xr

from tripod_doe.analyses.tolerance.confirmation import Change, changes_to_confirm, with_confirmed
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings
from tripod_doe.errors import StorageError
from tripod_doe.names import path_within
from tripod_doe.study.cube.lazy_dataset import read_dataset
from tripod_doe.study.cube.netcdf import write_dataset
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.toml_text import read_text
from tripod_doe.study.result_directory.stored_study import STORED
from tripod_doe.workflow.analyses import analysis_of

CONFIRMATION = "confirmation"
"""Folder of a result directory with the studies that confirm its tolerance analyses."""

RunStudy = Callable[[Study, Path], None]


def confirming_points(study: Study) -> int:
    """The largest number of points that the tolerance analyses of a study run to confirm their proposals."""
    return sum(each.confirm * len(each.limits) for each in _settings_to_confirm(study).values())


def _settings_to_confirm(study: Study) -> dict[str, ToleranceSettings]:
    """The settings of the tolerance analyses to confirm, by name."""
    own = {name: analysis_of(study, name)[1] for name in study.file.analysis}
    return {name: each for name, each in own.items() if isinstance(each, ToleranceSettings) and each.confirm}


def confirm_tolerances(study: Study, directory: Path, run_study: RunStudy | None) -> None:
    """Run the changes that tolerance analyses propose, with other points, and add the results to the analyses.

    Args:
        run_study: Runs a study into a directory, without computing existing points again. None runs nothing, and adds
            the results of an earlier run.
    """
    for name, settings in _settings_to_confirm(study).items():
        path = path_within(directory, "analysis", f"{name}.nc")
        if not path.exists():  # the analysis failed, and its reason is stated
            continue
        result, answers = read_dataset(path), list[tuple[Change, xr.Dataset]]()
        for change in changes_to_confirm(result):
            place = path_within(directory, CONFIRMATION, name, change.label)
            other = _confirming_study(study, name, change, settings)
            if run_study:
                _remove_other_change(place, other)
                run_study(other, place)
            own = path_within(place, "analysis", f"{name}.nc")
            if own.exists() and (said := read_dataset(own)).attrs.get("study_hash") == other.hash:
                answers.append((change, said))
        if answers:
            write_dataset(with_confirmed(result, answers), path)


def _remove_other_change(place: Path, study: Study) -> None:
    """Remove the points of another change, which was proposed before the settings or the points changed.

    Raises:
        StorageError: If they cannot be removed.
    """
    stored = place / STORED
    try:
        if (
            stored.is_file()
            and tomllib.loads(read_text(stored, "study"))["factors"] != tomllib.loads(study.text)["factors"]
        ):
            shutil.rmtree(place)
    except OSError as error:
        raise StorageError(f"{place}: cannot remove the points of an earlier change: {error.strerror}") from error


def _confirming_study(study: Study, name: str, change: Change, settings: ToleranceSettings) -> Study:
    """The study with the change, other points, and the same analysis."""
    document: Any = tomlkit.parse(study.text)
    document["study"]["name"] = f"{study.file.study.name}: confirmation of {change.label}"
    for factor, table in change.factors.items():
        document["factors"][factor] = table.model_dump(exclude_none=True, exclude_defaults=True)
    document["design"] |= {"seed": study.file.design.seed + 1, "samples": settings.confirm}
    if "scramble" in document["design"]:  # a sequence that is not scrambled gives the same points for any seed
        document["design"]["scramble"] = True
    asked = {key: value for key, value in study.file.analysis[name].items() if key not in ("confirm", "costs")}
    document["analysis"] = {name: asked}
    return parse_study(tomlkit.dumps(document), study.origin, study.folder)
