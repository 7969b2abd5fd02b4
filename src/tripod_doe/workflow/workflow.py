"""Workflow files: a TOML text becomes a checked chain of steps, or an error that names file, step, value and remedy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from secrets import token_hex
from typing import Any

import tomlkit
import xarray as xr
from pydantic import BaseModel

from tripod_doe.analyses.registry import ANALYSES, STUDY_FIGURES
from tripod_doe.errors import InputError, near_match, option
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import load_study, parse_study
from tripod_doe.study.definition.study_file_schema import DESIGN_KEYS, keys_read_by
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.definition.toml_text import read_text, toml_array
from tripod_doe.study.designs import make_points
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.workflow.analyses import check_analyses, checked_settings, settings_of
from tripod_doe.workflow.step_hash import StepHash
from tripod_doe.workflow.workflow_file import (
    AnalysisStep,
    FigureStep,
    Overrides,
    ReportStep,
    StepTable,
    StudyStep,
    WorkflowFile,
    analysis_name,
    parse_step,
    parse_workflow,
)

_MAKE_ANALYSES = ("analyses", "measurements")
_MAKE_PAGES = (*_MAKE_ANALYSES, "page_parts", "reports")
"""Folders of this package whose code makes the result of a step."""


@dataclass(frozen=True)
class Step:
    """One checked step."""

    name: str  # its name in the file, and the name of its directory
    table: StepTable  # its table
    # hash of all that determines its result: its text, its study's text and points, the kernels or the code of
    # its analysis or figure, the files it reads, and the hashes of its inputs (16 hex digits)
    hash: str
    study: Study | None = None  # the study of a study step, with its overrides; None for others
    settings: BaseModel | None = None  # checked settings of an analysis; None for others
    listed: int = 0  # points of the study that the settings of an analysis name, which its result lists

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the steps that it needs, each once."""
        return tuple(dict.fromkeys(self.table.inputs))

    @property
    def analysis(self) -> str:
        """Name of the analysis of an analysis step: its kind, unless that is just "analysis"."""
        assert isinstance(self.table, AnalysisStep)
        return analysis_name(self.table)


@dataclass(frozen=True)
class Workflow:
    """A checked workflow."""

    file: WorkflowFile  # the parsed file
    steps: Mapping[str, Step]  # steps by name, each after the steps that it needs
    # text, origin, folder: the file as written, its path for messages, and the folder of the files it names
    text: str
    origin: str
    folder: StudyFolder
    quick: bool  # whether the overrides of [quick] are in force

    def needed_for(self, name: str) -> list[str]:
        """A step and all steps that it needs, in order; InputError if there is no such step."""
        if name not in self.steps:
            raise InputError(f"{option('only', name)}: no such step in {self.origin}{near_match(name, self.steps)}")
        needed = {name}
        for other in reversed(list(self.steps)):
            if other in needed:
                needed |= set(self.steps[other].inputs)
        return [other for other in self.steps if other in needed]


def load_workflow(path: str | Path, quick: bool = False, folder: StudyFolder | None = None) -> Workflow:
    """Read and check a workflow file and all study files that it names; nothing is run.

    Args:
        path: The workflow file.
        quick: Whether to apply the overrides of [quick].
        folder: Where its files and functions are looked up; its own folder if omitted, without restriction.

    Raises:
        InputError: If a file cannot be read, a key, kind, name or value is not known, or steps depend on each other.
    """
    path = Path(path)
    text, origin, folder = read_text(path, "workflow file"), str(path), folder or StudyFolder.of(path)
    file = parse_workflow(text, origin)
    tables = {name: parse_step(origin, name, table) for name, table in file.steps.items()}
    for name, table in tables.items():
        for needed in table.inputs:
            if needed not in tables:
                raise InputError(f"{origin}: [steps.{name}]: inputs: no step {needed!r}{near_match(needed, tables)}")
    for name in file.quick:
        if not isinstance(tables.get(name), StudyStep):
            studies = [key for key, table in tables.items() if isinstance(table, StudyStep)]
            raise InputError(f"{origin}: [quick.{name}]: no study step of this name{near_match(name, studies)}")
    workflow = Workflow(file, {}, text, origin, folder, quick)
    steps: dict[str, Step] = {}
    for name in _in_order(origin, tables):
        steps[name] = _check_step(workflow, name, tables[name], steps)
    return Workflow(file, steps, text, origin, folder, quick)


