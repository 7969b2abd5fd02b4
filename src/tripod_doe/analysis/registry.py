"""All analyses by kind: what a study file may name, checked before anything runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr
from pydantic import BaseModel, ValidationError

from tripod_doe.analysis.choice import ChooseSettings, choose_for_study
from tripod_doe.analysis.claims import ClaimsSettings, check_claims, claims_json
from tripod_doe.analysis.claims_over_skew import ClaimsOverSkewSettings, claims_over_skew
from tripod_doe.analysis.comparison import ComparisonSettings, compare_file
from tripod_doe.analysis.contribution import ContributionSettings, contribution_shares
from tripod_doe.analysis.sensitivity import MorrisSettings, SobolSettings, morris_effects, sobol_indices
from tripod_doe.analysis.speed_accuracy import SpeedAccuracySettings, speed_accuracy
from tripod_doe.analysis.stability import StabilitySettings, stability_borders
from tripod_doe.errors import InputError, near_match
from tripod_doe.study.definition import Study
from tripod_doe.study.netcdf import stamp_history, write_dataset

__all__ = [
    "ANALYSES",
    "CHAIN_ANALYSES",
    "Analysis",
    "ChainAnalysis",
    "check_analyses",
    "checked_settings",
    "run_analyses",
    "settings_of",
]


@dataclass(frozen=True)
class Analysis:
    """An analysis that a study file can ask for.

    Attributes
    ----------
    settings
        Its settings in [analysis.NAME].
    designs
        Design kinds whose cubes it can read.
    crossed
        Whether such a design may also be a part of a product.
    function
        (cube, settings) -> result, both labelled.
    """

    settings: type[BaseModel]
    designs: tuple[str, ...]
    function: Callable[[xr.Dataset, Any], xr.Dataset]
    crossed: bool = False


ANALYSES: dict[str, Analysis] = {
    "sobol": Analysis(SobolSettings, ("saltelli",), sobol_indices),
    "morris": Analysis(MorrisSettings, ("morris",), morris_effects),
    "contribution": Analysis(ContributionSettings, ("ablation",), contribution_shares, crossed=True),
    "stability": Analysis(StabilitySettings, ("grid", "product"), stability_borders),
}
"""Analyses by the kind that study files use."""


def _serves(study: Study, analysis: Analysis) -> bool:
    """Whether the design of a study, or a part of a product, is one that the analysis can read."""
    design, parts = study.file.design, study.file.designs
    if design.kind == "product" and analysis.crossed:
        return any(parts[name].kind in analysis.designs for name in design.of if name in parts)
    return design.kind in analysis.designs


@dataclass(frozen=True)
class ChainAnalysis:
    """An analysis that only a workflow can ask for: of any number of cubes, or with files beside them.

    Attributes
    ----------
    settings
        Its settings in [steps.NAME.settings].
    function
        (cubes by the names of their steps, settings, folder of the workflow file) -> result, labelled.
    files
        Settings that name files, relative to the workflow file; their contents are part of the step's inputs.
    export
        For the answer to a workflow's question: the file of the result directory that tells it to other programs, and
        how its text is made of the result. The page of the workflow then tells it to people.
    partial
        Whether it can read the cubes of failed studies: it knows which points did not finish, and says so.
    """

    settings: type[BaseModel]
    function: Callable[[Mapping[str, xr.Dataset], Any, Path], xr.Dataset]
    files: tuple[str, ...] = ()
    export: tuple[str, Callable[[xr.Dataset], str]] | None = None
    partial: bool = False


CHAIN_ANALYSES: dict[str, ChainAnalysis] = {
    "comparison": ChainAnalysis(ComparisonSettings, compare_file, ("measurement",)),
    "choose": ChainAnalysis(ChooseSettings, choose_for_study, ("study",)),
    "speed-accuracy": ChainAnalysis(SpeedAccuracySettings, speed_accuracy),
    "claims": ChainAnalysis(ClaimsSettings, check_claims, export=("claims.json", claims_json), partial=True),
    "claims-over-skew": ChainAnalysis(ClaimsOverSkewSettings, claims_over_skew, partial=True),
}
"""Analyses that workflow files may name besides; an entry here is a kind of step."""


def settings_of(study: Study, kind: str, table: Mapping[str, Any], where: str) -> tuple[Analysis, BaseModel]:
    """Find an analysis of one study's cube, and check its settings before anything runs.

    Parameters
    ----------
    study
        The study whose cube it will read.
    kind
        A key of `ANALYSES`.
    table
        Its settings as written.
    where
        The table they stand in, for messages.

    Raises
    ------
    InputError
        If the kind or a setting is unknown, or the study's design does not serve it.
    """
    if kind not in ANALYSES:
        raise study.fail(where, f"kind = {kind!r}: unknown analysis{near_match(str(kind), ANALYSES)}")
    analysis = ANALYSES[kind]
    if not _serves(study, analysis):
        wanted = (
            f"a design of kind {' or '.join(analysis.designs)}{', or a product with one' if analysis.crossed else ''}"
        )
        raise study.fail(where, f"{kind} needs {wanted}; this study's is {study.file.design.kind}")
    try:
        settings = checked_settings(analysis.settings, table)
    except InputError as error:
        raise study.fail(where, error) from error
    for output in getattr(settings, "outputs", ()):
        if study.keep and output not in study.keep:
            raise study.fail(where, f"{output!r} is not kept; add it to the outputs of [keep]")
    return analysis, settings


def checked_settings(model: type[BaseModel], table: Mapping[str, Any]) -> BaseModel:
    """Settings of an analysis as its model, or what is wrong with the first bad one.

    Raises
    ------
    InputError
        If a key is unknown, with the nearest known one, or missing, or its value is refused.
    """
    try:
        return model.model_validate(table)
    except ValidationError as error:
        # an unknown key first: where it is a slip of the pen, it explains the missing one
        item = min(error.errors(), key=lambda item: item["type"] != "extra_forbidden")
        key = str(item["loc"][0])
        if item["type"] == "extra_forbidden":
            raise InputError(f"unknown key {key!r}{near_match(key, model.model_fields)}") from error
        if item["type"] == "missing":
            raise InputError(f"{key} is missing") from error
        raise InputError(f"{key} = {item['input']!r}: {item['msg']}") from error


def _settings(study: Study, name: str) -> tuple[Analysis, BaseModel]:
    table = dict(study.file.analysis[name])
    return settings_of(study, table.pop("kind", name), table, f"[analysis.{name}]")


def check_analyses(study: Study) -> None:
    """Check the analyses of a study before anything runs.

    Raises
    ------
    InputError
        If a kind or a setting is unknown, or the design does not serve it.
    """
    for name in study.file.analysis:
        _settings(study, name)


def run_analyses(study: Study, cube: xr.Dataset, directory: Path) -> dict[str, str]:
    """Run all analyses of a study into ``directory/analysis/NAME.nc``.

    Returns
    -------
    dict
        By name, why an analysis could not be made; empty text where it was.
    """
    reasons: dict[str, str] = {}
    for stale in (directory / "analysis").glob("*.nc"):  # of another version of the study, or of other points
        stale.unlink()
    for name in study.file.analysis:
        analysis, settings = _settings(study, name)
        try:
            result = analysis.function(cube, settings)
        except InputError as error:
            reasons[name] = str(error)
            continue
        kept = {key: cube.attrs[key] for key in ("Conventions", "institution", "source", "references", "study_hash")}
        result = result.assign_attrs(kept | {"title": f"{cube.attrs['title']}: {name}"} | result.attrs)
        write_dataset(stamp_history(result, f"analysis {name}"), directory / "analysis" / f"{name}.nc")
        reasons[name] = ""
    return reasons
