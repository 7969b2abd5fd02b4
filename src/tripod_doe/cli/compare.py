"""Compare a measurement with one point of a cube, or with the points over speed; or many records with a cube."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tripod_doe.cli.parser import (
    DONE,
    SOME_FAILED,
    Command,
    Parser,
    add_cube,
    add_format,
    add_selection,
    any_number,
    whole_number,
)
from tripod_doe.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from tripod_doe.analyses.comparison.record_comparison import ComparedRecord


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    add_cube(parser)
    parser.add_argument(
        "measurements",
        metavar="MEASUREMENT.csv",
        type=Path,
        nargs="*",
        help="table with thrust_n and rotation_deg, or thrust_n, time_s and tacho; several give an overview; joint "
        "angle, torque and speed that a record states choose its point",
    )
    parser.add_argument(
        "--table",
        metavar="RECORDS.csv",
        type=Path,
        help="table of records: a column file, and one for each parameter that differs; points that the cube lacks are "
        "simulated",
    )
    add_selection(parser, "value of a factor, to select one point, or the points over speed_rpm")
    parser.add_argument(
        "--column",
        metavar="NAME=HEADING",
        action="append",
        default=[],
        help="the column that is thrust_n, rotation_deg, time_s, tacho, joint_angle_deg, torque_n_m or speed_rpm, with "
        "its unit in brackets behind it where the file has none; no HEADING: this column is not used; may be repeated",
    )
    parser.add_argument(
        "--pulses-per-revolution",
        metavar="N",
        type=whole_number,
        help="rising edges of tacho per revolution; if omitted, they are inferred and stated",
    )
    parser.add_argument(
        "--pattern",
        metavar="NAME",
        help="names of the files with fields for parameters, for instance rig_{joint_angle_deg}deg_{torque_n_m}Nm.csv",
    )
    parser.add_argument(
        "--sign",
        type=whole_number,
        choices=(1, -1),
        default=1,
        help="-1 where the force is positive away from the intermediate shaft",
    )
    parser.add_argument(
        "--reference-angle",
        metavar="DEG",
        type=any_number,
        help="rotation angle of the housing at the first rising edge, or at rotation_deg = 0; "
        "if omitted, the measurement is aligned by the phase of its third order",
    )
    parser.add_argument("--speeds", metavar="LOW:HIGH", help="use only revolutions within this range of speed, rpm")
    add_format(parser)
    parser.add_argument(
        "--out",
        "--output",
        dest="out",
        metavar="DIR|FILE.html",
        type=Path,
        help="write DIR/index.html and DIR/overview.csv, with DIR/comparison.nc for one record and a page for each of "
        "several; for one record also the page alone, as FILE.html",
    )


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.analyses.comparison.comparison import parse_speeds
    from tripod_doe.analyses.comparison.overview import compare_records, read_table
    from tripod_doe.analyses.comparison.record_comparison import Reading, compare_record
    from tripod_doe.analyses.comparison.record_point import RecordRow
    from tripod_doe.measurements.headings import parse_column
    from tripod_doe.study.result_directory.open_cube import opened_study

    rows = [RecordRow(path) for path in options.measurements]
    rows += read_table(options.table) if options.table else []
    if not rows:
        raise InputError("no record to compare: name files, or a --table of them")
    reading = Reading(
        dict(map(parse_column, options.column)),
        options.pulses_per_revolution,
        options.pattern,
        options.sign,
        options.reference_angle,
        parse_speeds(options.speeds),
    )
    with opened_study(options.cube) as cube:
        if options.measurements and len(rows) == 1:
            return _show_one(options, compare_record(cube, rows[0], reading, options.select, options.nearest))
        return _show_many(options, compare_records(cube, rows, reading, options.select, options.nearest), cube)


def _show_one(options: argparse.Namespace, record: ComparedRecord) -> int:
    from tripod_doe.analyses.comparison.page import write_record
    from tripod_doe.analyses.comparison.sentences import comparison_json, comparison_text

    if record.comparison is None:
        raise InputError(record.problem)
    print(comparison_json(record.comparison) if options.format == "json" else comparison_text(record.comparison))
    if options.out is not None:
        print(f"report  {write_record(record, options.out)}", file=sys.stderr)
    return DONE


def _show_many(options: argparse.Namespace, records: list[ComparedRecord], cube: xr.Dataset) -> int:
    from tripod_doe.analyses.comparison.overview import overview_json, overview_rows
    from tripod_doe.analyses.comparison.page import is_page, overview_text, write_overview

    if options.out is not None and is_page(options.out):
        raise InputError(f"--out {options.out}: several records have a page each: name a folder")
    print(overview_json(overview_rows(records)) if options.format == "json" else overview_text(records))
    if options.out is not None:
        study = str(cube.attrs.get("title", options.cube))
        print(f"report  {write_overview(records, study, options.out)}", file=sys.stderr)
    return SOME_FAILED if any(record.problem for record in records) else DONE


COMMAND = Command("compare measurements with points of a cube", _add_arguments, _run)
