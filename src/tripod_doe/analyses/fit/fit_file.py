"""The form of a fit file: its tables and keys, with errors that name table, key and value."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from tripod_doe.errors import near_match
from tripod_doe.study.definition.study_file_schema import NO_BOOLEAN, Scalar, Table
from tripod_doe.study.definition.table_file import TableFile, read_table_file


class HeadTable(Table):
    """[fit]: name, question, and how the fit is made."""

    name: str = Field(min_length=1, max_length=200, description="short name of the fit")
    question: str = Field("", max_length=4_000, description="the question it answers; the report shows it")
    starts: int = Field(3, ge=1, le=100, description="starting points of the search")
    seed: int = Field(0, ge=0, description="seed of the starting points")
    robust: bool = Field(True, description="whether records that do not fit the others are left out, and named")
    model_error: Literal["recorded"] | float = Field(
        "recorded", description="relative error of the model's orders: recorded for similar points, or a number"
    )
    look_for: str | None = Field(
        None,
        min_length=1,
        max_length=1_000,
        description="condition as query --where takes it, on value, low, high, verdict and unknown; the run states the "
        "unknowns that meet it, as --notify does",
    )


class UnknownTable(Table):
    """[unknowns.PARAMETER]: the range of an unknown, and which records share its value."""

    low: float = Field(description="lower bound")
    high: float = Field(description="upper bound")
    scale: Literal["linear", "log"] = Field("linear", description="scale on which the range is searched")
    per: str = Field("all", description="records that share a value: all, record (each its own), or a column")
    mean: float | None = Field(None, description="expected value, where something is known before; with std")
    std: float | None = Field(None, gt=0, description="standard deviation of what is known before")


class RecordsTable(Table):
    """[records]: the measured records, and what of them is fitted."""

    files: list[str] = Field([], description="files or patterns, relative to the fit file")
    table: str | None = Field(None, description="CSV file with the column file, and a column per value that differs")
    orders: list[int] = Field([2, 3], min_length=1, description="rotating orders that are fitted")
    waveform: bool = Field(False, description="fit the orders 1 to 12, which are the waveform without its mean")
    columns: dict[str, str] = Field({}, description="headings of the files by our names of the columns")
    pattern: str | None = Field(None, description="names of the files with fields, rig_{joint_angle_deg}deg.csv")
    pulses_per_revolution: int | None = Field(
        None, ge=1, description="rising edges of tacho per revolution; inferred if omitted"
    )
    reference_angle_deg: float | None = Field(None, description="housing's rotation angle at the zero of the records")
    sign: Annotated[Literal[1, -1, "free"], NO_BOOLEAN] = Field(
        1, description="sign of the force; free if it is not known"
    )
    force_scale_error: float = Field(0.0, ge=0, lt=1, description="relative uncertainty of the force sensor's scale")


class CandidateTable(Table):
    """[next.at.PARAMETER]: values of an operating parameter."""

    values: list[Scalar] = Field(min_length=1, description="the values it takes")


class NextTable(Table):
    """[next]: operating points that could be measured next, and the unknown that they are to narrow."""

    narrow: str | None = Field(None, description="the unknown; the least known one if omitted")
    within: float = Field(0.05, gt=0, description="half width of its interval, relative, that is aimed at")
    at: dict[str, CandidateTable] = Field({}, description="operating parameters, whose grid is taken")
    table: str | None = Field(None, description="CSV file of operating points, in place of a grid")


class FitFile(Table):
    """A whole fit file."""

    fit: HeadTable
    base: dict[str, Scalar] = Field({}, description="values that are known and that all records share")
    unknowns: dict[str, UnknownTable] = Field(min_length=1, description="what is fitted")
    records: RecordsTable
    next: NextTable | None = None

    @property
    def orders(self) -> list[int]:
        """The orders that are fitted, ascending."""
        return list(range(1, 13)) if self.records.waveform else sorted(set(self.records.orders))


UNKNOWN_COLUMNS = ("unknown", "value", "low", "high", "verdict", "bound_low", "bound_high")
"""What the result of a fit says of each unknown."""

FitRequest = TableFile[FitFile]


def load_fit(path: str | Path, untrusted: bool = False) -> FitRequest:
    """Read and check the form of a fit file.

    Raises:
        InputError: If it cannot be read, or a table, key or value in it is wrong.
    """
    request = read_table_file(path, FitFile, "fit", untrusted)
    _check(request)
    return request


def _check(request: FitRequest) -> None:
    """Refuse tables whose keys contradict each other."""
    file = request.file
    if bool(file.records.files) == bool(file.records.table):
        raise request.fail("[records]", 'give either files = ["rig/*.csv"] or table = "records.csv"')
    if file.records.waveform and "orders" in file.records.model_fields_set:
        raise request.fail("[records]", "orders and waveform = true: give one of them")
    if wrong := [order for order in file.records.orders if not 1 <= order <= 12]:
        raise request.fail("[records]", f"orders = {wrong}: rotating orders are 1 to 12")
    if isinstance(file.fit.model_error, float) and not 0 <= file.fit.model_error < 1:
        raise request.fail("[fit]", f"model_error = {file.fit.model_error:g}: must be at least 0 and below 1")
    request.check_condition("[fit]: look_for", file.fit.look_for, UNKNOWN_COLUMNS)
    for name, table in file.unknowns.items():
        where = f"[unknowns.{name}]"
        if table.low >= table.high:
            raise request.fail(where, f"low = {table.low:g} must be below high = {table.high:g}")
        for key, value in (("low", table.low), ("mean", table.mean)):
            if table.scale == "log" and value is not None and value <= 0:
                raise request.fail(where, f'{key} = {value:g}: must be above 0 with scale = "log"')
        if (table.mean is None) != (table.std is None):
            raise request.fail(where, "mean and std belong together: give both, or neither")
        if name in file.base:
            raise request.fail(where, f"{name} is also a base value; remove it from [base]")
    if file.next:
        _check_next(request, file.next)


def _check_next(request: FitRequest, table: NextTable) -> None:
    unknowns = request.file.unknowns
    if bool(table.at) == bool(table.table):
        raise request.fail("[next]", "give either [next.at.PARAMETER] with values, or table = a CSV file")
    if table.narrow is not None and table.narrow not in unknowns:
        raise request.fail("[next]", f"narrow = {table.narrow!r}: not an unknown{near_match(table.narrow, unknowns)}")
    if both := [name for name in table.at if name in unknowns]:
        raise request.fail(f"[next.at.{both[0]}]", "it is an unknown; candidates set what is known")


def fit_schema() -> dict[str, Any]:
    """JSON Schema of fit files."""
    return FitFile.model_json_schema()
