"""Compare a measurement with one point of a cube, or with the points over speed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_cube, add_format, add_selection


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    add_cube(parser)
    parser.add_argument(
        "measurement",
        metavar="MEASUREMENT.csv",
        type=Path,
        help="table with thrust_n and rotation_deg, or thrust_n, time_s and tacho",
    )
    add_selection(parser, "the value of a factor, so that one point is left, or the points over speed_rpm")
    parser.add_argument(
        "--column",
        metavar="NAME=HEADING",
        action="append",
        default=[],
        help="the column that is thrust_n, rotation_deg, time_s or tacho; may be repeated",
    )
    parser.add_argument(
        "--pulses-per-revolution",
        metavar="N",
        type=int,
        default=1,
        help="rising edges of tacho per revolution (default 1)",
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


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.analyses.comparison.comparison import compare, parse_speeds
    from tripod_doe.analyses.comparison.measurement import read_measurement
    from tripod_doe.analyses.comparison.model_point import model_point
    from tripod_doe.analyses.comparison.page import write_comparison
    from tripod_doe.analyses.comparison.record_file import parse_column
    from tripod_doe.analyses.comparison.sentences import comparison_json, comparison_text
    from tripod_doe.study.results.result_cube import opened_cube

    with opened_cube(options.cube) as cube:
        point = model_point(cube, options.select, options.nearest).load()
    columns = dict(map(parse_column, options.column))
    measurement = read_measurement(options.measurement, options.pulses_per_revolution, columns)
    comparison = compare(measurement, point, options.reference_angle, parse_speeds(options.speeds))
    print(comparison_json(comparison) if options.format == "json" else comparison_text(comparison))
    if options.output is not None:
        print(f"report  {write_comparison(comparison, options.output)}", file=sys.stderr)
    return DONE


COMMAND = Command("compare a measurement with one point, or with the points over speed", _add_arguments, _run)
