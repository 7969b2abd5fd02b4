"""The command diff."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_format


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    for name in ("A", "B"):
        parser.add_argument(name.lower(), metavar=name, type=Path, help="result directory, cube (.nc) or study file")
    parser.add_argument(
        "--variable",
        metavar="NAME",
        action="append",
        default=[],
        help="variable to compare (default: all but phases and curves); may be repeated",
    )
    add_format(parser, "csv")


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.analyses.diff.diff import diff
    from tripod_doe.analyses.diff.sentences import diff_csv, diff_json, diff_text

    differences = diff(options.a, options.b, options.variable)
    print({"table": diff_text, "csv": diff_csv, "json": diff_json}[options.format](differences))
    return DONE


COMMAND = Command("list what differs between two studies, and between their results", _add_arguments, _run)