def _in_order(origin: str, tables: Mapping[str, StepTable]) -> list[str]:
    try:
        return list(TopologicalSorter({name: table.inputs for name, table in tables.items()}).static_order())
    except CycleError as error:
        ring = " -> ".join(reversed(error.args[1]))
        raise InputError(f"{origin}: [steps]: circular inputs: {ring}; remove one of them") from error


def _check_step(workflow: Workflow, name: str, table: StepTable, before: Mapping[str, Step]) -> Step:
    """Check the files and steps that a step names, and hash all that determines its result."""
    where = f"{workflow.origin}: [steps.{name}]"
    digest = StepHash(table.model_dump_json(), *(before[needed].hash for needed in table.inputs))
    if isinstance(table, StudyStep):
        if table.table and not isinstance(before.get(table.table), Step):
            raise InputError(
                f"{where}: table = {table.table!r}: not one of its inputs{near_match(table.table, table.inputs)}"
            )
        study = _study_of(workflow, name, table)
        _add_study(digest, study)
        return Step(name, table, digest.text(), study=study)
    for needed in table.inputs:
        if not isinstance(table, ReportStep) and isinstance(before[needed].table, FigureStep | ReportStep):
            raise InputError(f"{where}: inputs: {needed!r} is a {before[needed].table.kind} and has no cube")
    if isinstance(table, AnalysisStep):
        settings, listed = _settings(workflow, where, name, table, before, digest)
        digest.add_code(*_MAKE_ANALYSES)
        return Step(name, table, digest.text(), settings=settings, listed=listed)
    digest.add_code(*_MAKE_PAGES)
    if isinstance(table, FigureStep):
        _check_figure(where, table, before)
    if isinstance(table, ReportStep):  # its page shows the question, and what a quick run changes
        quick = workflow.file.quick if workflow.quick else {}
        digest.add(workflow.file.workflow.question, *(change.model_dump_json() for change in quick.values()), *quick)
    return Step(name, table, digest.text())


def _check_figure(where: str, table: FigureStep, before: Mapping[str, Step]) -> None:
    """Refuse a figure whose inputs hold nothing that it shows."""
    figure, given = table.figure, ", ".join(dict.fromkeys(table.inputs))
    made = [before[needed].analysis for needed in table.inputs if before[needed].study is None]
    if figure in STUDY_FIGURES:
        if made or len({*table.inputs}) > 1:
            raise InputError(f"{where}: inputs: the figure {figure} shows one study step, not {given}")
    elif not any(figure in ANALYSES[kind].figures for kind in made):
        kinds = " or ".join(kind for kind, entry in ANALYSES.items() if figure in entry.figures)
        raise InputError(f"{where}: inputs: the figure {figure} shows a step of kind {kinds}; {given} is none")


def _settings(
    workflow: Workflow, where: str, name: str, table: AnalysisStep, before: Mapping[str, Step], digest: StepHash
) -> tuple[BaseModel, int]:
    """Checked settings of an analysis, and how many points the study has that they name."""
    analysis, listed = analysis_name(table), 0
    entry = ANALYSES[analysis]
    if entry.designs:
        study = before[table.inputs[0]].study
        if len(table.inputs) != 1 or study is None:
            raise InputError(f"{where}: {analysis} needs one study step as its input")
        for key in filter(table.settings.get, entry.runs):
            raise InputError(
                f"{where}: settings: {key}: a step runs no other points; put the analysis with {key} into "
                f"{study.origin}, as [analysis.{analysis}]"
            )
        return settings_of(study, analysis, table.settings, f"[steps.{name}] of {workflow.origin}")[1], listed
    try:
        settings = checked_settings(entry.settings, table.settings)
        for key in entry.files:
            path = workflow.folder.file(getattr(settings, key), key)
            if key == "study":
                listed = _add_study(digest, load_study(path, workflow.folder.around(path)))
            else:
                digest.add_bytes(_bytes(path, key))
    except InputError as error:
        raise error.at(f"{where}: settings") from error
    return settings, listed


