"""Analyses that a study requests: checked before anything runs, then computed from its cube."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import xarray as xr
from pydantic import BaseModel, ValidationError

from tripod_doe.analyses.contribution.contribution import ContributionSettings
from tripod_doe.analyses.registry import ANALYSES, Analysis
from tripod_doe.analyses.sensitivity.method import DEPENDENT
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, check_tolerance
from tripod_doe.errors import InputError, near_match
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.model_interface import Outcome
from tripod_doe.names import path_within
from tripod_doe.study.cube.netcdf import results_in_history, stamp_history, write_dataset
from tripod_doe.study.definition.complaints import said_of
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.toml_text import shown
from tripod_doe.study.result_directory.latest_run import FAILED

_KEPT = ("Conventions", "institution", "source", "references", "study_hash")
"""Attributes of a cube that its analyses have, too."""


def settings_of(study: Study, kind: str, table: Mapping[str, Any], where: str) -> tuple[Analysis, BaseModel]:
    """Find an analysis of one study's cube, and check its settings before anything runs.

    Args:
        study: The study whose cube it will read.
        kind: A key of `ANALYSES`.

    Raises:
        InputError: If the kind or a setting is unknown, or the analysis cannot use the study's design.
    """
    known = [name for name, entry in ANALYSES.items() if entry.designs]
    if kind not in known:
        reason = "only a workflow can ask for this analysis" if kind in ANALYSES else "unknown analysis"
        raise study.fail(where, f"kind = {kind!r}: {reason}{near_match(str(kind), known)}")
    analysis = ANALYSES[kind]
    design = study.file.design
    parts = [study.file.designs[name].kind for name in design.of] if design.kind == "product" else []
    if not {design.kind, *(parts if analysis.crossed else ())} & set(analysis.designs):
        wanted = f"a design of kind {' or '.join(analysis.designs)}" + ", or a product with one" * analysis.crossed
        own = f"a product of {' and '.join(parts)}" if parts else design.kind
        raise study.fail(where, f"{kind} needs {wanted}; this study's is {own}")
    if analysis.independent and (design.correlation or design.constraints):
        raise study.fail(where, f"{kind}: {DEPENDENT}")
    try:
        if (design.samples or analysis.fewest) < analysis.fewest:
            raise InputError(f"samples = {design.samples}: {kind} needs at least {analysis.fewest}")
        settings = checked_settings(analysis.settings, table)
        if isinstance(settings, ToleranceSettings):
            check_tolerance(settings, study)
    except InputError as error:
        raise study.fail(where, error) from error
    for output in getattr(settings, "outputs", ()):
        if study.keep and output not in (*study.keep, *(response.name for response in study.responses)):
            key = "outputs" if not isinstance(settings, ContributionSettings) else settings.key_of(output)
            raise study.fail(where, f"{key}: {_not_kept(output, study)}")
    return analysis, settings


def _not_kept(output: str, study: Study) -> str:
    """The reason why an analysis cannot use an output."""
    whole, _, order = output.rpartition("_")
    if output in study.simulator.outputs:
        return f"{output!r} is not kept; add it to the outputs of [keep]"
    if whole in study.keep and order.isdigit():
        return f"{output!r} is one order of an output; write {whole!r}, the answer has all orders"
    known = [*study.keep, *(response.name for response in study.responses)]
    return f"unknown output {output!r}{near_match(output, known)}"


def checked_settings(model: type[BaseModel], table: Mapping[str, Any]) -> BaseModel:
    """Settings of an analysis as its model.

    Raises:
        InputError: If a key is unknown, with the nearest known one, or missing, or its value is refused.
    """
    try:
        return model.model_validate(table)
    except ValidationError as error:
        # an unknown key first: if it is a typing error, it explains the missing key
        item = min(error.errors(), key=lambda item: item["type"] != "extra_forbidden")
        key = ".".join(map(str, item["loc"]))
        if item["type"] == "extra_forbidden":
            raise InputError(f"unknown key {key!r}{near_match(key, model.model_fields)}") from error
        if item["type"] == "missing":
            raise InputError(f"{key} is missing") from error
        raise InputError(f"{key} = {shown(item['input'])}: {said_of(item, key)}") from error


def analysis_of(study: Study, name: str) -> tuple[Analysis, BaseModel]:
    """An analysis of a study by its name, with its settings; InputError as `settings_of`."""
    table = dict(study.file.analysis[name])
    return settings_of(study, table.pop("kind", name), table, f"[analysis.{name}]")


def check_analyses(study: Study) -> None:
    """Check the analyses of a study before anything runs.

    Raises:
        InputError: If a kind or a setting is unknown, or an analysis cannot use the design.
    """
    for name in study.file.analysis:
        analysis_of(study, name)


def run_analyses(study: Study, cube: xr.Dataset, directory: Path, check: Callable[[], None]) -> dict[str, str]:
    """Run all analyses of a study into ``directory/analysis/NAME.nc``; `check` is called before one is written.

    Returns:
        For each analysis by name, the reason why it failed; empty if it did not.
    """
    reasons: dict[str, str] = {}
    for name in study.file.analysis:
        analysis, settings = analysis_of(study, name)
        try:
            result = analysis.function({name: cube}, settings, study.folder)
        except InputError as error:
            some = bool((cube["outcome"] == Outcome.FINISHED).any())
            reasons[name] = str(error) if some else "no point finished: there is nothing to analyse"
            continue
        except MemoryError as error:
            reasons[name] = f"it does not fit into the free memory ({error})"
            continue
        kept = {key: cube.attrs[key] for key in _KEPT if key in cube.attrs}
        result = result.assign_attrs(kept | {"title": f"{cube.attrs['title']}: {name}"} | result.attrs)
        result = stamp_history(result, f"analysis {name}", results_in_history(cube.attrs.get("history")))
        check()
        write_dataset(result, path_within(directory, "analysis", f"{name}.nc"))
        reasons[name] = ""
    failed = {name: reason for name, reason in reasons.items() if reason}
    if failed or (directory / FAILED).exists():
        write_listed(directory / FAILED, json.dumps(failed))
    return reasons
