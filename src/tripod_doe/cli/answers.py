"""Commands that answer: query, simulate, compare."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tripod_doe.cli.parser import (
    DONE,
    SOME_FAILED,
    Command,
    Parser,
    add_cube,
    add_format,
    add_selection,
)
from tripod_doe.errors import InputError

if TYPE_CHECKING:
    from tripod_doe.simulator import Parameter, Simulator


_LONG = 1.0  # CPU seconds of a point from which on its price is told before it is simulated


def _add_query(parser: Parser, arguments: Sequence[str]) -> None:
    add_cube(parser)
    parser.add_argument("--variable", metavar="NAME", required=True, help="variable to print")
    add_selection(parser, "a value, a list a,b,c or a range a:b of a coordinate")
    parser.add_argument("--where", metavar="EXPR", help="condition on coordinates, variables and outcome")
    parser.add_argument(
        "--format",
        choices=("table", "json", "csv", "netcdf"),
        help="output format (default: as --output is named, else table)",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="write to this file instead of standard output; its ending decides the format: .csv, .json, .nc or .txt",
    )


def _add_simulate(parser: Parser, arguments: Sequence[str]) -> None:
    """The parameters of the scene are flags; they are added only where `simulate` is called, as they take imports."""
    scene = parser.add_argument("--scene", default="joint", metavar="S")
    scene.help = "what to simulate (default joint)"
    add_format(parser)
    if "simulate" in arguments[:1]:
        from tripod_doe.study.scenes import SCENES, load_simulator

        scene.help = f"what to simulate: {', '.join(SCENES)} (default joint)"
        _add_parameters(parser, load_simulator(_scene_named_in(arguments)))


def _add_compare(parser: Parser, arguments: Sequence[str]) -> None:
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


def _scene_named_in(arguments: Sequence[str]) -> str:
    """The scene decides which flags exist, so it is looked for before they are parsed."""
    finder = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    finder.add_argument("--scene", default="joint")
    return str(finder.parse_known_args(list(arguments))[0].scene)


def _add_parameters(parser: argparse.ArgumentParser, simulator: Simulator) -> None:
    groups: dict[str, Any] = {}
    for parameter in simulator.parameters.values():
        group = groups.setdefault(parameter.group, parser.add_argument_group(parameter.group))
        text = f"{parameter.meaning} ({parameter.unit_text + '; ' if parameter.unit_text else ''}{parameter.range_text}"
        text += f"; default {parameter.default}" if parameter.default is not None else ""
        group.add_argument(
            "--" + parameter.name.replace("_", "-"),
            dest=parameter.name,
            metavar=parameter.symbol or "VALUE",
            help=text.replace("%", "%%") + f"; {parameter.source})",
        )


def _parameter_value(parameter: Parameter, text: str) -> Any:
    if parameter.kind == "choice":
        return text
    try:
        return float(text)
    except ValueError as error:
        raise InputError(
            f"--{parameter.name.replace('_', '-')} {text!r}: expected a number ({parameter.range_text})"
        ) from error


def _query(options: argparse.Namespace) -> int:
    from tripod_doe.study.arrays import opened_arrays
    from tripod_doe.study.query import answer_format, records, records_text, unmet

    form = answer_format(options.format, options.output)
    if form == "netcdf":
        return _query_netcdf(options)
    with opened_arrays(options.cube) as cube:
        columns = records(cube, options.variable, options.select, options.nearest, options.where)
        for note in cube.model_notes:
            print(note, file=sys.stderr)
        if columns[options.variable].size == 0:
            print(unmet(cube, options.select), file=sys.stderr)
    text = records_text(columns, form)
    if options.output is None:
        print(text)
        return DONE
    try:
        options.output.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"--output {options.output}: cannot write: {error.strerror}") from error
    return DONE


def _query_netcdf(options: argparse.Namespace) -> int:
    from tripod_doe.study.netcdf import write_dataset
    from tripod_doe.study.query import narrowed, query

    if options.output is None:
        raise InputError("--format netcdf needs --output FILE")
    answer = query(options.cube, options.variable, options.select, options.nearest, options.where)
    write_dataset(narrowed(answer), options.output)
    return DONE


def _simulate(options: argparse.Namespace) -> int:
    from tripod_doe.quantities import duration
    from tripod_doe.simulator import Outcome
    from tripod_doe.study.point_table import point_table
    from tripod_doe.study.scenes import load_simulator
    from tripod_doe.study.simulate import simulate_point, usual_price

    simulator = load_simulator(options.scene)
    given = {
        name: _parameter_value(parameter, getattr(options, name))
        for name, parameter in simulator.parameters.items()
        if getattr(options, name) is not None
    }
    price = usual_price(options.scene, **given)
    if price is not None and price >= _LONG:
        usual = f"about {duration(price, 2)} of CPU time for a usual point, up to twenty times as much for others"
        print(f"simulating: {usual}", file=sys.stderr)
    point = simulate_point(options.scene, **given)
    print(json.dumps(point.record(), allow_nan=False) if options.format == "json" else point_table(point))
    return DONE if point.outcome is Outcome.FINISHED else SOME_FAILED


def _compare(options: argparse.Namespace) -> int:
    from tripod_doe.analysis.compared_point import model_point
    from tripod_doe.analysis.comparison import compare, parse_speeds
    from tripod_doe.analysis.measurement import read_measurement
    from tripod_doe.analysis.record_file import parse_column
    from tripod_doe.report.comparison import comparison_json, comparison_text
    from tripod_doe.report.comparison_page import write_comparison
    from tripod_doe.study.results import opened_cube

    if options.reference_angle is not None and not math.isfinite(options.reference_angle):
        raise InputError(f"--reference-angle {options.reference_angle}: must be a finite angle in degrees")
    with opened_cube(options.cube) as cube:
        point = model_point(cube, options.select, options.nearest).load()
    columns = dict(map(parse_column, options.column))
    measurement = read_measurement(options.measurement, options.pulses_per_revolution, columns)
    comparison = compare(measurement, point, options.reference_angle, parse_speeds(options.speeds))
    print(comparison_json(comparison) if options.format == "json" else comparison_text(comparison))
    if options.output is not None:
        print(f"report  {write_comparison(comparison, options.output)}", file=sys.stderr)
    return DONE


COMMANDS = {
    "query": Command("select values of a cube and print them", _add_query, _query),
    "simulate": Command("simulate one point", _add_simulate, _simulate),
    "compare": Command("compare a measurement with one point, or with the points over speed", _add_compare, _compare),
}
