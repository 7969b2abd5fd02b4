"""The form of a study file: its tables and keys, checked by pydantic, with errors that name table, key and value."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AllowInfNan, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from tripod_doe.errors import InputError
from tripod_doe.names import check_identifier
from tripod_doe.study.definition.complaints import complaints
from tripod_doe.study.definition.toml_text import parse_toml

Scalar = Annotated[Annotated[float, AllowInfNan(True)] | int | str | bool, Field(union_mode="smart")]
"""A value that its parameter checks."""


def _no_boolean(value: object) -> object:
    if isinstance(value, bool):
        raise PydanticCustomError("float_type", "expected a number")
    return value


NO_BOOLEAN = BeforeValidator(_no_boolean)
"""Refuses true where 1 is allowed, which is equal."""

DesignKind = Literal[
    "grid",
    "zip",
    "one-at-a-time",
    "table",
    "latin-hypercube",
    "sobol",
    "halton",
    "saltelli",
    "morris",
    "fast",
    "rbd-fast",
    "finite-differences",
    "full-factorial",
    "fractional-factorial",
    "plackett-burman",
    "central-composite",
    "box-behnken",
    "multifidelity",
    "ablation",
    "product",
]


class Table(BaseModel):
    """A table of a TOML file with strict types: numbers, texts and booleans are never converted."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class StudyTable(Table):
    """[study]: the question, and the scene or function that answers it."""

    name: str = Field(min_length=1, max_length=200, description="short name of the study")
    question: str = Field("", max_length=4_000, description="the question it answers; the report shows it")
    scene: str = Field("joint", description="scene that is simulated")
    function: str | None = Field(None, description="package.module:function to run in place of a scene")


class FactorTable(Table):
    """[factors.PARAMETER]: values, a range with a count, a range to sample, or a distribution."""

    values: list[Scalar] | None = Field(None, description="the values it takes")
    low: float | None = Field(None, description="lower end of the range")
    high: float | None = Field(None, description="upper end of the range")
    count: int | None = Field(None, ge=1, le=1_000_000, description="number of values from low to high, ends included")
    scale: Literal["linear", "log"] = Field("linear", description="spacing of the values or samples from low to high")
    distribution: Literal["uniform", "normal", "truncated-normal", "log-uniform", "triangular", "discrete"] | None = (
        Field(None, description="distribution of a sampled factor; uniform on its scale if omitted")
    )
    mean: float | None = Field(None, description="mean of a normal distribution")
    std: float | None = Field(None, gt=0, description="standard deviation of a normal distribution")
    mode: float | None = Field(None, description="peak of a triangular distribution")
    weights: list[float] | None = Field(
        None, description="relative frequencies of the values of a discrete distribution"
    )
    group: str | None = Field(None, description="saltelli, morris: factors of one group are varied together")

    @property
    def sampled_as(self) -> str:
        """Its distribution where a design samples it: uniform if omitted, log-uniform on a logarithmic scale."""
        return self.distribution or ("log-uniform" if self.scale == "log" else "uniform")


_MOST_LEVELS = 1_000_000
"""Largest number of levels of a design, as of a factor's count."""


