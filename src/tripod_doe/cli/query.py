"""Select values of a cube and print them."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tripod_doe.cli.parser import DONE, Command, Parser, add_cube, add_selection
from tripod_doe.errors import InputError


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    add_cube(parser)
    parser.add_argument(
        "--variable",
        metavar="NAME",
        required=True,
        action="append",
        help="variable to print; may be repeated, for variables along the same dimensions",
    )
    add_selection(parser, "a value, a list a,b,c or a range a:b of a coordinate")
    parser.add_argument("--where", metavar="EXPR", help="condition on coordinates, variables and outcome")
    parser.add_argument(
        "--format",
        choices=("table", "json", "csv", "netcdf", "xlsx"),
        help="output format (default: as --output is named, else table)",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="write to this file instead of standard output; its ending decides the format: .csv, .json, .nc, "
        ".xlsx (with units, and a sheet that says where the numbers come from) or .txt",
    )
    parser.add_argument(
        "--decimal-comma",
        action="store_true",
        help="csv: decimal commas, and semicolons between columns, for spreadsheets with such a locale",
    )


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.files.atomic_files import replace_text
    from tripod_doe.files.checksum_list import JOURNAL
    from tripod_doe.model_interface import Trust
    from tripod_doe.study.query.query import analyses_with, answer_format, records, records_text, unmet
    from tripod_doe.study.result_directory.open_cube import FIT_FILE, opened_cube

    form = answer_format(options.format, options.output)
    if options.decimal_comma and form != "csv":
        raise InputError(f"--decimal-comma: the format is {form}; give --format csv")
    own = (".", "cube.nc", "cost.nc", FIT_FILE, JOURNAL)
    if options.output and options.output.resolve() in [(options.cube / name).resolve() for name in own]:
        raise InputError(f"--output {options.output}: this file holds the results that are read; choose another name")
    if form == "netcdf":
        return _query_netcdf(options)
    if form == "xlsx" and options.output is None:
        raise InputError("--format xlsx needs --output FILE")
    with opened_cube(options.cube) as cube:
        for name in options.variable:
            if name not in cube.data_vars and (files := analyses_with(options.cube, name)):
                raise InputError(f"--variable {name}: this variable is in {' and '.join(map(str, files))}")
        variable, *beside = options.variable
        columns = records(cube, variable, options.select, options.nearest, options.where, beside)
        notes = str(cube.attrs.get("model_notes", "")).splitlines()
        for note in notes[:1]:  # the verdict; the report gives the reasons
            if Trust.DOUBTFUL.label in note:
                print(note, file=sys.stderr)
        if columns[variable].size == 0:
            print(unmet(cube, options.select), file=sys.stderr)
    if form == "xlsx":
        return _write_workbook(options, columns)
    text = records_text(columns, form, options.decimal_comma)
    if options.output is None:
        print(text)
        return DONE
    replace_text(options.output, text + "\n")
    return DONE


def _query_netcdf(options: argparse.Namespace) -> int:
    from tripod_doe.study.cube.netcdf import write_dataset
    from tripod_doe.study.query.query import narrowed, query

    if options.output is None:
        raise InputError("--format netcdf needs --output FILE")
    variable, *beside = options.variable
    answer = query(options.cube, variable, options.select, options.nearest, options.where, beside)
    write_dataset(narrowed(answer), options.output)
    return DONE


def _write_workbook(options: argparse.Namespace, columns: dict[str, Any]) -> int:
    from tripod_doe.files.atomic_files import replace_file
    from tripod_doe.reports.workbook import answer_workbook

    asked = {"variable": ", ".join(options.variable), "select": ", ".join(options.select), "where": options.where or ""}
    data = answer_workbook(options.cube, columns, asked)
    with replace_file(options.output) as fresh:
        fresh.write_bytes(data)
    return DONE


COMMAND = Command("select values of a cube and print them", _add_arguments, _run)
