"""One record compared with its point of a cube: by command, on the page, and as a step of a workflow alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import xarray as xr
from pydantic import Field

from tripod_doe.analyses.comparison.comparison import compare
from tripod_doe.analyses.comparison.model_point import refuse_other_units
from tripod_doe.analyses.comparison.record_point import RecordRow, overruled, point_of_record, with_stated_values
from tripod_doe.analyses.kinds import is_study, makes_kind
from tripod_doe.errors import InputError
from tripod_doe.measurements.measurement import read_measurement
from tripod_doe.study.definition.study_file_schema import NO_BOOLEAN, Table
from tripod_doe.study.definition.study_folder import StudyFolder


@dataclass(frozen=True)
class ComparedRecord:
    """A record next to the model; a record that cannot be compared has the reason alone."""

    row: RecordRow
    comparison: xr.Dataset | None = None  # see `compare`
    simulated: bool = False  # whether the cube lacks its point
    replaced: str = ""  # what the nearest point has in place of the values of the record, as a sentence
    problem: str = ""

    @property
    def name(self) -> str:
        """Name of its file."""
        return self.row.path.name


@dataclass(frozen=True)
class Reading:
    """How records are read and aligned: what `read_measurement` and `compare` take."""

    columns: Mapping[str, str] | None = None
    pulses_per_revolution: int | None = None
    pattern: str | None = None
    sign: float = 1.0
    reference_angle_deg: float | None = None
    speeds_rpm: tuple[float, float] | None = None
    confidence: float = 0.95


def compare_record(
    cube: xr.Dataset, row: RecordRow, reading: Reading, select: Sequence[str] = (), nearest: bool = False
) -> ComparedRecord:
    """Compare a record with the model at its operating point, see `point_of_record` and `compare`.

    What the record states of its operating point counts where neither its row nor the selection names it.

    Raises:
        CubeError: If the cube is in other units.
        InputError: If the record cannot be read or compared.
    """
    refuse_other_units(cube)
    speed = row.values.get("speed_rpm")
    known_speed = None if speed is None else float(speed)
    measurement = read_measurement(
        row.path, reading.pulses_per_revolution, reading.columns, reading.pattern, known_speed, reading.sign
    )
    doubt = overruled(row, measurement, select)
    row = with_stated_values(cube, row, measurement, select)
    chosen = point_of_record(cube, row, select, nearest)
    comparison = compare(measurement, chosen.point, reading.reference_angle_deg, reading.speeds_rpm, reading.confidence)
    place = ", ".join(f"{name} = {value:.6g}" for name, value in row.values.items() if isinstance(value, float | int))
    lacking = f"The cube lacks the point of this record ({place}), which was simulated." if chosen.simulated else ""
    remarks = "\n".join(filter(None, [doubt, lacking, chosen.replaced, str(comparison.attrs["remarks"])]))
    return ComparedRecord(row, comparison.assign_attrs(remarks=remarks), chosen.simulated, chosen.replaced)


class ComparisonSettings(Table):
    """Settings of a comparison as a step of a workflow."""

    measurement: str = Field(description="CSV file of the measurement, relative to the workflow file")
    select: list[str] = Field([], description="name=value of each factor, so that one point is left")
    nearest: bool = Field(False, description="take the nearest value where none matches")
    pulses_per_revolution: int | None = Field(
        None, ge=1, description="rising edges of tacho per revolution; inferred if omitted"
    )
    sign: Annotated[Literal[1, -1], NO_BOOLEAN] = Field(
        1, description="-1 where the force is positive away from the intermediate shaft"
    )
    columns: dict[str, str] = Field({}, description="headings of the file by our names of the columns")
    reference_angle_deg: float | None = Field(None, description="housing's rotation angle at the measurement's zero")
    speeds_rpm: Annotated[tuple[float, float], Field(strict=False)] | None = Field(
        None, description="range of the speeds that are compared"
    )
    confidence: float = Field(0.95, gt=0, lt=1, description="level of the uncertainties")


@makes_kind("comparison")
def compare_file(cubes: Mapping[str, xr.Dataset], settings: ComparisonSettings, folder: StudyFolder) -> xr.Dataset:
    """Compare a measurement's file with its point of the one cube that is given; see `compare_record`.

    Raises:
        InputError: If there is not one cube, or point and measurement cannot be compared.
    """
    cube, *others = cubes.values()
    if others or not is_study(cube):
        raise InputError(f"a comparison needs one study step as its input, not {', '.join(cubes)}")
    reading = Reading(
        settings.columns,
        settings.pulses_per_revolution,
        sign=settings.sign,
        reference_angle_deg=settings.reference_angle_deg,
        speeds_rpm=settings.speeds_rpm,
        confidence=settings.confidence,
    )
    row = RecordRow(folder.file(settings.measurement, "measurement"))
    comparison = compare_record(cube, row, reading, settings.select, settings.nearest).comparison
    assert comparison is not None
    return comparison
