"""Compare a measurement with one point of a cube, or with the points over speed; or many records with a cube."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, SOME_FAILED, Command, Parser, add_cube, add_format, add_selection
from tripod_doe.errors import InputError


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
    add_selection(parser, "the value of a factor, so that one point is left, or the points over speed_rpm")
    parser.add_argument(
        "--column",
        metavar="NAME=HEADING",
        action="append",
        default=[],
        help="the column that is thrust_n, rotation_deg, time_s, tacho, joint_angle_deg, torque_n_m or speed_rpm, with "
        "its unit in brackets behind it where the file has none; may be repeated",
    )
    parser.add_argument(
        "--pulses-per-revolution",
        metavar="N",
        type=int,
        help="rising edges of tacho per revolution; if omitted, they are inferred and stated",
    )
    parser.add_argument(
        "--pattern",
        metavar="NAME",
        help="names of the files with fields for parameters, for instance rig_{joint_angle_deg}deg_{torque_n_m}Nm.csv",
    )
    parser.add_argument(
        "--sign",
        type=int,
        choices=(1, -1),
        default=1,
        help="-1 where the force is positive away from the intermediate shaft",
    )
    parser.add_argument(
        "--reference-angle",
        metavar="DEG",
        type=float,
        help="rotation angle of the housing at the first rising edge, or at rotation_deg = 0; "
        "if omitted, the measurement is aligned by the phase of its third order",
    )
    parser.add_argument("--speeds", metavar="LOW:HIGH", help="use only revolutions within this range of speed, rpm")
    add_format(parser)
    parser.add_argument(
        "--output",
        metavar="FILE|DIR",
        type=Path,
        help="write a report page: FILE.html, or DIR/index.html with DIR/comparison.nc",
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="write an overview: DIR/overview.csv, DIR/index.html, a page per record"
    )


def _run(options: argparse.Namespace) -> int:
    if options.table or options.out or len(options.measurements) != 1:
        return _run_many(options)
    from tripod_doe.analyses.comparison.comparison import compare, parse_speeds
    from tripod_doe.analyses.comparison.overview import RecordRow, point_of_record, with_stated_values
    from tripod_doe.analyses.comparison.page import write_comparison
    from tripod_doe.analyses.comparison.sentences import comparison_json, comparison_text
    from tripod_doe.analyses.records.headings import parse_column
    from tripod_doe.analyses.records.measurement import read_measurement
    from tripod_doe.study.results.result_cube import opened_cube

    path, columns = options.measurements[0], dict(map(parse_column, options.column))
    measurement = read_measurement(path, options.pulses_per_revolution, columns, options.pattern, sign=options.sign)
    with opened_cube(options.cube) as cube:
        row = with_stated_values(cube, RecordRow(path), measurement, options.select)
        point, simulated = point_of_record(cube, row, options.select, options.nearest)
    if simulated:
        print("the cube lacks the point of this record, which is simulated", file=sys.stderr)
    comparison = compare(measurement, point, options.reference_angle, parse_speeds(options.speeds))
    print(comparison_json(comparison) if options.format == "json" else comparison_text(comparison))
    if options.output is not None:
        print(f"report  {write_comparison(comparison, options.output)}", file=sys.stderr)
    return DONE


def _run_many(options: argparse.Namespace) -> int:
    from tripod_doe.analyses.comparison.comparison import parse_speeds
    from tripod_doe.analyses.comparison.overview import RecordRow, compare_records, overview_rows, read_table
    from tripod_doe.analyses.comparison.overview_page import overview_json, overview_text, write_overview
    from tripod_doe.analyses.records.headings import parse_column
    from tripod_doe.study.results.result_cube import opened_cube

    if options.output:
        raise InputError(f"--output {options.output}: for one measurement; an overview goes to --out DIR")
    rows = [RecordRow(path) for path in options.measurements]
    rows += read_table(options.table) if options.table else []
    if not rows:
        raise InputError("no record to compare: name files, or a --table of them")
    with opened_cube(options.cube) as cube:
        records = compare_records(
            cube,
            rows,
            options.select,
            dict(map(parse_column, options.column)),
            options.pulses_per_revolution,
            options.reference_angle,
            parse_speeds(options.speeds),
            options.pattern,
            options.sign,
            options.nearest,
        )
        study = str(cube.attrs.get("title", options.cube))
    print(overview_json(overview_rows(records)) if options.format == "json" else overview_text(records))
    if options.out is not None:
        print(f"report  {write_overview(records, study, options.out)}", file=sys.stderr)
    return SOME_FAILED if any(record.problem for record in records) else DONE


COMMAND = Command("compare measurements with points of a cube", _add_arguments, _run)
