"""Add responses to the results in a directory, or drop some."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_take_over


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory")
    parser.add_argument("file", metavar="FILE.toml", type=Path, nargs="?", help="file with tables [responses.NAME]")
    parser.add_argument(
        "--drop",
        metavar="NAME",
        action="append",
        default=[],
        help="remove this response from the study; may be repeated",
    )
    add_take_over(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.derive import derive

    summary = derive(options.directory, options.file, options.drop, options.take_over)
    for name, reason in summary.analyses.items():
        if reason:
            print(f"analysis {name} failed: {reason}", file=sys.stderr)
    print(f"cube    {summary.directory / 'cube.nc'}", file=sys.stderr)
    print(f"report  {summary.directory / 'report' / 'index.html'}", file=sys.stderr)
    return DONE


COMMAND = Command(
    "add variables by formula to the results in a directory, or drop some; no point runs", _add_arguments, _run
)
