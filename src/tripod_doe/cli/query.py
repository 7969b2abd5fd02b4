"""Select values of a cube and print them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_cube, add_selection
from tripod_doe.errors import InputError


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
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


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.simulator import Trust
    from tripod_doe.study.query.arrays import opened_arrays
    from tripod_doe.study.query.query import answer_format, records, records_text, unmet

    form = answer_format(options.format, options.output)
    if form == "netcdf":
        return _query_netcdf(options)
    with opened_arrays(options.cube) as cube:
        columns = records(cube, options.variable, options.select, options.nearest, options.where)
        for note in cube.model_notes[:1]:  # the verdict; the report has its grounds
            if Trust.DOUBTFUL.label in note:
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
    from tripod_doe.study.cube.netcdf import write_dataset
    from tripod_doe.study.query.query import narrowed, query

    if options.output is None:
        raise InputError("--format netcdf needs --output FILE")
    answer = query(options.cube, options.variable, options.select, options.nearest, options.where)
    write_dataset(narrowed(answer), options.output)
    return DONE


COMMAND = Command("select values of a cube and print them", _add_arguments, _run)