class DesignTable(Table):
    """[design]: how the points are made from the factors."""

    kind: DesignKind = Field("grid", description="kind of design")
    samples: int | None = Field(
        None,
        ge=1,
        description="number of samples (saltelli: SALib's N; morris: trajectories; fast: points of a curve; "
        "multifidelity: samples of the most expensive model)",
    )
    seed: int = Field(0, ge=0, description="seed of the random numbers")
    levels: int | None = Field(
        None,
        ge=2,
        le=_MOST_LEVELS,
        description="morris: levels, 4 if omitted; full-factorial: levels from low to high, 2 if omitted",
    )
    scramble: bool = Field(True, description="sobol, halton: whether the sequence is scrambled")
    correlation: list[list[str | float]] | dict[str, dict[str, float]] = Field(
        [], description="sampled designs: rank correlations, [factor, factor, value] each, or the whole matrix"
    )
    resolution: int | None = Field(
        None, ge=3, le=8, description="fractional-factorial: smallest resolution, 4 if omitted; its aliases are stated"
    )
    star: Literal["circumscribed", "inscribed", "faced"] = Field(
        "circumscribed", description="central-composite: its stars lie beyond low and high, on them, or on faces"
    )
    second_order: bool = Field(True, description="saltelli: whether the points for second-order indices are added")
    table: str | None = Field(None, description="CSV file with one column per factor, relative to the study file")
    constraints: list[str] = Field([], description="conditions on the factors that every point must meet")
    fidelity: str = Field("model", description="multifidelity: factor that names the model, the truth last")
    indices: bool = Field(True, description="multifidelity: whether the points for Sobol' indices are added")
    pilot: int | None = Field(
        None, ge=16, description="multifidelity: samples that all models run first, 24 or all samples if omitted"
    )
    most_points: int | None = Field(
        None,
        ge=1,
        description="multifidelity: points of all models together that a split from the pilot may have; 200,000 if "
        "omitted, or ten times the samples of the most expensive model if that is more",
    )
    target: list[str] = Field(
        [], description="multifidelity: OUTPUT or OUTPUT_ORDER whose variance the split minimises; all if omitted"
    )
    split: dict[str, Annotated[int, Field(ge=0)]] = Field(
        {}, description="multifidelity: samples of each model; from the pilot if omitted"
    )
    prices: dict[str, Annotated[float, Field(gt=0)]] = Field(
        {}, description="multifidelity: CPU seconds of a point with each model; counted in the pilot if omitted"
    )
    combinations: Literal["all", "single"] = Field(
        "all", description="ablation: all combinations of the switches, or single: all on, none, each off, each alone"
    )
    halved: bool = Field(False, description="ablation: also one point per switch with its friction halved")
    of: list[str] = Field([], description="product: names of the sub-designs [design.NAME]")
    factors: list[str] | None = Field(
        None, description="the factors that a sub-design varies; ablation: its switches, all of the scene if omitted"
    )


_SAMPLED = ("samples", "seed")
DESIGN_KEYS: Mapping[str, tuple[str, ...]] = {
    "grid": (),
    "zip": (),
    "one-at-a-time": (),
    "table": ("table",),
    "sobol": (*_SAMPLED, "scramble"),
    "halton": (*_SAMPLED, "scramble"),
    "latin-hypercube": _SAMPLED,
    "saltelli": (*_SAMPLED, "second_order"),
    "morris": (*_SAMPLED, "levels"),
    "fast": _SAMPLED,
    "rbd-fast": _SAMPLED,
    "finite-differences": ("samples",),
    "full-factorial": ("levels",),
    "fractional-factorial": ("resolution",),
    "plackett-burman": (),
    "central-composite": ("star",),
    "box-behnken": (),
    "multifidelity": (*_SAMPLED, "fidelity", "indices", "pilot", "most_points", "target", "split", "prices"),
    "ablation": ("combinations", "halved"),
    "product": ("of",),
}
"""Keys of [design] that each kind reads alone."""


def keys_read_by(kind: str) -> set[str]:
    """Keys of [design] that a kind of design may have."""
    return {"kind", "constraints", "correlation", *DESIGN_KEYS[kind], *(["factors"] if kind != "product" else [])}


class KeepTable(Table):
    """[keep]: the outputs in the cube."""

    outputs: list[str] = Field([], description="names of the outputs; if omitted, all but those on request")


class ResponseTable(Table):
    """[responses.NAME]: a variable of the cube that follows from outputs by a formula."""

    formula: str = Field(
        min_length=1,
        max_length=4_000,
        description="expression over outputs, as max(abs(thrust)) or thrust_amplitude[3]",
    )
    unit: str = Field("1", max_length=60, description="unit of its value, 1 without dimension")
    meaning: str = Field("", max_length=300, description="what it is, in a few words; the formula if omitted")


