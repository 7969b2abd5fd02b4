"""The tables of a workflow file, checked key by key, and their schema."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, ValidationError

from tripod_doe.analyses.registry import ANALYSES, FIGURES
from tripod_doe.errors import InputError, near_match
from tripod_doe.names import check_identifier
from tripod_doe.study.definition.complaints import complaints
from tripod_doe.study.definition.study_file_schema import FactorTable, Scalar, Table
from tripod_doe.study.definition.toml_text import parse_toml


class HeadTable(Table):
    """[workflow]: name and question."""

    name: str = Field(min_length=1, max_length=200, description="short name of the workflow")
    question: str = Field("", max_length=4_000, description="the question it answers; the report shows it")


class Overrides(Table):
    """Changes to a study file: in a study step, and in [quick.STEP] for --quick."""

    base: dict[str, Scalar] = Field({}, description="base values to set")
    factors: dict[str, FactorTable] = Field({}, description="factors of the study to replace, each as a whole")
    design: dict[str, Any] = Field({}, description="keys of [design] to set, for instance samples or levels")


class StudyStep(Overrides):
    """[steps.NAME] of kind study: run a study file."""

    kind: Literal["study"] = Field(description="kind of the step")
    study: str = Field(description="study file, relative to the workflow file")
    inputs: list[str] = Field([], description="steps that must be finished before")
    table: str = Field(
        "", description="one of the inputs, which gives the study its points: its parameters along point"
    )


class AnalysisStep(Table):
    """[steps.NAME] of kind analysis: from the cubes of other steps to a cube."""

    kind: str = Field(description="analysis, or the name of the analysis itself")
    analysis: str = Field("", description="name of the analysis, where kind is analysis")
    inputs: list[str] = Field(min_length=1, description="steps whose cubes it reads")
    settings: dict[str, Any] = Field({}, description="settings of the analysis")


class FigureStep(Table):
    """[steps.NAME] of kind figure: from the cubes of other steps to SVG files with their numbers."""

    kind: Literal["figure"] = Field(description="kind of the step")
    figure: str = Field(description="name of the figure")
    title: str = Field(
        "",
        description="heading on a report page; claims of the figures that it names, as in "
        "'Figs. 10 and 15', are then next to it; the step's name if omitted",
    )
    inputs: list[str] = Field(min_length=1, description="steps whose cubes it shows")


class ReportStep(Table):
    """[steps.NAME] of kind report: one page with the findings and figures of other steps."""

    kind: Literal["report"] = Field(description="kind of the step")
    title: str = Field("", description="heading of the page; the step's name if omitted")
    inputs: list[str] = Field(min_length=1, description="steps that it shows, in this order")


class WorkflowFile(Table):
    """A whole workflow file."""

    workflow: HeadTable
    steps: dict[str, dict[str, Any]] = Field(
        min_length=1, max_length=200, description="the steps, [steps.NAME] with a kind"
    )
    quick: dict[str, Overrides] = Field({}, description="what --quick changes in study steps, [quick.STEP]")


_KINDS: dict[str, type[Table]] = {
    "study": StudyStep,
    "analysis": AnalysisStep,
    "figure": FigureStep,
    "report": ReportStep,
}
StepTable = StudyStep | AnalysisStep | FigureStep | ReportStep


def parse_workflow(text: str, origin: str) -> WorkflowFile:
    """Parse the text of a workflow file; its steps are checked one by one, by `parse_step`.

    Raises:
        InputError: If it is no TOML, or a key is unknown, missing or of the wrong type.
    """
    raw = parse_toml(text, origin)
    if "study" in raw and "workflow" not in raw:
        raise InputError(f"{origin}: this is a study, not a workflow: `tripod-doe run` runs it")
    try:
        return WorkflowFile.model_validate(raw)
    except ValidationError as error:
        raise InputError("\n".join(f"{origin}: {line}" for line in complaints(error, WorkflowFile))) from error


def parse_step(origin: str, name: str, table: dict[str, Any]) -> StepTable:
    """Check one step's table by its kind.

    Raises:
        InputError: If its name, its kind, a key or the analysis or figure that it names is not known.
    """
    try:
        check_identifier(name, "a step, written [steps.NAME]")
    except InputError as error:
        raise error.at(origin) from error
    where = f"[steps.{name}]"
    kind, known = str(table.get("kind", "")), [*_KINDS, *ANALYSES]
    if kind not in known:
        reason = f"kind = {kind!r}: unknown" if kind else "kind is missing"
        raise InputError(f"{origin}: {where}: {reason}{near_match(kind, known)}")
    model = _KINDS.get(kind, AnalysisStep)
    try:
        checked = model.model_validate(table)
    except ValidationError as error:
        lines = complaints(error, model)
        raise InputError("\n".join(f"{origin}: {line.replace('the file', where, 1)}" for line in lines)) from error
    assert isinstance(checked, StudyStep | AnalysisStep | FigureStep | ReportStep)
    for allowed, given, key in _names(checked):
        if given not in allowed:
            raise InputError(f"{origin}: {where}: {key} = {given!r}: unknown{near_match(given, allowed)}")
    return checked


def _names(table: StepTable) -> list[tuple[list[str], str, str]]:
    """Allowed names, the given one, and its key, where a step names an analysis or a figure."""
    if isinstance(table, AnalysisStep):
        return [([*ANALYSES], analysis_name(table), "analysis")]
    return [(list(FIGURES), table.figure, "figure")] if isinstance(table, FigureStep) else []


def analysis_name(table: AnalysisStep) -> str:
    """The analysis that a step names: its kind, unless that is "analysis"."""
    return table.analysis if table.kind == "analysis" else table.kind


def workflow_schema() -> dict[str, Any]:
    """JSON Schema of workflow files: every table and key, every kind of step, analysis and figure."""
    schema = WorkflowFile.model_json_schema()
    definitions = schema["$defs"]
    for model in _KINDS.values():
        own = model.model_json_schema(ref_template="#/$defs/{model}")
        definitions |= own.pop("$defs", {})
        definitions[model.__name__] = own
    definitions["AnalysisStep"]["properties"]["analysis"]["enum"] = ["", *ANALYSES]
    definitions["AnalysisStep"]["properties"]["kind"]["enum"] = ["analysis", *ANALYSES]
    definitions["FigureStep"]["properties"]["figure"]["enum"] = list(FIGURES)
    schema["properties"]["steps"]["additionalProperties"] = {
        "anyOf": [{"$ref": f"#/$defs/{model.__name__}"} for model in _KINDS.values()]
    }
    settings = {name: entry.settings for name, entry in ANALYSES.items()}
    schema["x-settings"] = {name: model.model_json_schema() for name, model in settings.items()}
    return schema