def _bytes(path: Path, key: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{key}: cannot read {path}: {error.strerror}") from error


def _add_study(digest: StepHash, study: Study) -> int:
    """Add a study and the points that it runs, which its tables may list, to a hash; gives their number."""
    points = make_points(study)
    keys = point_keys(study, points)[points.allowed]
    digest.add(study.text, study.simulator.source_hash or token_hex())  # a function without a file: never the same
    digest.add_bytes(keys.tobytes())
    return keys.size


def _study_of(workflow: Workflow, name: str, table: StudyStep) -> Study:
    """The study of a step with its overrides; without overrides its text stays exactly the same."""
    try:
        path = workflow.folder.file(table.study, "study")
    except InputError as error:
        raise error.at(f"{workflow.origin}: [steps.{name}]") from error
    try:
        text = read_text(path, "study file")
        changes: list[tuple[Overrides, str, str]] = [(table, f"[steps.{name}]", "")]
        if workflow.quick and name in workflow.file.quick:
            changes.append((workflow.file.quick[name], f"[quick.{name}]", " (quick)"))
        for overrides, where, suffix in changes:
            text = _overridden(text, overrides, f"{where}: study {path}", suffix)
        study = parse_study(text, str(path), workflow.folder.around(path))
        check_analyses(study)
    except InputError as error:
        raise type(error)(f"{workflow.origin}: [steps.{name}]: {error}") from error
    return study


def fed_study(study: Study, table: xr.Dataset, name: str) -> Study:
    """A study with the points of a table, for instance of a choice of model; its text lists them all.

    Args:
        study: A study whose factors are among the columns; if a pilot had to choose the model, the model is, too.
        table: Parameters of the study along ``point``; other variables are ignored.
        name: Name of the table, for messages.

    Raises:
        InputError: If the table lacks a factor.
    """
    parameters = study.simulator.parameters
    columns = {
        str(key): table[key].values.tolist()
        for key in table.variables
        if table[key].dims == ("point",) and str(key) in parameters
    }
    wanted = [*study.factors, *(study.auto_model.parameters if study.auto_model else ())]
    for factor in wanted:
        if factor not in columns:
            raise study.fail(
                "[design]", f"the table of step {name!r} has no column {factor}{near_match(factor, columns)}"
            )
    document: Any = tomlkit.parse(study.text)
    for key in ("design", "factors", *(("accuracy",) if study.auto_model else ())):  # a choice has the accuracy
        document.pop(key, None)
    document["base"] = dict(study.base)
    document["factors"] = {key: {"values": toml_array(values)} for key, values in columns.items()}
    document["design"] = {"kind": "zip", "constraints": study.file.design.constraints}
    return parse_study(tomlkit.dumps(document), study.origin, study.folder)


def _overridden(text: str, overrides: Overrides, where: str, suffix: str) -> str:
    given = overrides.model_dump(include={"base", "factors", "design"}, exclude_unset=True)
    if not any(given.values()):
        return text
    try:
        document: Any = tomlkit.parse(text)
    except ValueError as error:
        raise InputError(f"{where}: not valid TOML: {error}") from error
    for factor in given.get("factors", {}):
        if factor not in document.get("factors", {}):
            hint = near_match(factor, document.get("factors", {}))
            raise InputError(f"{where}: factors.{factor}: this study does not vary it{hint}")
    kind, own = given.get("design", {}).get("kind"), document.get("design", {})
    if kind in DESIGN_KEYS and kind != own.get("kind", "grid"):  # keys of the other kind mean nothing to it
        document["design"] = {key: value for key, value in own.items() if key in keys_read_by(kind)}
    for table, entries in given.items():
        if entries:
            document.setdefault(table, tomlkit.table()).update(entries)
    if suffix and "study" in document:
        document["study"]["name"] = str(document["study"].get("name", "")) + suffix
    return tomlkit.dumps(document)
