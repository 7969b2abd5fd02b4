"""The form of an optimisation file: its tables and keys, with errors that name table, key and value."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from tripod_doe.errors import InputError
from tripod_doe.names import check_identifier
from tripod_doe.study.definition.study_file_schema import FactorTable, ResponseTable, Scalar, Table
from tripod_doe.study.definition.table_file import TableFile, read_table_file


class HeadTable(Table):
    """[optimisation]: the question, what answers it, and how sure an answer must be under scatter."""

    name: str = Field(min_length=1, max_length=200, description="short name of the optimisation")
    question: str = Field("", max_length=4_000, description="the question it answers; the report shows it")
    scene: str = Field("joint", description="scene that is simulated")
    function: str | None = Field(None, description="package.module:function to run in place of a scene")
    quantile: float = Field(
        0.95, gt=0.5, lt=1, description="with [scatter]: share of the joints that an objective or limit must hold for"
    )
    look_for: str | None = Field(
        None,
        min_length=1,
        max_length=1_000,
        description="condition as query --where takes it, on front.nc; the run states the candidates of the front that "
        "meet it, as --notify does",
    )


class VariableTable(Table):
    """[variables.PARAMETER]: what may be chosen: a range, listed values, or what follows from others."""

    low: float | None = Field(None, description="lower bound")
    high: float | None = Field(None, description="upper bound")
    scale: Literal["linear", "log"] = Field("linear", description="scale on which the range is searched")
    values: list[Scalar] | None = Field(None, min_length=2, description="the values it may take")
    formula: str | None = Field(None, description="formula of other variables and base values that gives its value")


class AtTable(Table):
    """[at.PARAMETER]: values of an operating parameter; all combinations are operating points."""

    values: list[Scalar] = Field(min_length=1, description="the values it takes")


class ObjectiveTable(Table):
    """[objectives.NAME]: what is made as small or as large as possible."""

    output: str = Field(description="an output, a response or a parameter")
    order: int | None = Field(None, ge=0, description="rotating order, for an output over orders")
    over: Literal["max", "mean", "min"] = Field("max", description="which value over the operating points counts")
    goal: Literal["minimise", "maximise"] = Field("minimise", description="minimise or maximise")


class ConstraintTable(Table):
    """[constraints.NAME]: limits of an output, a response or a parameter."""

    output: str = Field(description="an output, a response or a parameter")
    order: int | None = Field(None, ge=0, description="rotating order, for an output over orders")
    over: Literal["max", "mean", "min"] | None = Field(
        None, description="which value over the operating points counts; the one nearest to its limit if omitted"
    )
    low: float | None = Field(None, description="smallest value allowed")
    high: float | None = Field(None, description="largest value allowed")


class SearchTable(Table):
    """[search]: how many candidates are tried, and how the last ones are confirmed."""

    evaluations: int = Field(2000, ge=1, le=10_000_000, description="candidates that the search tries")
    seed: int = Field(0, ge=0, description="seed of the search, and of the sample of the scatter")
    population: int | None = Field(
        None, ge=4, le=10_000, description="candidates of a generation; by their number if omitted"
    )
    confirm: str | None = Field(
        None, description="model that confirms the best candidates; the model of the search if omitted"
    )
    confirmed: int = Field(12, ge=1, le=1000, description="candidates that are confirmed, at most")
    samples: int = Field(64, ge=8, le=100_000, description="with [scatter]: joints in the sample of every candidate")
    confirm_samples: int = Field(256, ge=8, le=1_000_000, description="with [scatter]: joints in the other sample")


class OptimisationFile(Table):
    """A whole optimisation file."""

    optimisation: HeadTable
    base: dict[str, Scalar] = Field({}, description="values that all candidates share; where the search starts")
    variables: dict[str, VariableTable] = Field(min_length=1, description="what may be chosen")
    at: dict[str, Any] = Field({}, description="operating points: [at.PARAMETER] values, or table and weights")
    responses: dict[str, ResponseTable] = Field({}, description="variables by formula, as in a study")
    objectives: dict[str, ObjectiveTable] = Field(min_length=1, max_length=5, description="what is wanted")
    constraints: dict[str, ConstraintTable] = Field({}, description="limits")
    scatter: dict[str, FactorTable] = Field({}, description="distributions of what scatters: [scatter.PARAMETER]")
    search: SearchTable = SearchTable()


OptimisationRequest = TableFile[OptimisationFile]


def load_optimisation(path: str | Path, untrusted: bool = False) -> OptimisationRequest:
    """Read and check the form of an optimisation file.

    Raises:
        InputError: If it cannot be read, or a table, key or value in it is wrong.
    """
    request = read_table_file(path, OptimisationFile, "optimisation", untrusted)
    _check(request)
    return request


def _check(request: OptimisationRequest) -> None:
    """Refuse tables whose keys contradict each other, and names that stand twice."""
    file = request.file
    for name, variable in file.variables.items():
        where = f"[variables.{name}]"
        given = [variable.low is not None or variable.high is not None, bool(variable.values), bool(variable.formula)]
        if sum(given) != 1:
            raise request.fail(where, "give low and high, or values = [...], or a formula of others")
        if given[0] and (variable.low is None or variable.high is None or variable.low >= variable.high):
            raise request.fail(where, f"low = {variable.low} must be below high = {variable.high}")
        if "scale" in variable.model_fields_set and not given[0]:
            raise request.fail(where, "scale belongs to a range: leave it out, or give low and high")
        if variable.scale == "log" and (variable.low or 0) <= 0:
            raise request.fail(where, f'low = {variable.low}: must be above 0 with scale = "log"')
    if all(variable.formula for variable in file.variables.values()):
        raise request.fail("[variables]", "all have formulas of others; at least one needs a range or values")
    for name, constraint in file.constraints.items():
        if constraint.low is None and constraint.high is None:
            raise request.fail(f"[constraints.{name}]", "give low, high or both")
        if constraint.low is not None and constraint.high is not None and constraint.low > constraint.high:
            raise request.fail(f"[constraints.{name}]", f"low = {constraint.low:g} is above high = {constraint.high:g}")
    taken = dict.fromkeys(["candidate", "feasible", "reason", "generation", "knee", *file.variables])
    for table, names in (("objectives", file.objectives), ("constraints", file.constraints)):
        for name in names:
            where = f"[{table}.{name}]"
            try:
                check_identifier(name, f"what is written [{table}.NAME]")
            except InputError as error:
                raise request.fail(where, error) from error
            if name in taken or f"{name}_error" in taken:
                raise request.fail(where, "this name is taken by a variable, an objective or a constraint")
            taken |= dict.fromkeys((name, f"{name}_error"))
    aims = [f"{name}{end}" for name in (*file.objectives, *file.constraints) for end in ("", "_error", "_search")]
    request.check_condition("[optimisation]: look_for", file.optimisation.look_for, ["knee", *file.variables, *aims])
