"""What the interface takes and gives, as pydantic models: the OpenAPI description is made from them."""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from tripod_doe.service.problems import Problem
from tripod_doe.service.requests.uploads import KINDS
from tripod_doe.study.definition.study_file_schema import NO_BOOLEAN

_STUDY = """[study]
name = "two angles"

[base]
model = "equilibrium"

[factors.joint_angle_deg]
values = [4, 12]
"""


class _Form(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Submission(_Form):
    """A study, a workflow, a fit or an optimisation, with the files that it names."""

    study: str | None = Field(None, description="text of a study file", examples=[_STUDY])
    workflow: str | None = Field(None, description="text of a workflow file, in place of a study")
    fit: str | None = Field(None, description="text of a fit file, in place of a study")
    optimisation: str | None = Field(None, description="text of an optimisation file, in place of a study")
    files: dict[str, str] = Field({}, description="texts of the files that it names, by their plain names")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if sum(getattr(self, kind) is not None for kind in KINDS) != 1:
            raise ValueError(f"give one of {', '.join(KINDS)}")
        return self


class PlanRequest(Submission):
    """What is to be planned."""

    timing: bool = Field(True, description="time some points, for at most ten seconds; else use recorded prices")


class Derivation(_Form):
    """Variables by formula to add to the results of a study, or to drop."""

    responses: dict[str, dict[str, Any]] = Field(
        {},
        description="tables by name, each with formula, unit and meaning, as [responses.NAME] of a study",
        examples=[{"peak": {"formula": "max(abs(thrust))", "unit": "N", "meaning": "largest thrust force"}}],
    )
    drop: list[str] = Field([], max_length=200, description="names of variables by formula that are removed")

    @model_validator(mode="after")
    def _one_at_least(self) -> Self:
        if not self.responses and not self.drop:
            raise ValueError("responses, drop: nothing to add or drop")
        return self


class ExtensionPlan(_Form):
    """The larger version of a study, or variables by formula, to be priced against its results."""

    study: str | None = Field(None, description="text of the larger study")
    files: dict[str, str] = Field({}, description="texts of the files that it names, by their plain names")
    responses: dict[str, dict[str, Any]] | None = Field(
        None, min_length=1, description="variables by formula, in place of a study"
    )
    timing: bool = Field(False, description="time some points, for at most ten seconds; else use recorded prices")

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.study is None) == (self.responses is None):
            raise ValueError("give either study or responses")
        return self


class Comparison(_Form):
    """A measurement, and the point that it is compared with."""

    measurement: str = Field(description="table (CSV) with thrust_n and rotation_deg, or thrust_n, time_s and tacho")
    select: list[str] = Field([], description="name=value, so that one point is left, or the points over speed_rpm")
    nearest: bool = Field(False, description="take the nearest value where none matches")
    columns: dict[str, str] = Field(
        {}, description="headings of thrust_n, rotation_deg, time_s or tacho in the table; empty: not used"
    )
    pulses_per_revolution: int | None = Field(
        None, ge=1, description="rising edges of tacho per revolution; inferred if omitted"
    )
    sign: Annotated[Literal[1, -1], NO_BOOLEAN] = Field(
        1, description="-1 where the force is positive away from the intermediate shaft"
    )
    reference_angle: float | None = Field(
        None, allow_inf_nan=False, description="rotation angle of the housing at the first rising edge (deg)"
    )
    speeds: str | None = Field(None, description="range of speed LOW:HIGH of the revolutions that are used (rpm)")


class Table(_Form):
    """A table of a measurement."""

    measurement: str = Field(description="table (CSV)")


class RunChange(_Form):
    """What people write about a run; what is left out stays."""

    name: str | None = Field(None, description="name to show; customer/joint-7 lies in the folder customer")
    owner: str | None = Field(None, description="person responsible for it")
    tags: list[str] | None = Field(None, description="all its tags")
    note: str | None = Field(None, description="note in Markdown")


class ShareRecord(BaseModel):
    """A link that opens one run."""

    id: str
    created: str
    expires: str


class NewShare(ShareRecord):
    """A link that was just made."""

    address: str = Field(description="address of the link; its secret is not stored")


class StudyText(_Form):
    """The text of a study file."""

    study: str


class FieldChange(StudyText):
    """One field of a study's form, and what it says now."""

    key: str = Field(pattern=r"^(study|design|parameter)\.[a-z0-9_]+$")
    value: str


class PointRequest(_Form):
    """A point to simulate."""

    scene: str
    parameters: dict[str, Any]

    @model_validator(mode="after")
    def _one_scene(self) -> Self:
        if "scene" in self.parameters:
            raise ValueError("parameters: scene is a key of its own besides parameters")
        return self


class Health(BaseModel):
    """Health check."""

    status: Literal["ok"]
    version: str


class Points(BaseModel):
    """Points of a run by their state."""

    total: int
    finished: int
    failed: int = Field(description="ended with an outcome that the study does not expect")
    missing: int = Field(description="not ended yet")


class RunRecord(BaseModel):
    """A run."""

    model_config = ConfigDict(extra="allow")  # steps, where it is no study

    id: str
    name: str
    owner: str
    tags: list[str]
    note: str
    found: bool = Field(description="whether the command line filled its directory, which the service never deletes")
    kind: Literal["study", "workflow", "fit", "optimisation"]
    question: str
    state: Literal["queued", "running", "stopping", "stopped", "finished", "failed"]
    message: str = Field(description="why it failed or stopped, what it does besides its points, or what it found")
    points: Points
    outcomes: dict[str, int] = Field(description="points by outcome")
    cpu_seconds: float = Field(description="CPU time of all points (s)")
    eta_seconds: float | None = Field(description="time until the last point (s); null without a pace")
    created: str = Field(description="when it was submitted, in UTC")
    updated: str
    binned: str = Field(description="when it was put into the bin; empty outside")


class Errors(BaseModel):
    """Why a request is refused."""

    errors: list[Problem]