class RunTable(Table):
    """[run]: how the points are run; only `retry` changes values."""

    block: int | None = Field(None, ge=1, description="points per task; sized by their cost if omitted")
    exclusive: bool = Field(False, description="run one block at a time, so that no other block disturbs its timing")
    expected_outcomes: list[str] = Field([], description="outcomes besides finished that do not count as failures")
    look_for: str | None = Field(
        None,
        min_length=1,
        max_length=1_000,
        description="condition as query --where takes it; the run states the points that meet it, as --notify does",
    )
    retry: list[str | dict[str, Scalar]] = Field(
        [],
        description='changes tried in this order, each on top of those before, on points that failed: "smaller-step" '
        "(half the step or tolerance) or a table of model, method or numerics to set",
    )


class AccuracyTable(Table):
    """[accuracy]: OUTPUT_ORDER = relative error, to which runs are refined, or by which model = "auto" chooses."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, float]

    confidence: float = Field(
        0.9, ge=0.5, le=0.99, description='with model = "auto": share of the points in which the accuracy must be met'
    )
    floor: float = Field(
        0.01,
        gt=0,
        lt=1,
        description="share of the largest order of a point; the error of a smaller order is relative to that share",
    )
    budget_cpu_s: float | None = Field(
        None,
        gt=0,
        description='with model = "auto": largest estimated price of pilot and study; above it nothing is started (s)',
    )


class StudyFile(Table):
    """A whole study file."""

    study: StudyTable
    base: dict[str, Scalar] = Field({}, description="values of parameters that all points share")
    factors: dict[str, FactorTable] = Field({}, description="what is varied")
    design: DesignTable = DesignTable()
    designs: dict[str, DesignTable] = Field({}, description="sub-designs, written [design.NAME]")
    responses: dict[str, ResponseTable] = Field({}, description="variables by formula: [responses.NAME]")
    keep: KeepTable = KeepTable()
    run: RunTable = RunTable()
    accuracy: AccuracyTable | None = Field(
        None,
        description='allowed relative errors, OUTPUT_ORDER = error: numerical; with model = "auto", of the model too',
    )
    analysis: dict[str, dict[str, Any]] = Field({}, description="analyses of the cube: [analysis.NAME] with a kind")


_OTHER_FILES = {"workflow": "workflow", "fit": "fit", "optimisation": "optimise"}
"""Commands by the table that shows the kind of a file."""


def parse_file(text: str, origin: str = "study") -> StudyFile:
    """Parse the text of a study file without looking for its simulator: form is checked, parameters are not."""
    raw = parse_toml(text, origin)
    for head, command in _OTHER_FILES.items():
        if head in raw and "study" not in raw:
            kind = f"{'an' if head[0] in 'aeiou' else 'a'} {head}"
            raise InputError(f"{origin}: this is {kind}, not a study: `tripod-doe {command}` runs it")
    if "designs" in raw:
        raise InputError(f"{origin}: the file: unknown key 'designs'; a sub-design is written [design.NAME]")
    design = raw.get("design")
    if isinstance(design, dict):  # [design.NAME] are tables of their own
        own = DesignTable.model_fields
        parts = [key for key, value in design.items() if isinstance(value, dict) and key not in own]
        raw["designs"] = {key: design[key] for key in parts}
        raw["design"] = {key: value for key, value in design.items() if key not in parts}
    try:
        _check_names(raw)
    except InputError as error:
        raise error.at(origin) from error
    try:
        return StudyFile.model_validate(raw)
    except ValidationError as error:
        raise InputError("\n".join(f"{origin}: {line}" for line in complaints(error, StudyFile))) from error


def _check_names(raw: Mapping[str, Any]) -> None:
    """Refuse names of analyses and sub-designs that are not identifiers, since they name files."""
    for table, written, of in (("analysis", "analysis", "an analysis"), ("designs", "design", "a sub-design")):
        names = raw.get(table, {})
        for name in names if isinstance(names, Mapping) else ():
            check_identifier(name, f"{of}, written [{written}.NAME]")


TABLES: Mapping[str, type[Table]] = {
    "study": StudyTable,
    "factors.PARAMETER": FactorTable,
    "design": DesignTable,
    "responses.NAME": ResponseTable,
    "keep": KeepTable,
    "run": RunTable,
    "accuracy": AccuracyTable,
}
"""Tables with fixed keys, as they are written in a file; [base] holds parameters, [analysis.NAME] settings."""
